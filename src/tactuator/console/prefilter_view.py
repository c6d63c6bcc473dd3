"""The view Prefilter and curve: the curve that a channel is to follow, moved by its points, and the prefilter's fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from tactuator.api.controller import design
from tactuator.console.fields import Finite, Name
from tactuator.console.loop_chart import verdict_rows
from tactuator.console.requests import Answer, View, command_line, digits
from tactuator.console.state import ConsoleState
from tactuator.io.controller import controller_text
from tactuator.io.csv_tables import curve_text, read_curve
from tactuator.perception.curve import ThresholdCurve
from tactuator.processors import single_threaded
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.prefilter import fit_prefilter, response_error_db

_LINES = 160
_DRAWN_NAME, _DRAWN_FILE = "drawn", "curve.csv"

Level = Annotated[Finite, Field(ge=-200.0, le=200.0)]
Points = Annotated[tuple[tuple[Annotated[Finite, Field(gt=0.0)], Level], ...], Field(min_length=3, max_length=200)]


def personal_curve(state: ConsoleState, file: Name) -> Answer:
    """Return the name, provenance and points of a curve file that was uploaded."""
    return _curve_document(read_curve(state.uploads.path(file)))


def _curve(state: ConsoleState, display: str, points: Points | None, file: str | None) -> ThresholdCurve | None:
    if points is not None:
        frequency, level = np.array(points).T
        said = f"drawn in the console for {state.display(display).name}"
        return ThresholdCurve(_DRAWN_NAME, frequency, level, "synthetic", said)
    return None if file is None else read_curve(state.uploads.path(file))


def fit(
    state: ConsoleState,
    display: Name,
    channel: Name,
    points: Points | None = None,
    file: Name | None = None,
    poles: int | None = None,
) -> Answer:
    """Fit the prefilter of one channel to a curve, behind the loop of the channel's own design; return the curve's
    points, the target and what the prefilter gives of it, and the error, dB.
    """
    opened = state.display(display)
    described, given = opened.channel(channel), _curve(state, display, points, file)
    display_curve = described.threshold.curve
    if given is not None:
        described = replace(described, threshold=replace(described.threshold, curve=given))
    feedback = state.file_design(display, channel).feedback(opened.rate_hz)
    used = described.prefilter.poles if poles is None else replace(described.prefilter, poles=poles).poles
    with single_threaded():
        fit = fit_prefilter(described, feedback, opened.rate_hz, opened.delay_samples, used)
    frequency = np.geomspace(*described.threshold.band_hz, _LINES)
    wanted = described.threshold.curve.level_db_re_1um_at(frequency)
    plant = discretise(described.plant, opened.rate_hz, "zoh", opened.delay_samples)
    loop = TwoDegreeLoop(SampledSystem.from_sections(fit.sections, opened.rate_hz), feedback, plant)
    error = response_error_db(described, loop, frequency)
    return {
        "own": _curve_document(display_curve),
        "curve": _curve_document(described.threshold.curve),
        "band_hz": list(described.threshold.band_hz),
        "frequency_hz": digits(frequency),
        "wanted_db": digits(wanted),
        "given_db": digits(wanted + error),
        "error_db": digits(error),
        "poles": fit.poles,
        "greatest_db": f"{fit.max_error_db:.2f}",
        "worst_hz": f"{fit.worst_hz:.4g}",
        "rms_db": f"{fit.rms_error_db:.2f}",
        "allowed_db": opened.objectives.flatness_db,
        "command": _command(state, display, points, file, poles),
    }


def save(
    state: ConsoleState,
    display: Name,
    points: Points | None = None,
    file: Name | None = None,
    poles: int | None = None,
) -> Answer:
    """Design the whole display with a curve, as `design` does; return the text of controller.json, of the curve's file
    where it was drawn, the verdict and the command.
    """
    given = _curve(state, display, points, file)
    controller = design(state.display(display), given, poles)
    return {
        "text": controller_text(controller),
        "curve": curve_text(given) if given is not None and points is not None else None,
        "verdict": verdict_rows(controller.verdict),
        "command": _command(state, display, points, file, poles),
    }


VIEW = View("prefilter", "Prefilter", {"curve": personal_curve, "fit": fit, "save": save}, of_display=True)


def _command(state: ConsoleState, display: str, points: Points | None, file: str | None, poles: int | None) -> str:
    curve = None if file is None else state.uploads.path(file).name
    return command_line(
        "design",
        state.command_name(display),
        curve=curve if points is None else _DRAWN_FILE,
        poles=poles,
        out="personal.json" if points or file else "controller.json",
    )


def _curve_document(curve: ThresholdCurve) -> Answer:
    return {
        "name": curve.name,
        "provenance": curve.provenance,
        "points": np.stack((curve.frequency_hz, curve.level_db_re_1um), axis=1).tolist(),
    }
