"""The verb `measure`: the response of a display at a level, with confidence."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.console import Group

from tactuator.cli.answer import answer, progress, shown, working, written
from tactuator.cli.chosen import ask_for_load, chosen_controller, require_stable
from tactuator.cli.controller.check import verdict_table
from tactuator.errors import BadInput
from tactuator.experiment.result.confusion import ResultTable
from tactuator.io.response import write_responses
from tactuator.measure.adaptive import Learnt, settle_weights
from tactuator.measure.error import error_db, expected_level_db_sl, response_verdict
from tactuator.measure.frequencies import over_the_band
from tactuator.measure.multisine_response import multisine_response
from tactuator.measure.options import METHODS, MeasurementOptions
from tactuator.measure.stepped_sine import stepped_sine
from tactuator.model.controller import Controller
from tactuator.model.verdict import Outcome
from tactuator.rig.finger import touch_all
from tactuator.rig.open import open_rig
from tactuator.rig.rig import Rig
from tactuator.signals.record import Response

Frequencies = np.ndarray[tuple[int], np.dtype[np.float64]]


def run(
    display: Path | None,
    controller: Path | None,
    level_db_sl: float,
    load: str,
    method: str,
    frequency: str | None,
    channel: list[str] | None,
    confidence_db: float,
    longest_s: float,
    mains_hz: float,
    out: Path | None,
    figures: Path | None,
    rig: str,
    seed: int,
    as_json: bool,
) -> None:
    """Measure the response, off mains; exit status 1 if it is not flat, or the confidence was not reached."""
    if method not in METHODS:
        raise BadInput(f"method {method!r}", f"{', '.join(METHODS)}")
    made = chosen_controller(display, controller)
    require_stable(made, load)
    band_hz = _common_band(made, channel)
    wanted = over_the_band(band_hz, mains_hz) if frequency is None else frequencies(frequency)
    options = MeasurementOptions(
        level_db_sl, channel, load, confidence_db, longest_s,
        mains_hz=mains_hz, band_hz=band_hz, controller_hash=made.content_hash,
    )  # fmt: skip
    with open_rig(rig, made.display, seed) as opened:
        ask_for_load(touch_all(opened, made.display.channels, load), load)
        opened.load(made)
        rng = np.random.default_rng(seed)
        learnt = settle_weights(opened, made, level_db_sl, np.random.default_rng(seed))
        if method == "stepped":
            responses = _stepped(opened, wanted, options)
        else:
            with working("multisine"):
                responses = multisine_response(opened, wanted, options, rng, exactly=frequency is not None)
    if out is not None:
        write_responses(out, responses)
    if figures is not None:
        from tactuator.report.device import save_measured  # matplotlib takes a second

        save_measured(responses, made, figures)
    _report(responses, made, learnt, (figures, out), as_json)


def _report(
    responses: tuple[Response, ...],
    made: Controller,
    learnt: Sequence[Learnt],
    files: tuple[Path | None, ...],
    as_json: bool,
) -> None:
    """Print the responses with their verdict; exit with status 1 where the objective is not met, or the confidence was
    not reached everywhere."""
    verdict = response_verdict(responses, made.display)
    told = Group(_table(responses, made), *map(_said, learnt), verdict_table(verdict), *written(*files))
    answer(document(responses, made) | {"learnt": [vars(one) for one in learnt]} | verdict.document(), as_json, told)
    if not all(bool(np.all(one.reached)) for one in responses):
        sys.stderr.write("tactuator: the confidence was not reached everywhere in the time allowed\n")
        raise typer.Exit(1)
    if verdict.outcome is Outcome.NOT_MET:
        raise typer.Exit(1)


def _said(learnt: Learnt) -> str:
    """Return a line on what an adaptive channel has learnt before the measurement."""
    if learnt.weight is None:
        return f"{learnt.channel}: adaptive; the rig does not tell its weights"
    mass, rest = learnt.weight
    after = "not settled" if learnt.settled_s is None else f"settled after {learnt.settled_s:.2f} s"
    return f"{learnt.channel}: weight {mass:.2f} of the mass, {rest:.2f} of damping and stiffness, {after}"


def _common_band(made: Controller, channels: Sequence[str] | None) -> tuple[float, float]:
    """Return the band that every measured channel has."""
    bands = [one.threshold.band_hz for one in made.display.channels if not channels or one.name in channels]
    return max(low for low, _ in bands or [(0.0, 0.0)]), min(high for _, high in bands or [(0.0, 0.45 * made.rate_hz)])


def _stepped(rig: Rig, wanted: Frequencies, options: MeasurementOptions) -> tuple[Response, ...]:
    """Measure frequency by frequency, with a progress bar."""
    with progress() as bar:
        task = bar.add_task("response", total=wanted.size)

        def show(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        return stepped_sine(rig, wanted, options, progress=show)


def frequencies(text: str) -> Frequencies:
    """Return the numbers of a text, with commas between them. Raises BadInput for another text."""
    try:
        return np.array([float(cell) for cell in text.split(",") if cell.strip()], dtype=np.float64)
    except ValueError:
        raise BadInput(f"frequencies {text!r}", "numbers of hertz with commas between") from None


def document(responses: Sequence[Response], made: Controller) -> dict[str, Any]:
    """Return the answer that `--json` prints."""
    return {
        "responses": [
            {
                "channel": one.channel,
                "load": one.load,
                "level_db_sl": one.level_db_sl,
                "method": one.method,
                "controller_hash": one.controller_hash,
                "frequency_hz": one.frequency_hz,
                "sensation_level_db": one.level_db_sl + error_db(one, made.display),
                "error_db": error_db(one, made.display),
                "expected_level_db_sl": expected_level_db_sl(one, made),
                "magnitude_v": one.magnitude_v,
                "magnitude_db": one.magnitude_db,
                "phase_rad": one.phase_rad,
                "latency_s": one.latency_s,
                "confidence_db": one.confidence_db,
                "noise_v": one.noise_v,
                "distortion_v": one.distortion_v,
                "saturated": one.saturated,
                "reached": one.reached,
                "averaged_s": one.averaged_s,
            }
            for one in responses
        ]
    }


def _table(responses: Sequence[Response], made: Controller) -> Group:
    columns = ("channel", "Hz", "dB SL", "expected", "error dB", "± dB", "phase °", "delay ms", "dist. dB", "cut")
    notes = (
        "error: against the level that the controller's model expects, the worst first; delay: of the phase; "
        "dist.: distortion against the fundamental; cut: a converter or the command reached its limit",
    )
    rows: list[tuple[str, ...]] = []
    for one in responses:
        level = one.level_db_sl + error_db(one, made.display)
        expected = expected_level_db_sl(one, made)
        for k in np.argsort(-np.abs(level - expected), kind="stable"):
            ratio = one.distortion_v[k] / one.magnitude_v[k] if one.magnitude_v[k] > 0.0 else np.inf
            cells = (
                one.channel,
                f"{one.frequency_hz[k]:.4g}",
                f"{level[k]:.2f}",
                f"{expected[k]:.2f}",
                f"{level[k] - expected[k]:+.2f}",
                f"{one.confidence_db[k]:.2g}",
                f"{np.degrees(one.phase_rad[k]):.1f}",
                f"{1e3 * one.latency_s[k]:.2f}",
                f"{20.0 * np.log10(ratio):.0f}" if ratio > 0.0 else "none",
                "yes" if one.saturated[k] else "",
            )
            rows.append(cells)
    return shown(ResultTable("", columns, tuple(rows), notes))
