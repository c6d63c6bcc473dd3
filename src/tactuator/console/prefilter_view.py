"""The view Prefilter and curve: the curve that a channel is to follow, moved by its points, and the prefilter's fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from tactuator.api.controller import design
from tactuator.console.loop_chart import verdict_rows
from tactuator.console.requests import Answer, Finite, Name, ViewRequest, command_line, digits
from tactuator.console.state import ConsoleState
from tactuator.io.controller import controller_text
from tactuator.io.csv_tables import curve_text, read_curve
from tactuator.perception.curve import ThresholdCurve
from tactuator.processors import single_threaded
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.prefilter import fit_prefilter, response_error_db

_LINES = 160
_DRAWN_NAME, _DRAWN_FILE = "drawn", "curve.csv"

Level = Annotated[Finite, Field(ge=-200.0, le=200.0)]
Points = Annotated[tuple[tuple[Annotated[Finite, Field(gt=0.0)], Level], ...], Field(min_length=3, max_length=200)]


@dataclass(frozen=True)
class PersonalCurve(ViewRequest):
    """Request for the points of a curve file that was uploaded."""

    file: Name

    def answer(self, state: ConsoleState) -> Answer:
        """Return the curve's name, provenance and points."""
        return _curve_document(read_curve(state.uploads.path(self.file)))


@dataclass(frozen=True)
class _Curved(ViewRequest):
    display: Name
    points: Points | None = None
    file: Name | None = None
    poles: int | None = None

    def curve(self, state: ConsoleState) -> ThresholdCurve | None:
        if self.points is not None:
            frequency, level = np.array(self.points).T
            said = f"drawn in the console for {state.display(self.display).name}"
            return ThresholdCurve(_DRAWN_NAME, frequency, level, "synthetic", said)
        return None if self.file is None else read_curve(state.uploads.path(self.file))


@dataclass(frozen=True, kw_only=True)
class PrefilterFitted(_Curved):
    """Request for the prefilter of one channel to a curve, behind the loop of the channel's own design."""

    channel: Name

    def answer(self, state: ConsoleState) -> Answer:
        """Return the curve's points, the target and what the prefilter gives of it, and the error, dB."""
        display = state.display(self.display)
        channel, given = display.channel(self.channel), self.curve(state)
        display_curve = channel.threshold.curve
        if given is not None:
            channel = replace(channel, threshold=replace(channel.threshold, curve=given))
        prefilter = channel.prefilter if self.poles is None else replace(channel.prefilter, poles=self.poles)
        feedback = state.file_design(self.display, self.channel).feedback(display.rate_hz)
        with single_threaded():
            fit = fit_prefilter(channel, feedback, display.rate_hz, display.delay_samples, prefilter.poles)
        frequency = np.geomspace(*channel.threshold.band_hz, _LINES)
        wanted = channel.threshold.curve.level_db_re_1um_at(frequency)
        plant = zero_order_hold(channel.plant, display.rate_hz, display.delay_samples)
        loop = TwoDegreeLoop(SampledSystem.from_sections(fit.sections, display.rate_hz), feedback, plant)
        error = response_error_db(channel, loop, frequency)
        return {
            "own": _curve_document(display_curve),
            "curve": _curve_document(channel.threshold.curve),
            "band_hz": list(channel.threshold.band_hz),
            "frequency_hz": digits(frequency),
            "wanted_db": digits(wanted),
            "given_db": digits(wanted + error),
            "error_db": digits(error),
            "poles": fit.poles,
            "greatest_db": f"{fit.max_error_db:.2f}",
            "worst_hz": f"{fit.worst_hz:.4g}",
            "rms_db": f"{fit.rms_error_db:.2f}",
            "allowed_db": display.objectives.flatness_db,
            "command": _command(self, state),
        }


@dataclass(frozen=True)
class PrefilterSaved(_Curved):
    """Request for the controller of the whole display with the curve, as `design` makes it."""

    def answer(self, state: ConsoleState) -> Answer:
        """Return the text of controller.json, of the curve's file where it was drawn, the verdict and the command."""
        display, given = state.display(self.display), self.curve(state)
        controller = design(display, given, self.poles)
        return {
            "text": controller_text(controller),
            "curve": curve_text(given) if given is not None and self.points is not None else None,
            "verdict": verdict_rows(controller.verdict),
            "command": _command(self, state),
        }


REQUESTS = {"prefilter.curve": PersonalCurve, "prefilter.fit": PrefilterFitted, "prefilter.save": PrefilterSaved}


def _command(asked: _Curved, state: ConsoleState) -> str:
    curve = None if asked.file is None else state.uploads.path(asked.file).name
    return command_line(
        "design",
        state.command_name(asked.display),
        curve=curve if asked.points is None else _DRAWN_FILE,
        poles=asked.poles,
        out="personal.json" if asked.points or asked.file else "controller.json",
    )


def _curve_document(curve: ThresholdCurve) -> Answer:
    return {
        "name": curve.name,
        "provenance": curve.provenance,
        "points": np.stack((curve.frequency_hz, curve.level_db_re_1um), axis=1).tolist(),
    }
