"""Files to start from (`init`), the threshold curves (`curves`), and the readers of files, which Python alone has."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tactuator import report
from tactuator.api.designed import ControllerResult
from tactuator.api.option import Argument, Option
from tactuator.api.parameters import Figures, Place
from tactuator.errors import BadInput
from tactuator.io import controller as controller_file
from tactuator.io import csv_tables, response_table
from tactuator.io import display as display_file
from tactuator.io import model as model_file
from tactuator.io import record as record_file
from tactuator.io.atomic import write_files
from tactuator.io.display import parse_display
from tactuator.io.shipped import (
    DISPLAY_KINDS,
    PROTOCOL_KINDS,
    copy_examples,
    display_template,
    protocol_files,
    with_model,
)
from tactuator.io.text import parse_toml
from tactuator.model.description import Display
from tactuator.model.plant_model import PlantModel
from tactuator.parameters import parameters
from tactuator.perception import curve as library
from tactuator.perception.curve import Contact, ThresholdCurve
from tactuator.result import Chart, ChartLine, Column, Fact, Result, ResultTable, found, text_table
from tactuator.signals.record import FrequencyResponse, Record


@dataclass(frozen=True, eq=False, repr=False)
class WrittenFiles(Result):
    """Files that were written. note: what to do with them."""

    written: tuple[Path, ...]
    note: str = ""

    def facts(self) -> Sequence[Fact]:
        files = list(map(str, self.written))
        return [Fact("written", files), found("files", len(files)), found("first", files[0])]

    def next_step(self) -> str:
        return self.note


def init(
    like: Annotated[str | None, Option(f"Actuator: {', '.join(DISPLAY_KINDS)}.")] = None,
    model: Annotated[Place | None, Option("Model file of `identify`: it is the plant.", ("--from",), file=True)] = None,
    out: Annotated[Place, Option("Display file to write.", type=Path, shell=Path("display.toml"))] = "display.toml",
    protocol: Annotated[str | None, Option(f"Write a protocol, too: {', '.join(PROTOCOL_KINDS)}.")] = None,
    examples: Annotated[
        Place | None, Option("Copy the examples into this folder, and write nothing else.", type=Path | None)
    ] = None,
) -> WrittenFiles:
    """Write a display file to start from, or copy the examples. A protocol is written for the new display file, or for
    one that exists.

    Raises BadInput for a file that exists.

    >>> tt.init(out="mine.toml").headline()["first"]
    'mine.toml'
    """
    if examples is not None:
        if like is not None or model is not None or protocol is not None:
            raise BadInput("`examples` with another option", "`examples` alone")
        copied = copy_examples(Path(examples))
        note = f"{Path(examples) / 'README.md'} says what each file is"
        return WrittenFiles(copied, note)
    target = Path(out)
    if not target.parent.is_dir():
        raise BadInput(f"no folder {target.parent}", "`out` in a folder that exists")
    contents: dict[Path, bytes] = {}
    if protocol is None or like is not None or model is not None or not target.exists():
        contents[target] = _display_text(like or DISPLAY_KINDS[0], model, target).encode()
    if protocol is not None:
        written = contents.get(target)
        display = parse_display(parse_toml(written.decode()), target.parent) if written else read_display(target)
        contents |= {target.parent / name: content for name, content in protocol_files(protocol, display).items()}
    for path in contents:
        if path.exists() and (path == target or path.suffix == ".toml"):
            raise BadInput(f"{path} already exists", f"a new {'name' if path == target else 'folder'}")
    write_files(contents)
    why = "are typical of the kind" if model is None else "the model does not give"
    note = f"change the lines that say CHANGE THIS, which {why}"
    return WrittenFiles(tuple(contents), note)


def _display_text(kind: str, model: Place | None, out: Path) -> str:
    text = display_template(kind)
    return (
        text
        if model is None
        else with_model(text, model_file.read_model(Path(model)), os.path.relpath(model, out.parent))
    )


def examples(folder: Place = ".") -> tuple[Path, ...]:
    """Write a copy of every shipped example into `folder` and return the paths.

    >>> len(tt.examples("more examples")) > 30
    True
    """
    return init(examples=folder).written


def read_display(path: Place) -> Display:
    """Read a display file (TOML). Raises BadInput for a key that is not known or out of range.

    >>> tt.read_display("display.toml")
    <Display name: three-finger tactuator, rate: 4000 Hz, channels: index, thumb, middle, curve: bolanowski-1988>
    """
    return display_file.read_display(Path(path))


def read_record(path: Place, **columns: Any) -> Record:
    """Read a record: HDF5, CSV, MATLAB or WAV. columns: input, output, time, rate_hz, where needed.

    >>> tt.read_record("bench.csv", input="drive", output="encoder", time="t").duration_s
    8.0
    """
    return record_file.read_record(Path(path), **columns)


def read_response(path: Place, **columns: Any) -> FrequencyResponse:
    """Read a frequency response. columns: frequency, magnitude, phase, real, imaginary (NAME or NAME=UNIT) and ignore,
    where needed. Raises BadInput for a column that may be the phase and is not read.

    >>> tt.read_response("sheet.csv", phase="phase_deg").frequency_hz.size
    60
    """
    ignore = tuple(columns.pop("ignore", ()))
    return response_table.read_response(Path(path), response_table.ResponseColumns(**columns, ignore=ignore))


def read_curve(name_or_path: Place) -> ThresholdCurve:
    """Return a threshold curve of the library, or read one from a CSV file.

    >>> tt.read_curve("curve.csv")
    <ThresholdCurve name: S1, provenance: synthetic, band: 0.4 to 300 Hz, points: 12>
    """
    return csv_tables.resolve_curve(str(name_or_path))


def read_model(path: Place) -> PlantModel:
    """Read a model that `identify` wrote. Raises BadInput for another file.

    >>> tt.read_model("bench.csv")
    Traceback (most recent call last):
    ...
    tactuator.errors.BadInput: bench.csv: this is a record: `tactuator identify` takes it; expected a model
    """
    return model_file.read_model(Path(path))


def read_controller(path: Place) -> ControllerResult:
    """Read a controller that `design` made and `write` wrote.

    >>> controller.write("controller.json")
    >>> tt.read_controller("controller.json").content_hash == controller.content_hash
    True
    """
    return ControllerResult.of(controller_file.read_controller(Path(path)))


@dataclass(frozen=True, eq=False, repr=False)
class CurvesResult(Result):
    """Threshold curves with where they were felt. It draws them beside each other.

    figures: their folder, where asked for.
    """

    curves: tuple[ThresholdCurve, ...]
    figures: Path | None = None

    def table(self) -> Sequence[Column]:
        bands = [f"{curve.frequency_hz[0]:g} to {curve.frequency_hz[-1]:g} Hz" for curve in self.curves]
        contact = (
            Column(
                key,
                [curve.contact.said.get(key, "not stated") for curve in self.curves],
                key.rsplit("_", 1)[0] if "_" in key else key,
            )
            for key in parameters(Contact)
        )
        return [
            Column("curve", [curve.name for curve in self.curves], "curve"),
            Column("provenance", [curve.provenance for curve in self.curves], "provenance"),
            Column("band", bands, "band"),
            *contact,
        ]

    def tables(self) -> Sequence[ResultTable]:
        return [text_table(self.table(), notes=[f"{curve.name}: {curve.source}" for curve in self.curves])]

    def chart(self) -> Chart:
        lines = [
            ChartLine(
                f"{curve.name} ({curve.contact.said.get('site', 'site not stated')}, {curve.provenance})",
                curve.frequency_hz,
                curve.level_db_re_1um,
                "o-",
                None if curve.standard_error_db is None else 1.959964 * curve.standard_error_db,
                colour=number,
            )
            for number, curve in enumerate(self.curves)
        ]
        return Chart("frequency (Hz)", "threshold (dB re 1 µm, peak)", lines, log_x=True)

    def facts(self) -> Sequence[Fact]:
        sites = {curve.name: curve.contact.said.get("site", "nobody said where") for curve in self.curves}
        return [Fact("curves", self.curves), *(found(name, site) for name, site in sites.items())]

    def next_step(self) -> str:
        at_finger = any("finger" in curve.contact.site for curve in self.curves)
        return "" if at_finger else "measure your own: none of these was felt at a fingertip"


def curves(
    files: Annotated[
        Sequence[Place], Argument("Curves of your own beside the library's (CSV).", file=True, type=list[Path] | None)
    ] = (),
    figures: Figures = None,
) -> CurvesResult:
    """List the threshold curves of the library, and your own.

    A curve holds for the contact that it was measured at.

    >>> [curve.name for curve in tt.curves().curves]
    ['bolanowski-1988', 'morioka-griffin-2006']
    """
    read = [csv_tables.read_curve(Path(file)) for file in files or ()]
    result = CurvesResult(
        (*map(library.curve, library.curve_names()), *read), None if figures is None else Path(figures)
    )
    if figures is not None:
        report.figure.save_figures(
            [report.chart.chart_figure(result.chart(), "curves", "Detection thresholds.")], Path(figures)
        )
    return result
