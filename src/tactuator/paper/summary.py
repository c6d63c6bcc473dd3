"""What came out: summary.json with every figure of the study by name, and the table "paper / here"."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

import numpy as np

from tactuator.paper.plan import LEVELS_DB_SL
from tactuator.paper.run import PaperStudy
from tactuator.paper.steps import LOADED, UNLOADED, Spoken, worst_error_db
from tactuator.paper.thresholds import bias_and_spread_db
from tactuator.plain import picked, plain

Row = tuple[str, str, str]
"""A row of the table: what is compared, as the paper has it, as it came out here."""
_SAMPLED = ("crossover_hz", "phase_margin_deg", "gain_margin_db", "sensitivity_peak", "complementary_peak")
_CONTINUOUS = ("crossover_hz", "phase_margin_deg", "sensitivity_peak", "complementary_peak", "bandwidth_hz")
_CALIBRATED = ("gain_v_per_mm", "gain_confidence_v_per_mm", "offset_v", "linearity_percent")
_ERRORS = ("poles", "max_error_db", "rms_error_db")


def summary(study: PaperStudy) -> dict[str, Any]:
    """Return the figures as plain numbers, strings and lists; the same seed gives the same."""
    first = study.plan.display.channels[0].name
    prefilters, continuous = study.prefilters, study.loop.continuous_margins
    sampled_db = prefilters.paper_sampled.max_error_db
    fitted_db = {name: fit.max_error_db for name, fit in prefilters.fitted.items()}
    bias_db, spread_db = bias_and_spread_db(study.thresholds)
    return {
        "display": study.plan.display.name,
        "seed": study.plan.seed,
        "calibration": {
            "sensor_gain_v_per_mm": study.calibration[first].gain_v_per_mm,
            "channels": {name: picked(line, *_CALIBRATED) for name, line in study.calibration.items()},
        },
        "plant": {
            name: plain(picked(motor, "frf_error_db_max", num="estimate.num", den="estimate.den"))
            for name, motor in study.motors.items()
        },
        "loop": picked(continuous, *_CONTINUOUS)
        | {"disk_margin": continuous.disk.alpha, "sampled": picked(study.loop.sampled_margins, *_SAMPLED)},
        "prefilter": {
            "paper": picked(prefilters.paper, *_ERRORS) | {"sampled_max_error_db": sampled_db},
            "fitted": picked(prefilters.worst_fitted, *_ERRORS) | {"channels": fitted_db},
        },
        "resolution_bits": {
            name: {form: {f"{rate:g}": asdict(bits) for rate, bits in rates.items()} for form, rates in forms.items()}
            for name, forms in study.resolution.items()
        },
        "noise": _noise(study),
        "response": [asdict(point) for point in study.responses],
        "default": {"response": [asdict(point) for point in study.default]},
        "friction": {"response_without_friction": [asdict(point) for point in study.without_friction]},
        "objectives": study.verdict.document()["objectives"],
        "thresholds": _thresholds(study),
        "curve": plain(picked(study.curve, "frequency_hz", "level_db_re_1um", "standard_error_db")),
        "threshold_bias_db": bias_db,
        "threshold_spread_db": spread_db,
        "reshaped": {
            "max_error_db": study.reshaped.max_error_db,
            "response": [asdict(point) for point in study.reshaped.responses],
        },
        "speech": _speech(study.spoken),
    }


def _speech(spoken: Spoken) -> dict[str, Any]:
    return {
        "file": spoken.file.path.name,
        "duration_s": spoken.file.duration_s,
        "felt_error_db_rms": spoken.report.worst_rms_db,
        "peak_db_sl": spoken.report.peak_db_sl,
        "limited_db": {finger.finger: finger.max_reduction_db for finger in spoken.limiting},
        "notes": list(spoken.file.notes),
    }


def summary_text(study: PaperStudy) -> str:
    """Return the text of the summary as it is written to summary.json."""
    return json.dumps(summary(study), indent=1, allow_nan=False, default=float) + "\n"


def _noise(study: PaperStudy) -> list[dict[str, Any]]:
    """Return felt hum, noise and resonance by proportional gain; gain null: the designed loop."""
    heard = [(gain, felt) for gain, levels in study.noise.proportional.items() for felt in levels.runs[0][1]]
    rows = [*heard, *((None, felt) for felt in study.noise.designed.channels)]
    return [
        {
            "gain": gain,
            "channel": felt.channel,
            "mains_db_sl": dict(zip((f"{line:g}" for line in felt.line_hz), felt.line_db_sl.tolist(), strict=True)),
            "worst_band_db_sl": float(felt.band_db_sl.max()),
            "resonance_hz": felt.resonance_hz,
            "resonance_db_sl": felt.resonance_db_sl,
        }
        for gain, felt in rows
    ]


def _thresholds(study: PaperStudy) -> dict[str, list[dict[str, Any]]]:
    by_observer: dict[str, list[dict[str, Any]]] = {}
    for threshold in study.thresholds:
        row = {key: value for key, value in asdict(threshold).items() if key != "observer"}
        by_observer.setdefault(threshold.observer, []).append(row)
    return by_observer


def comparison(study: PaperStudy) -> tuple[Row, ...]:
    """Return every row, in the paper's order."""
    return (*_plant_rows(study), *_loop_rows(study), *_response_rows(study), *_person_rows(study))


def _plant_rows(study: PaperStudy) -> list[Row]:
    first = study.plan.display.channels[0].name
    gain = study.calibration[first]
    estimate = study.motors[first].estimate
    worst = max(motor.frf_error_db_max for motor in study.motors.values())
    return [
        ("sensor gain (V/mm)", "0.19898", f"{gain.gain_v_per_mm:.5f} ± {gain.gain_confidence_v_per_mm:.5f}"),
        (
            "motor P(s)",
            "2875/(s² + 94s + 290)",
            f"{estimate.num[0]:.0f}/(s² + {estimate.den[1]:.1f}s + {estimate.den[2]:.0f})",
        ),
        ("identified response, 0.4-300 Hz, three channels", "“well modeled”", f"within {worst:.2f} dB of the truth"),
    ]


def _loop_rows(study: PaperStudy) -> list[Row]:
    continuous, sampled = study.loop.continuous_margins, study.loop.sampled_margins
    judged = study.prefilters
    return [
        ("cut-off frequency (Hz)", "20", f"{continuous.crossover_hz:.2f}"),
        (
            "phase margin, continuous / sampled",
            "chart / “sufficient”",
            f"{continuous.phase_margin_deg:.1f}° / {sampled.phase_margin_deg:.1f}°",
        ),
        ("gain margin, sampled", "chart", f"{sampled.gain_margin_db:.1f} dB"),
        (
            "prefilter against the curve, 0.4-300 Hz, 4 poles",
            f"within {judged.paper.max_error_db:.1f} dB (its own F)",
            f"within {judged.worst_fitted.max_error_db:.2f} dB (fitted)",
        ),
    ]


def upper_db(value: float) -> str:
    """Return a figure of the default design, rounded up to half a decibel: its last digits hang on the processor, whose
    linear algebra rounds otherwise.
    """
    return f"{math.ceil(2.0 * value) / 2.0:.1f}"


def _response_rows(study: PaperStudy) -> list[Row]:
    levels = [level for level in LEVELS_DB_SL if level > 0.0]
    named = " / ".join(f"{level:g}" for level in levels)
    rows = []
    printed = ((study.responses, "the paper's design", "{:.2f}".format), (study.default, "the default", upper_db))
    for points, design, spell in printed:
        for load, words in ((UNLOADED, "free"), (LOADED, "under a finger")):
            errors = " / ".join(spell(worst_error_db(points, load, level)) for level in levels)
            paper = {UNLOADED: "“closely”", LOADED: "“essentially the same”"}[load]
            rows.append((f"felt minus asked, {words}, {named} dB SL: {design}", paper, f"within {errors} dB"))
    zero = [point for point in study.responses if (point.load, point.level_db_sl) == (UNLOADED, 0.0)]
    low = min(point.unpredicted_db for point in zero if point.frequency_hz <= 50.0)
    smooth = max(abs(point.unpredicted_db) for point in study.without_friction if point.frequency_hz <= 50.0)
    here = f"friction takes up to {-low:.2f} dB below 50 Hz (without it {smooth:.1f} dB)"
    rows.append(("felt minus predicted at 0 dB SL, free", "deviations at a few frequencies", here))
    for objective in study.verdict.objectives:
        rows.append((f"objective {objective.number}", "asked", objective.outcome.value))
    return rows


def _person_rows(study: PaperStudy) -> list[Row]:
    bias, spread = bias_and_spread_db(study.thresholds)
    trials = np.array([threshold.trials for threshold in study.thresholds])
    low, high = np.percentile(trials, [5, 95])
    library = study.plan.display.channels[0].threshold.curve
    difference = study.curve.level_db_re_1um - library.level_db_re_1um_at(study.curve.frequency_hz)
    speech = study.spoken.report
    return [
        ("trials a run", "60-90", f"{trials.mean():.0f} (5-95 %: {low:.0f}-{high:.0f})"),
        (
            "measured minus true threshold of the simulated subjects",
            "unknown",
            f"{bias:+.1f} dB, standard deviation {spread:.1f} dB",
        ),
        (
            "new curve against the library's",
            "higher at low, lower at high frequencies",
            f"{difference[0]:+.1f} dB at {study.curve.frequency_hz[0]:g} Hz, "
            f"{difference[-1]:+.1f} dB at {study.curve.frequency_hz[-1]:g} Hz",
        ),
        ("prefilter reshaped to the new curve", "future work", f"within {study.reshaped.max_error_db:.2f} dB"),
        (
            "speech on three fingers, felt against asked",
            "future work",
            f"{speech.worst_rms_db:.2f} dB rms, peak {speech.peak_db_sl:.0f} dB SL",
        ),
    ]
