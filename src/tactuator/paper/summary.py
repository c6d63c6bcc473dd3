"""What came out: summary.json with every figure of the study by name, and the table that README has."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.paper.measured import (
    FINGERS_AT_DB_SL,
    LOADED,
    UNLOADED,
    Responses,
    Spoken,
    change_by_finger_db,
    of,
    worst_error_db,
)
from tactuator.paper.people import errors_db, standard_error_db
from tactuator.paper.plan import LEVELS_DB_SL, PEOPLE
from tactuator.paper.printed import CHANNEL
from tactuator.paper.study import PaperStudy
from tactuator.plain import picked, plain

Row = tuple[str, str, str, str]
"""A row of the table: what, the paper's printed design, ours, and what the numbers rest on."""
HEADS = ("what", "the paper's printed design", "ours, by default", "rests on")
CURVE, FINGER, PEOPLE_ = "inferred curve", "assumed finger", "simulated people"
_CALIBRATED = ("gain_v_per_mm", "gain_confidence_v_per_mm", "offset_v", "linearity_percent")
_LEVELS = tuple(level for level in LEVELS_DB_SL if level > 0.0)


def summary(study: PaperStudy) -> dict[str, Any]:
    """Return the figures as plain numbers, strings and lists; the same seed gives the same."""
    lab, known = study.lab, study.detected.thresholds
    errors = errors_db(known)
    return {
        "display": lab.display.name,
        "seed": study.plan.seed,
        "channel": CHANNEL,
        "calibration": {name: picked(line, *_CALIBRATED) for name, line in lab.calibrations.items()},
        "plant": {name: plain(picked(fit.model, "num", "den")) for name, fit in lab.motors.items()},
        "truth": asdict(study.truth),
        "environment": {channel.name: plain(channel.environment) for channel in lab.display.channels},
        "margins": {
            name: controller.channel(CHANNEL).report["margins"]
            for name, controller in (("printed", study.printed), ("ours", lab.controller))
        },
        "prefilter": {
            "printed_max_error_db": float(np.max(np.abs(printed_error_db(study)[1]))),
            "ours_max_error_db": lab.controller.channel(CHANNEL).report["prefilter"]["max_error_db"],
        },
        "resolution_bits": plain(study.resolution.bits),
        "noise": _noise(study),
        "response": {"printed": _points(study.printed_responses), "ours": _points(study.responses)},
        "without_friction": _points(study.without_friction),
        "other_fingers": _points(study.other_fingers),
        "objectives": {
            "printed": study.printed_verdict.document()["objectives"],
            "ours": study.verdict.document()["objectives"],
        },
        "objective_iv_to_hz": lab.display.objectives.load_band_hz,
        "people": {
            name: {"offset_db": offset, "tilt_db_per_decade": tilt} for name, (offset, tilt, _) in PEOPLE.items()
        },
        "thresholds": [asdict(each) for each in known],
        "threshold_bias_db": float(errors.mean()),
        "threshold_spread_db": float(errors.std(ddof=1)),
        "mean_standard_error_db": standard_error_db(known),
        "curve": plain(picked(study.detected.curve, "frequency_hz", "level_db_re_1um", "standard_error_db"))
        | {"library_db_re_1um": plain(_library(study))},
        "reshaped": {"max_error_db": study.reshaped_error_db, "response": _points(study.reshaped_responses)},
        "speech": {spoken.coding: _speech(spoken) for spoken in study.spoken},
    }


def summary_text(study: PaperStudy) -> str:
    """Return the text of the summary as it is written to summary.json."""
    return json.dumps(summary(study), indent=1, allow_nan=False, default=float) + "\n"


def printed_error_db(study: PaperStudy) -> tuple[FloatArray, FloatArray]:
    """Return frequency and error of the printed F and C against the curve on their own channel, by the model, (n,)."""
    channel = study.printed.display.channel(CHANNEL)
    hertz = np.geomspace(*channel.threshold.band_hz, 600)
    return hertz, 20.0 * np.log10(np.abs(study.printed.response(CHANNEL, hertz)) / channel.threshold_voltage(hertz))


def _library(study: PaperStudy) -> FloatArray:
    library = study.lab.display.channels[0].threshold.curve
    return library.level_db_re_1um_at(study.detected.curve.frequency_hz)


def _points(runs: Responses) -> list[dict[str, Any]]:
    names = ("frequency_hz", "asked_v", "expected_v", "measured_v", "ci_db", "saturated")
    return [
        dict(
            zip(("channel", "load", "level_db_sl", *names), (run.channel, run.load, run.level_db_sl, *row), strict=True)
        )
        for run in runs
        for row in zip(*(getattr(run, name).tolist() for name in names), strict=True)
    ]


def _speech(spoken: Spoken) -> dict[str, Any]:
    rendered = spoken.result.rendered
    fingers = {
        finger.finger: plain(picked(finger, "centre_hz", "asked_db_sl", "felt_db_sl"))
        for finger in spoken.report.fingers
    }
    return {
        "file": spoken.result.source.name,
        "duration_s": rendered.duration_s,
        "felt_error_db_rms": spoken.report.worst_rms_db,
        "peak_db_sl": spoken.report.peak_db_sl,
        "frames": {
            finger: {name: value for name, value in of_frames.items() if math.isfinite(value)}
            for finger, of_frames in spoken.report.figures().items()
        },
        "limited_db": {finger.finger: finger.max_reduction_db for finger in rendered.limiting},
        "fingers": fingers,
    }


def _noise(study: PaperStudy) -> list[dict[str, Any]]:
    """Return felt hum, noise and resonance under each probing gain and under the loop."""
    return [
        {
            "under": name,
            "channel": felt.channel,
            "mains_db_sl": dict(zip((f"{line:g}" for line in felt.line_hz), felt.line_db_sl.tolist(), strict=True)),
            "worst_band_db_sl": float(felt.band_db_sl.max()),
            "resonance_hz": felt.resonance_hz,
            "resonance_db_sl": felt.resonance_db_sl,
        }
        for name, channels in study.lab.noise.runs
        for felt in channels
    ]


def comparison(study: PaperStudy) -> tuple[Row, ...]:
    """Return every row, in the paper's order."""
    return (*_plant_rows(study), *_response_rows(study), *_person_rows(study))


def _plant_rows(study: PaperStudy) -> list[Row]:
    lab, truth = study.lab, study.truth
    gain, model = lab.calibrations[CHANNEL], lab.motors[CHANNEL].model
    made = f"{model.num[0]:.0f}/(s² + {model.den[1]:.1f}s + {model.den[2]:.0f})"
    printed, ours = (each.channel(CHANNEL).report["margins"] for each in (study.printed, lab.controller))
    prefilter = lab.controller.channel(CHANNEL).report["prefilter"]
    measured = f"{gain.gain_v_per_mm:.5f} ± {gain.gain_confidence_v_per_mm:.5f}"
    designed = f"changes the felt level by up to {truth.design_error_db:.1f} dB"
    return [
        ("sensor gain (V/mm)", "0.19898", measured, ""),
        ("motor P(s)", "2875/(s² + 94s + 290)", made, ""),
        ("designed for the identified, not the true motor", "“well modeled”", designed, ""),
        ("cut-off frequency (Hz)", f"{printed['crossover_hz']:.1f} (20)", f"{ours['crossover_hz']:.1f}", ""),
        ("phase margin", f"{printed['phase_margin_deg']:.1f}°", f"{ours['phase_margin_deg']:.1f}°", ""),
        ("gain margin", f"{printed['gain_margin_db']:.1f} dB", f"{ours['gain_margin_db']:.1f} dB", ""),
        (
            "prefilter against the curve",
            f"within {np.max(np.abs(printed_error_db(study)[1])):.1f} dB",
            f"within {prefilter['max_error_db']:.2f} dB",
            CURVE,
        ),
    ]


def upper_db(value: float) -> str:
    """Return a figure of the default design, rounded up to half a decibel: its last digits depend on the processor,
    whose linear algebra rounds otherwise.
    """
    return f"{math.ceil(2.0 * value) / 2.0:.1f}"


def _response_rows(study: PaperStudy) -> list[Row]:
    named = " / ".join(f"{level:g}" for level in _LEVELS)
    rows: list[Row] = []
    for load, words, stated in ((UNLOADED, "free", "closely"), (LOADED, "under a finger", "essentially the same")):
        printed = " / ".join(f"{worst_error_db(study.printed_responses, load, level):.1f}" for level in _LEVELS)
        ours = " / ".join(upper_db(worst_error_db(study.responses, load, level)) for level in _LEVELS)
        basis = CURVE if load == UNLOADED else f"{CURVE}, {FINGER}"
        rows.append(
            (
                f"level error, {words}, {named} dB SL",
                f"within {printed} dB (“{stated}”)",
                f"within {ours} dB",
                basis,
            )
        )
    to_hz, at = study.lab.display.objectives.load_band_hz, FINGERS_AT_DB_SL
    printed_iv, ours_iv = (
        " / ".join(f"{change_by_finger_db(runs, at, hertz, CHANNEL):.1f}" for hertz in (to_hz, math.inf))
        for runs in (study.printed_responses, study.responses)
    )
    others = f"within {upper_db(worst_error_db(study.other_fingers, LOADED, at))} dB"
    lost = [run.error_db - run.model_db for run in of(study.responses, UNLOADED, 0.0)]
    low = min(float(np.min(part[run.frequency_hz <= 50.0])) for part, run in zip(lost, study.responses, strict=False))
    smooth = max(
        float(np.max(np.abs(run.error_db - run.model_db)[run.frequency_hz <= 50.0])) for run in study.without_friction
    )
    friction = f"friction takes up to {-low:.1f} dB (without it {smooth:.1f} dB)"
    rows += [
        (f"change by a finger to {to_hz:g} Hz / in the band", f"{printed_iv} dB", f"{ours_iv} dB", FINGER),
        (f"{len(study.other_fingers)} other fingers, {at:g} dB SL", "", others, f"{CURVE}, {FINGER}"),
        ("felt minus predicted, 0 dB SL, to 50 Hz", "“deviations”", friction, CURVE),
    ]
    basis_of = {"i": CURVE, "ii": CURVE, "iii": CURVE, "iv": FINGER}
    printed_of, ours_of = (
        {each.number: each.outcome.value for each in verdict.objectives}
        for verdict in (study.printed_verdict, study.verdict)
    )
    return [
        *rows,
        *((f"objective {number}", printed_of[number], ours_of[number], basis) for number, basis in basis_of.items()),
    ]


def _person_rows(study: PaperStudy) -> list[Row]:
    errors = errors_db(study.detected.thresholds)
    trials = np.array([each.trials for each in study.detected.thresholds])
    low, high = np.percentile(trials, [5, 95])
    curve = study.detected.curve
    difference = curve.level_db_re_1um - _library(study)
    made = [
        np.mean([offset + tilt * math.log10(hertz / 20.0) for offset, tilt, _ in PEOPLE.values()])
        for hertz in curve.frequency_hz[[0, -1]]
    ]
    found = ", ".join(f"{difference[k]:+.1f} dB at {curve.frequency_hz[k]:g} Hz" for k in (0, -1))
    direct, bands = study.spoken
    return [
        ("trials a run", "60-90", f"{trials.mean():.0f} (5-95 %: {low:.0f}-{high:.0f})", PEOPLE_),
        ("threshold, measured minus true", "", f"{errors.mean():+z.1f} ± {errors.std(ddof=1):.1f} dB", PEOPLE_),
        (
            "new curve against the library's",
            "higher, then lower",
            found,
            f"{PEOPLE_}, made {made[0]:+.1f} and {made[1]:+.1f} dB",
        ),
        ("prefilter reshaped to it", "planned", f"within {study.reshaped_error_db:.2f} dB", PEOPLE_),
        ("a spoken sentence, one signal, level error", "planned", _heard(direct), CURVE),
        ("a spoken sentence, a band on each finger", "planned", _heard(bands), CURVE),
    ]


def _heard(spoken: Spoken) -> str:
    taken = max(finger.max_reduction_db for finger in spoken.result.rendered.limiting)
    limited = f", limiter {taken:.1f} dB"
    return f"{spoken.report.worst_rms_db:.2f} dB rms, peak {spoken.report.peak_db_sl:.0f} dB SL{limited}"
