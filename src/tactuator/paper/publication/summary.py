"""The file summary.json: every figure of the study, by name."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from tactuator.paper.run import PaperStudy
from tactuator.paper.thresholds import bias_and_spread_db


def summary(study: PaperStudy) -> dict[str, Any]:
    """Return the figures as plain numbers, strings and lists; the same seed gives the same."""
    first = study.plan.display.channels[0].name
    error = study.curve.standard_error_db
    return {
        "display": study.plan.display.name,
        "seed": study.plan.seed,
        "calibration": {
            "sensor_gain_v_per_mm": study.calibration[first].gain_v_per_mm,
            "channels": {name: _calibration(study, name) for name in study.calibration},
        },
        "plant": {
            name: {
                "num": motor.estimate.num.tolist(),
                "den": motor.estimate.den.tolist(),
                "frf_error_db_max": motor.frf_error_db_max,
            }
            for name, motor in study.motors.items()
        },
        "loop": _loop(study),
        "prefilter": _prefilter(study),
        "resolution_bits": {
            name: {form: {f"{rate:g}": asdict(bits) for rate, bits in rates.items()} for form, rates in forms.items()}
            for name, forms in study.resolution.items()
        },
        "noise": _noise(study),
        "response": [asdict(point) for point in study.responses],
        "friction": {"response_without_friction": [asdict(point) for point in study.without_friction]},
        "objectives": study.verdict.document()["objectives"],
        "thresholds": _thresholds(study),
        "curve": {
            "frequency_hz": study.curve.frequency_hz.tolist(),
            "level_db_re_1um": study.curve.level_db_re_1um.tolist(),
            "standard_error_db": None if error is None else error.tolist(),
        },
        "threshold_bias_db": bias_and_spread_db(study.thresholds)[0],
        "threshold_spread_db": bias_and_spread_db(study.thresholds)[1],
        "reshaped": {
            "max_error_db": study.reshaped.max_error_db,
            "response": [asdict(point) for point in study.reshaped.responses],
        },
        "speech": {
            "file": study.spoken.file.path.name,
            "duration_s": study.spoken.file.duration_s,
            "felt_error_db_rms": study.spoken.report.worst_rms_db,
            "peak_db_sl": study.spoken.report.peak_db_sl,
            "limited_db": {one.finger: one.max_reduction_db for one in study.spoken.limiting},
            "notes": list(study.spoken.file.notes),
        },
    }


def summary_text(study: PaperStudy) -> str:
    """Return the text of the summary as it is written to summary.json."""
    return json.dumps(summary(study), indent=1, allow_nan=False, default=float) + "\n"


def _calibration(study: PaperStudy, name: str) -> dict[str, float]:
    found = study.calibration[name]
    return {
        "gain_v_per_mm": found.gain_v_per_mm,
        "gain_confidence_v_per_mm": found.gain_confidence_v_per_mm,
        "offset_v": found.offset_v,
        "linearity_percent": found.linearity_percent,
    }


def _loop(study: PaperStudy) -> dict[str, Any]:
    continuous, sampled = study.loop.continuous_margins, study.loop.sampled_margins
    return {
        "crossover_hz": continuous.crossover_hz,
        "phase_margin_deg": continuous.phase_margin_deg,
        "sensitivity_peak": continuous.sensitivity_peak,
        "complementary_peak": continuous.complementary_peak,
        "bandwidth_hz": continuous.bandwidth_hz,
        "disk_margin": continuous.disk.alpha,
        "sampled": {
            "crossover_hz": sampled.crossover_hz,
            "phase_margin_deg": sampled.phase_margin_deg,
            "gain_margin_db": sampled.gain_margin_db,
            "sensitivity_peak": sampled.sensitivity_peak,
            "complementary_peak": sampled.complementary_peak,
        },
    }


def _prefilter(study: PaperStudy) -> dict[str, Any]:
    judged = study.prefilters
    worst = judged.worst_fitted
    return {
        "paper": {
            "poles": judged.paper.poles,
            "max_error_db": judged.paper.max_error_db,
            "rms_error_db": judged.paper.rms_error_db,
            "sampled_max_error_db": judged.paper_sampled.max_error_db,
        },
        "fitted": {
            "poles": worst.poles,
            "max_error_db": worst.max_error_db,
            "rms_error_db": worst.rms_error_db,
            "channels": {name: fit.max_error_db for name, fit in judged.fitted.items()},
        },
    }


def _noise(study: PaperStudy) -> list[dict[str, Any]]:
    """Return felt hum, noise and resonance by proportional gain; gain null: the designed loop."""
    heard = [(gain, one) for gain, channels in study.noise.proportional.items() for one in channels]
    rows = [*heard, *((None, one) for one in study.noise.designed)]
    return [
        {
            "gain": gain,
            "channel": one.channel,
            "mains_db_sl": dict(zip((f"{line:g}" for line in one.line_hz), one.line_db_sl.tolist(), strict=True)),
            "worst_band_db_sl": float(one.band_db_sl.max()),
            "resonance_hz": one.resonance_hz,
            "resonance_db_sl": one.resonance_db_sl,
        }
        for gain, one in rows
    ]


def _thresholds(study: PaperStudy) -> dict[str, list[dict[str, Any]]]:
    by_observer: dict[str, list[dict[str, Any]]] = {}
    for one in study.thresholds:
        row = {key: value for key, value in asdict(one).items() if key != "observer"}
        by_observer.setdefault(one.observer, []).append(row)
    return by_observer
