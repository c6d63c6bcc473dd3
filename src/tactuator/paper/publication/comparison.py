"""The table "paper / here": what the paper reports and what this run gave, row by row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.paper.plan import LEVELS_DB_SL
from tactuator.paper.response import LOADED, UNLOADED, worst_error_db
from tactuator.paper.run import PaperStudy
from tactuator.paper.thresholds import bias_and_spread_db


@dataclass(frozen=True)
class Row:
    """A row of the table: what is compared, as the paper has it, as it came out here."""

    what: str
    paper: str
    here: str


def comparison(study: PaperStudy) -> tuple[Row, ...]:
    """Return every row, in the paper's order."""
    return (*_plant_rows(study), *_loop_rows(study), *_response_rows(study), *_person_rows(study))


def _plant_rows(study: PaperStudy) -> list[Row]:
    first = study.plan.display.channels[0].name
    gain = study.calibration[first]
    estimate = study.motors[first].estimate
    worst = max(motor.frf_error_db_max for motor in study.motors.values())
    return [
        Row(
            "sensor gain (V/mm)",
            "0.19898",
            f"{gain.gain_v_per_mm:.5f} ± {gain.gain_confidence_v_per_mm:.5f}",
        ),
        Row(
            "motor P(s)",
            "2875/(s² + 94s + 290)",
            f"{estimate.num[0]:.0f}/(s² + {estimate.den[1]:.1f}s + {estimate.den[2]:.0f})",
        ),
        Row("identified response, 0.4-300 Hz, three channels", "“well modeled”", f"within {worst:.2f} dB of the truth"),
    ]


def _loop_rows(study: PaperStudy) -> list[Row]:
    continuous, sampled = study.loop.continuous_margins, study.loop.sampled_margins
    judged = study.prefilters
    return [
        Row("cut-off frequency (Hz)", "20", f"{continuous.crossover_hz:.2f}"),
        Row(
            "phase margin, continuous / sampled",
            "chart / “sufficient”",
            f"{continuous.phase_margin_deg:.1f}° / {sampled.phase_margin_deg:.1f}°",
        ),
        Row("gain margin, sampled", "chart", f"{sampled.gain_margin_db:.1f} dB"),
        Row(
            "prefilter against the curve, 0.4-300 Hz, 4 poles",
            f"within {judged.paper.max_error_db:.1f} dB (its own F)",
            f"within {judged.worst_fitted.max_error_db:.2f} dB (fitted)",
        ),
    ]


def _response_rows(study: PaperStudy) -> list[Row]:
    levels = [level for level in LEVELS_DB_SL if level > 0.0]
    rows = []
    for load, words in ((UNLOADED, "unloaded"), (LOADED, "with a finger")):
        errors = " / ".join(f"{worst_error_db(study.responses, load, level):.2f}" for level in levels)
        paper = "“closely”" if load == UNLOADED else "“essentially the same”"
        named = " / ".join(f"{level:g}" for level in levels)
        rows.append(Row(f"response against expected, {words}, {named} dB SL", paper, f"within {errors} dB"))
    zero = [one for one in study.responses if (one.load, one.level_db_sl) == (UNLOADED, 0.0)]
    low = min(one.error_db for one in zero if one.frequency_hz <= 50.0)
    smooth = max(abs(one.error_db) for one in study.without_friction if one.frequency_hz <= 50.0)
    here = f"down to {low:.2f} dB below 50 Hz: friction (without it within {smooth:.2f} dB)"
    rows.append(Row("response at 0 dB SL, unloaded", "deviations at a few frequencies", here))
    for objective in study.verdict.objectives:
        rows.append(Row(f"objective {objective.number}", "asked", objective.outcome.value))
    return rows


def _person_rows(study: PaperStudy) -> list[Row]:
    bias, spread = bias_and_spread_db(study.thresholds)
    trials = np.array([one.trials for one in study.thresholds])
    low, high = np.percentile(trials, [5, 95])
    library = study.plan.display.channels[0].threshold.curve
    difference = study.curve.level_db_re_1um - library.level_db_re_1um_at(study.curve.frequency_hz)
    speech = study.spoken.report
    return [
        Row("trials a run", "60-90", f"{trials.mean():.0f} (5-95 %: {low:.0f}-{high:.0f})"),
        Row("threshold less the observers' truth", "unknown", f"{bias:+.2f} dB, standard deviation {spread:.2f} dB"),
        Row(
            "new curve against the library's",
            "higher at low, lower at high frequencies",
            f"{difference[0]:+.1f} dB at {study.curve.frequency_hz[0]:g} Hz, "
            f"{difference[-1]:+.1f} dB at {study.curve.frequency_hz[-1]:g} Hz",
        ),
        Row("prefilter reshaped to the new curve", "future work", f"within {study.reshaped.max_error_db:.2f} dB"),
        Row(
            "speech on three fingers, felt against asked",
            "future work",
            f"{speech.worst_rms_db:.2f} dB rms, peak {speech.peak_db_sl:.0f} dB SL",
        ),
    ]


def markdown(rows: tuple[Row, ...]) -> str:
    """Return the rows as a Markdown table."""
    head = "| what | paper (2004) | here |\n|---|---|---|\n"
    return head + "".join(f"| {row.what} | {row.paper} | {row.here} |\n" for row in rows)
