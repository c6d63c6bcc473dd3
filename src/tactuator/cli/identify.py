"""`tactuator identify`: a model with its uncertainty from a record."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from tactuator.cli.answer import answer, progress
from tactuator.cli.options import AsJson
from tactuator.display.plant_model import PlantModel
from tactuator.errors import BadInput
from tactuator.files.model import write_model
from tactuator.files.record import read_record
from tactuator.identification.identify import identify
from tactuator.identification.result import Identification, resonances
from tactuator.signals.record import Record

_FAMILY = 8
DELAY_SAYS = (
    "delay_s is everything between the command and the position as recorded, the laboratory's converters and filters "
    "included; the display's delay_samples is its own computing delay and comes on top"
)


def register(app: typer.Typer) -> None:
    """Add the verb."""

    @app.command("identify")
    def identify_verb(
        record: Annotated[Path, typer.Argument(help="Record: HDF5, CSV, MATLAB or WAV.")],
        input_name: Annotated[str | None, typer.Option("--input", help="Column or variable of the command.")] = None,
        output_name: Annotated[str | None, typer.Option("--output", help="Column or variable of the position.")] = None,
        time_name: Annotated[str | None, typer.Option("--time", help="Column or variable of the time stamps.")] = None,
        rate_hz: Annotated[
            float | None, typer.Option("--rate-hz", help="Sampling rate, where the file has none.")
        ] = None,
        from_s: Annotated[float | None, typer.Option("--from-s", help="Use the record from here on.")] = None,
        to_s: Annotated[float | None, typer.Option("--to-s", help="Use the record up to here.")] = None,
        order: Annotated[int | None, typer.Option("--order", help="Number of poles (default: chosen).")] = None,
        zeros: Annotated[int | None, typer.Option("--zeros", help="Number of zeros (default: chosen).")] = None,
        integrators: Annotated[int, typer.Option("--integrators", help="Poles known to lie at s = 0.")] = 0,
        delay_s: Annotated[
            float | None, typer.Option("--delay-s", help="Dead time, where it is known (default: estimated).")
        ] = None,
        hold: Annotated[
            str,
            typer.Option(
                "--hold",
                help="The command between its samples: zero-order, first-order (held by a converter), band-limited "
                "(recorded through an anti-aliasing filter), or auto: the record tells.",
            ),
        ] = "auto",
        method: Annotated[
            str, typer.Option("--method", help="refined, prediction (held only), rls (the paper's).")
        ] = "refined",
        quantity: Annotated[
            str, typer.Option("--quantity", help="What the position is: displacement, velocity, acceleration.")
        ] = "displacement",
        forgetting: Annotated[float, typer.Option("--forgetting", help="Of the recursion; 1 keeps everything.")] = 1.0,
        friction: Annotated[bool, typer.Option("--friction/--no-friction", help="Estimate friction.")] = True,
        out: Annotated[Path | None, typer.Option("--out", help="Model file to write (JSON).")] = None,
        charts: Annotated[Path | None, typer.Option("--charts", help="Folder for the charts (SVG and CSV).")] = None,
        as_json: AsJson = False,
    ) -> None:
        """Identify a continuous model of a recorded mechanism, with its confidence band."""
        read = read_record(record, input_name=input_name, output_name=output_name, time_name=time_name, rate_hz=rate_hz)
        read = part_of(read, from_s, to_s)
        with steps() as note:
            found = identify(
                read,
                method=method,
                forgetting=forgetting,
                note=note,
                order=order,
                zeros=zeros,
                integrators=integrators,
                delay_s=delay_s,
                hold=hold,
                quantity=quantity,
                friction=friction,
            )
        for remark in found.remarks:
            sys.stderr.write(f"tactuator: note: {remark}\n")
        for reason in found.distrust:
            sys.stderr.write(f"tactuator: the model is not to be trusted: {reason}\n")
        if out is not None:
            write_model(out, found.model, found.model.family(_FAMILY, np.random.default_rng(0)))
        if charts is not None:
            from tactuator.report.plates.identification import save_identification  # matplotlib takes a second

            save_identification(found, charts)
        columns = {name: read.about.get(name) for name in ("input", "output")}
        answer(document(found) | {"columns": columns, "out": out}, as_json, _table(found, read.about, out))
        if found.distrust:
            raise typer.Exit(1)


def part_of(record: Record, from_s: float | None, to_s: float | None) -> Record:
    """Return the record between two times, seconds from its first sample; BadInput where that is nothing."""
    if from_s is None and to_s is None:
        return record
    first, last = from_s or 0.0, record.duration_s if to_s is None else to_s
    if not 0.0 <= first < last <= record.duration_s + 1.0 / record.rate_hz:
        raise BadInput(f"from {first:g} s to {last:g} s; allowed: ascending, within 0 .. {record.duration_s:g} s")
    piece = slice(round(first * record.rate_hz), round(last * record.rate_hz))
    about = record.about | {"from_s": f"{first:g}", "to_s": f"{last:g}"}
    return replace(record, command=record.command[piece], position=record.position[piece], reference=None, about=about)


@contextmanager
def steps() -> Iterator[Callable[[str], None]]:
    """Yield a function that shows on a terminal which step is under way."""
    with progress() as bars:
        task = bars.add_task("identifying", total=None)
        yield lambda text: bars.update(task, description=f"identifying: {text}")


def document(found: Identification) -> dict[str, Any]:
    """Return what `--json` prints."""
    model, frequency = found.model, found.frequency_hz()
    confidence = model.confidence()
    n, m = model.den.size - 1, model.num.size - 1
    friction = found.friction
    return {
        "model": _coefficients(model),
        "poles_hz": found.poles_hz,
        "damping": [vars(one) for one in resonances(model.den)],
        "hold": {
            "taken": found.between.hold,
            "source": found.between.source,
            "certain": found.between.certain,
            "advantage": found.between.advantage,
            "other": None if found.other is None else _coefficients(found.other),
        },
        "valid_hz": model.valid_hz,
        "trusted": not found.distrust,
        "distrust": list(found.distrust),
        "delay": DELAY_SAYS,
        "confidence": {
            "gain": confidence["gain"],
            "num": [confidence[f"num_s{m - k}"] for k in range(m + 1)],
            "den": [0.0, *(confidence[f"den_s{n - 1 - k}"] for k in range(n))],
            "delay_s": confidence["delay_s"],
        },
        "frf": {
            "frequency_hz": frequency,
            "magnitude_db": 20.0 * np.log10(np.abs(model.response(frequency))),
            "phase_deg": np.degrees(np.unwrap(np.angle(model.response(frequency)))),
            "band_db": model.band_db(frequency),
            "band_deg": np.degrees(model.band_rad(frequency)),
        },
        "order": found.order,
        "zeros": m,
        "method": model.method,
        "excitation": {
            "order": found.excitation.order,
            "needed": found.excitation.needed,
            "condition": found.excitation.condition,
            "band_hz": [found.excitation.low_hz, found.excitation.high_hz],
            "sufficient": found.excitation.sufficient,
        },
        "residuals": {
            "white": found.tests.white,
            "white_p": found.tests.white_p,
            "uncorrelated_with_input": found.tests.uncorrelated_with_input,
            "uncorrelated_p": found.tests.uncorrelated_p,
            "unexplained": found.tests.unexplained,
            "closed_loop": found.tests.feedback,
        },
        "fit_percent": found.fit_percent,
        "friction": {
            "coulomb": 0.0 if friction is None else friction.coulomb,
            "confidence": None if friction is None else friction.confidence,
            "presliding": None if friction is None else friction.presliding,
            "command_for_1_db": None if friction is None else friction.small_command,
        },
        "units": {"command": model.command_unit, "position": model.position_unit},
        "tried": [vars(candidate) for candidate in found.tried],
        "remarks": list(found.remarks),
    }


def _coefficients(model: PlantModel) -> dict[str, Any]:
    return {"num": model.num, "den": model.den, "delay_s": model.delay_s}


def _table(found: Identification, about: dict[str, str], out: Path | None) -> Table:
    model, confidence = found.model, found.model.confidence()
    table = Table("what", "value", "±95 %", title=f"{model.method}: {found.order} poles, {model.num.size - 1} zeros")
    for name, values, first in (("num", model.num, 0), ("den", model.den, 1)):
        top = values.size - 1
        for k, value in enumerate(values):
            if k >= first:
                power = top - k
                table.add_row(f"{name} s^{power}", f"{value:.6g}", f"{confidence[f'{name}_s{power}']:.2g}")
    table.add_row("dead time (ms)", f"{1e3 * model.delay_s:.4g}", f"{1e3 * confidence['delay_s']:.2g}")
    table.add_row("poles (Hz)", ", ".join(f"{pole:.4g}" for pole in found.poles_hz), "")
    for one in resonances(model.den):
        table.add_row(
            f"resonance {one.frequency_hz:.4g} Hz", f"damping ratio {one.damping_ratio:.3g}, Q {one.q:.3g}", ""
        )
    sure = "" if found.between.certain else " (cannot be told; the band holds both)"
    table.add_row("command between samples", f"{found.between.hold}, by the {found.between.source}{sure}", "")
    seen = {True: "closed loop", False: "open loop", None: "cannot tell"}[found.tests.feedback]
    table.add_row("recorded in", seen, "")
    if model.valid_hz is not None:
        table.add_row("says something (Hz)", f"{model.valid_hz[0]:.4g} to {model.valid_hz[1]:.4g}", "")
    if {"input", "output"} <= set(about):
        table.add_row("columns", f"{about['input']} -> {about['output']}", "")
    if out is not None:
        table.add_row("written to", str(out), "")
    if found.friction is not None:
        table.add_row("friction (command)", f"{found.friction.coulomb:.4g}", f"{found.friction.confidence:.2g}")
        table.add_row("friction builds up over (position)", f"{found.friction.presliding:.3g}", "")
    table.add_row("fit (%)", f"{found.fit_percent:.3f}", "")
    table.add_row("residual white", "yes" if found.tests.white else "no", "")
    table.add_row("residual free of the command", "yes" if found.tests.uncorrelated_with_input else "no", "")
    table.add_row("excitation order", str(found.excitation.order), "")
    band = float(np.max(model.band_db(found.frequency_hz())))
    table.add_row("widest band (dB)", f"{band:.2g}", "")
    return table
