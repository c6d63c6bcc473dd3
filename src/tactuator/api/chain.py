"""The chain's verbs as functions, from a file to a verdict. Examples run in the folder of `tt.examples()`."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from tactuator.api.measured import BuiltImage
from tactuator.api.nouns import (
    CalibrationResult,
    ControllerResult,
    CurveResult,
    DisplayResult,
    IdentificationResult,
    ModelResult,
    RecordResult,
    VerdictResult,
)
from tactuator.api.result import promoted
from tactuator.identification import identify as identification
from tactuator.identification.calibration import fit_line
from tactuator.identification.fixed.value import Fixed
from tactuator.io import controller as controller_file
from tactuator.io import curve as curve_file
from tactuator.io import display as display_file
from tactuator.io import model as model_file
from tactuator.io import record as record_file
from tactuator.io.pairs import read_pairs
from tactuator.io.start.shipped import copy_examples
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.record import Record
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.verdict import whole_verdict
from tactuator.wordlength.assessment import built

Place = str | PathLike[str]


def examples(folder: Place = ".") -> tuple[Path, ...]:
    """Write a copy of every shipped example into `folder` and return the paths.

    >>> len(tt.examples("more examples")) > 30
    True
    """
    return copy_examples(Path(folder))


def read_display(path: Place) -> DisplayResult:
    """Read a display file (TOML). Raises BadInput for a key that is not known or out of range.

    >>> tt.read_display("display.toml")
    <Display name: three-finger tactuator, rate: 4000 Hz, channels: index, thumb, middle, curve: bolanowski-1988>
    """
    return promoted(DisplayResult, display_file.read_display(Path(path)))


def read_record(path: Place, **columns: Any) -> RecordResult:
    """Read a record: HDF5, CSV, MATLAB or WAV. columns: input_name, output_name, time_name, rate_hz, where needed.

    >>> tt.read_record("bench.csv", input_name="drive", output_name="encoder", time_name="t").duration_s
    8.0
    """
    return promoted(RecordResult, record_file.read_record(Path(path), **columns))


def read_curve(name_or_path: Place) -> CurveResult:
    """Return a threshold curve of the library, or read one from a CSV file.

    >>> tt.read_curve("curve.csv")
    <Curve name: S1, provenance: synthetic, band: 0.4 to 300 Hz, points: 12>
    """
    return promoted(CurveResult, curve_file.resolve_curve(str(name_or_path)))


def read_model(path: Place) -> ModelResult:
    """Read a model that `identify` wrote. Raises BadInput for another file.

    >>> tt.read_model("curve.csv")
    Traceback (most recent call last):
    ...
    tactuator.errors.BadInput: model curve.csv: it is not JSON; allowed: a file that `identify` wrote
    """
    return promoted(ModelResult, model_file.read_model(Path(path)))


def read_controller(path: Place) -> ControllerResult:
    """Read a controller that `design` made and `write` wrote.

    >>> controller.write("controller.json")
    >>> tt.read_controller("controller.json").content_hash == controller.content_hash
    True
    """
    return promoted(ControllerResult, controller_file.read_controller(Path(path)))


def identify(record: Record | Place, **asked: Any) -> IdentificationResult:
    """Identify a model of a record, or of the file that holds one.

    asked: order, zeros, integrators, delay_s, hold, quantity, friction, method, fix (["mass=0.012", ..]), as in
    docs/identification.md. Raises BadInput for a record that says nothing.

    >>> record = tt.read_record("bench.csv", input_name="drive", output_name="encoder", time_name="t")
    >>> tt.identify(record, order=2, zeros=0, hold="zero-order", friction=False).order
    2
    """
    read = record if isinstance(record, Record) else record_file.read_record(Path(record))
    fixed = tuple(Fixed.parse(one) for one in asked.pop("fix", ()))
    return promoted(IdentificationResult, identification.identify(read, fixed=fixed, **asked))


def calibrate(pairs: Place, gauge_error_mm: float = 0.0) -> CalibrationResult:
    """Estimate a sensor gain (V/mm) from a CSV of displacement_mm, voltage_v and, if any, name.

    >>> tt.calibrate("pairs.csv")
    <Calibration gain: 0.1992 ± 0.00024 V/mm, offset: 0.03181 ± 0.0014 V, refused: p10>
    """
    read = read_pairs(Path(pairs))
    found = fit_line(read.displacement_mm, read.voltage_v, gauge_error_mm=gauge_error_mm, names=read.names)
    return promoted(CalibrationResult, found)


def design(
    display: Display | Place,
    curve: ThresholdCurve | Place | None = None,
    poles: int | None = None,
    error_db: float | None = None,
) -> ControllerResult:
    """Design loop and prefilter of every channel of a display, or of its file.

    curve: in place of the display's own. poles: of every prefilter; error_db: as few poles as keep that error. Raises
    DesignError where no controller meets what is asked.

    >>> tt.design("displays/voice-coil.toml").rate_hz
    8000.0
    """
    described = display if isinstance(display, Display) else read_display(display)
    if curve is not None:
        chosen = curve if isinstance(curve, ThresholdCurve) else read_curve(curve)
        described = display_file.with_curve(described, chosen)
    return promoted(ControllerResult, design_controller(described, poles, error_db))


def check(controller: Controller, display: Display | None = None) -> VerdictResult:
    """Return the verdict on the paper's four objectives and on building an image, for `display` or its own.

    >>> tt.check(controller).sentence  # friction, noise and hum stand in no file of this display
    'not judged (i, iv, build: met; ii, iii: not judged)'
    """
    return promoted(VerdictResult, whole_verdict(controller, display))


def build(controller: Controller, number_format: str = "float32") -> BuiltImage:
    """Return the controller as the image that a board loads; BadInput for a format that is not safe for it.

    >>> tt.build(controller, "q31").number_format
    'q31'
    """
    content, report = built(controller, number_format)
    return BuiltImage(content, number_format, float(report.response_error_db or 0.0))
