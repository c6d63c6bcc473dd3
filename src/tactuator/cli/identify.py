"""The verb `identify`: a model with its uncertainty from a record."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.cli.options import AsJson
from tactuator.files.model import write_model
from tactuator.files.record import read_record
from tactuator.identification.identify import Identification, identify

_FAMILY = 8


def register(app: typer.Typer) -> None:
    """Add the verb to the application."""

    @app.command("identify")
    def identify_verb(
        record: Annotated[Path, typer.Argument(help="Record: HDF5, CSV, MATLAB or WAV.")],
        input_name: Annotated[str | None, typer.Option("--input", help="Column or variable of the command.")] = None,
        output_name: Annotated[str | None, typer.Option("--output", help="Column or variable of the position.")] = None,
        time_name: Annotated[str | None, typer.Option("--time", help="Column or variable of the time stamps.")] = None,
        rate_hz: Annotated[
            float | None, typer.Option("--rate-hz", help="Sampling rate, where the file has none.")
        ] = None,
        order: Annotated[int | None, typer.Option("--order", help="Number of poles (default: chosen).")] = None,
        method: Annotated[str, typer.Option("--method", help="refined (unbiased) or rls (the paper's).")] = "refined",
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
        found = identify(read, order=order, method=method, quantity=quantity, friction=friction, forgetting=forgetting)
        for remark in found.remarks:
            sys.stderr.write(f"tactuator: note: {remark}\n")
        if out is not None:
            write_model(out, found.model, found.model.family(_FAMILY, np.random.default_rng(0)))
        if charts is not None:
            from tactuator.report.plates.identification import save_identification  # matplotlib takes a second

            save_identification(found, charts)
        answer(document(found), as_json, _table(found))


def document(found: Identification) -> dict[str, Any]:
    """Return the answer that `--json` prints."""
    model, frequency = found.model, found.frequency_hz()
    confidence = model.confidence()
    n, m = model.den.size - 1, model.num.size - 1
    friction = found.friction
    return {
        "model": {"num": model.num, "den": model.den, "delay_s": model.delay_s},
        "poles_hz": found.poles_hz,
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


def _table(found: Identification) -> Table:
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
