"""The view Prefilter and curve: the curve that a channel is to follow, moved by its points, and the prefilter's fit."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from threadpoolctl import threadpool_limits

from tactuator.arrays import FloatArray
from tactuator.console.asked import Answer, Finite, Name, ViewRequest
from tactuator.console.figures import verdict_rows
from tactuator.console.workshop import Workshop
from tactuator.io.controller import controller_text
from tactuator.io.csv_tables import curve_text, read_curve
from tactuator.io.display import with_curve
from tactuator.model.description import Channel
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.family import sampled_plant
from tactuator.synthesis.prefilter import fit_prefilter, response_error_db
from tactuator.synthesis.verdict import whole_verdict

_LINES = 160
_DRAWN_NAME, _DRAWN_FILE = "drawn", "curve.csv"

Level = Annotated[Finite, Field(ge=-200.0, le=200.0)]
Points = Annotated[tuple[tuple[Annotated[Finite, Field(gt=0.0)], Level], ...], Field(min_length=3, max_length=200)]
Poles = Annotated[int, Field(ge=2, le=16)]


class PersonalCurve(ViewRequest):
    """Request for the points of a curve file that was dropped."""

    do: Literal["prefilter.curve"]
    file: Name

    def answer(self, workshop: Workshop) -> Answer:
        """Return the curve's name, provenance and points."""
        return _told(read_curve(workshop.drawer.path(self.file)))


class _Curved(ViewRequest):
    display: Name
    points: Points | None = None
    file: Name | None = None
    poles: Poles | None = None

    def curve(self, workshop: Workshop) -> ThresholdCurve | None:
        """Return the curve that was drawn or dropped, or None where the display's own stands."""
        if self.points is not None:
            frequency, level = np.array(self.points).T
            said = f"drawn in the console for {workshop.display(self.display).name}"
            return ThresholdCurve(_DRAWN_NAME, frequency, level, "synthetic", said)
        return None if self.file is None else read_curve(workshop.drawer.path(self.file))


class PrefilterFitted(_Curved):
    """Request for the prefilter of one channel to a curve, behind the loop of the channel's own design."""

    do: Literal["prefilter.fit"]
    channel: Name

    def answer(self, workshop: Workshop) -> Answer:
        """Return the curve's points, the target and what the prefilter gives of it, and the error, dB."""
        display = workshop.display(self.display)
        channel, given = display.channel(self.channel), self.curve(workshop)
        own = channel.threshold.curve
        if given is not None:
            channel = replace(channel, threshold=replace(channel.threshold, curve=given))
        feedback = workshop.own_design(self.display, self.channel).feedback(display.rate_hz)
        poles = channel.prefilter.poles if self.poles is None else self.poles
        with threadpool_limits(limits=1):
            fit = fit_prefilter(channel, feedback, display.rate_hz, display.delay_samples, poles)
        frequency = np.geomspace(*channel.threshold.band_hz, _LINES)
        wanted = channel.threshold.curve.level_db_re_1um_at(frequency)
        error = _error_db(channel, feedback, fit.sections, frequency, display.rate_hz, display.delay_samples)
        return {
            "own": _told(own),
            "curve": _told(channel.threshold.curve),
            "band_hz": list(channel.threshold.band_hz),
            "frequency_hz": _digits(frequency),
            "wanted_db": _digits(wanted),
            "given_db": _digits(wanted + error),
            "error_db": _digits(error),
            "poles": fit.poles,
            "greatest_db": f"{fit.max_error_db:.2f}",
            "worst_hz": f"{fit.worst_hz:.4g}",
            "rms_db": f"{fit.rms_error_db:.2f}",
            "allowed_db": display.objectives.flatness_db,
            "command": _command(self, workshop),
        }


class PrefilterSaved(_Curved):
    """Request for the controller of the whole display with the curve, as `design` makes it."""

    do: Literal["prefilter.save"]

    def answer(self, workshop: Workshop) -> Answer:
        """Return the text of controller.json, of the curve's file where it was drawn, the verdict and the command."""
        display, given = workshop.display(self.display), self.curve(workshop)
        controller = design_controller(display if given is None else with_curve(display, given), self.poles)
        return {
            "text": controller_text(controller),
            "curve": curve_text(given) if given is not None and self.points is not None else None,
            "verdict": verdict_rows(whole_verdict(controller)),
            "command": _command(self, workshop),
        }


PrefilterRequest = PersonalCurve | PrefilterFitted | PrefilterSaved


def _command(asked: _Curved, workshop: Workshop) -> str:
    words = ["tactuator", "design", workshop.command_name(asked.display)]
    if asked.points is not None:
        words += ["--curve", _DRAWN_FILE]
    elif asked.file is not None:
        words += ["--curve", workshop.drawer.path(asked.file).name]
    words += [] if asked.poles is None else ["--poles", str(asked.poles)]
    return shlex.join([*words, "--out", "controller.json"])


def _error_db(
    channel: Channel,
    feedback: SampledSystem | None,
    sections: FloatArray,
    frequency_hz: FloatArray,
    rate_hz: float,
    delay_samples: int,
) -> FloatArray:
    """Return the error of |H| against the curve's threshold voltage, dB."""
    plant = sampled_plant(channel.plant, rate_hz, delay_samples)
    loop = TwoDegreeLoop(SampledSystem.from_sections(sections, rate_hz), feedback, plant)
    return response_error_db(channel, loop, frequency_hz)


def _told(curve: ThresholdCurve) -> Answer:
    return {
        "name": curve.name,
        "provenance": curve.provenance,
        "points": [list(one) for one in zip(curve.frequency_hz.tolist(), curve.level_db_re_1um.tolist(), strict=True)],
    }


def _digits(values: FloatArray) -> list[float]:
    return [float(f"{value:.6g}") for value in values.tolist()]
