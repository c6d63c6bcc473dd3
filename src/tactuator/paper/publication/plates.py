"""The figures of the study: every counterpart of the paper's, and a few that it has not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactuator.experiment.result.store_results import PersonThresholds
from tactuator.paper.loops import sampled_loop
from tactuator.paper.response import LOADED, UNLOADED, ResponsePoint, nominal_response
from tactuator.paper.run import PaperStudy
from tactuator.report.configuration import loop_plate, mechanism_plate, processor_plate
from tactuator.report.controller import prefilter_plate, resolution_plate
from tactuator.report.device import LevelResponse, calibration_plate, motor_plate, noise_plate, response_plate
from tactuator.report.felt import equality_plate, felt_plate, threshold_plate, thresholds_plate
from tactuator.report.nichols import nichols_plate
from tactuator.report.plate import Plate
from tactuator.signals.discretise import zero_order_hold
from tactuator.synthesis import paper


def plates(study: PaperStudy) -> tuple[Plate, ...]:
    """Return the plates: fig01 to fig12 as in the paper (12: speech), then noise, prefilter, resolution and the
    reshaped response.
    """
    display = study.plan.display
    first = display.channels[0]
    curve = first.threshold.curve
    band = np.geomspace(*first.threshold.band_hz, 400)
    motor = study.motors[first.name].estimate.model
    identified = replace(first, plant=motor)
    return (
        threshold_plate(curve),
        equality_plate(first, band, nominal_response(study.controller, first.name, band), name="fig02"),
        mechanism_plate(identified),
        motor_plate(
            study.open_loop.frequency_hz,
            study.open_loop.response[first.name],
            motor,
            zero_order_hold(motor, display.rate_hz),
            first.name,
        ),
        calibration_plate(study.calibration),
        loop_plate(first, paper.FEEDBACK, study.controller.channels[0].prefilter(display.rate_hz)),
        _nichols(study),
        processor_plate(study.controller),
        response_plate(_runs(study.responses, UNLOADED), "unloaded", "fig09"),
        response_plate(_runs(study.responses, LOADED), "with a finger", "fig10"),
        _thresholds(study),
        felt_plate(study.spoken.report, study.spoken.file.path.name),
        noise_plate({gain: heard[0] for gain, heard in study.noise.proportional.items()}, study.noise.designed[0]),
        _prefilters(study),
        resolution_plate(study.resolution),
        response_plate(_runs(study.reshaped.responses, UNLOADED), "prefilter reshaped to the new curve", "reshaped"),
    )


def _nichols(study: PaperStudy) -> Plate:
    first = study.plan.display.channels[0]
    loops = (sampled_loop(study.plan.display, replace(first, plant=first.loaded_plant(load))) for load in first.loads)
    title = "Loop shaping in the Nichols chart"
    loop = study.loop
    return nichols_plate(loop.sampled, first.plant, loop.continuous, tuple(loops), name="fig07", title=title)


def _prefilters(study: PaperStudy) -> Plate:
    judged = study.prefilters
    errors = {
        "the paper's F": (judged.paper.frequency_hz, judged.paper.error_db),
        "the paper's F, sampled": (judged.paper_sampled.frequency_hz, judged.paper_sampled.error_db),
        **{f"fitted, {name}": (fit.frequency_hz, fit.error_db) for name, fit in judged.fitted.items()},
    }
    return prefilter_plate(errors, study.plan.display.objectives.flatness_db)


def _runs(points: tuple[ResponsePoint, ...], load: str) -> list[LevelResponse]:
    keys = dict.fromkeys((one.channel, one.level_db_sl) for one in points if one.load == load)
    return [_run([one for one in points if (one.channel, one.level_db_sl, one.load) == (*key, load)]) for key in keys]


def _run(points: list[ResponsePoint]) -> LevelResponse:
    names = ("frequency_hz", "expected_v", "measured_v", "ci_db", "saturated")
    columns = (np.array([getattr(one, name) for one in points]) for name in names)
    return LevelResponse(points[0].channel, points[0].level_db_sl, *columns)


def _thresholds(study: PaperStudy) -> Plate:
    """Draw each observer's mean over the fingers, with the standard error of that mean."""
    people = []
    for name in dict.fromkeys(one.observer for one in study.thresholds):
        own = [one for one in study.thresholds if one.observer == name]
        hertz = np.array(sorted({one.frequency_hz for one in own}))
        levels = [[one.level_db_re_1um for one in own if one.frequency_hz == f] for f in hertz]
        errors = [np.hypot.reduce([one.se_db for one in own if one.frequency_hz == f]) for f in hertz]
        counts = np.array([len(row) for row in levels])
        people.append(PersonThresholds(name, hertz, np.mean(levels, axis=1), np.array(errors) / counts))
    return thresholds_plate(people, study.plan.display.channels[0].threshold.curve, study.curve)
