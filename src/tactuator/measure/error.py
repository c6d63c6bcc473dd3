"""The measured level against the level that was asked: the error in dB, and objective i judged by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.display.description import Display
from tactuator.display.verdict import Finding, Outcome, Verdict, compared, verdict_of
from tactuator.signals.decibels import db
from tactuator.signals.response import Response


def error_db(response: Response, display: Display) -> FloatArray:
    """Return the sensation level measured less the level asked, dB, (m,)."""
    threshold_v = display.channel(response.channel).threshold_voltage(response.frequency_hz)
    return db(response.magnitude_v / (response.reference * threshold_v))


def response_verdict(responses: Sequence[Response], display: Display) -> Verdict:
    """Return the verdict on objective i of every response: not met where the error passes flatness_db by more than its
    confidence, not judged where the confidence leaves it open, a limit was reached, or a load was on."""
    return verdict_of([_finding(one, display) for one in responses])


def _finding(response: Response, display: Display) -> Finding:
    error, allowed = np.abs(error_db(response, display)), display.objectives.flatness_db
    worst = int(np.argmax(error))
    value, at = float(error[worst]), float(response.frequency_hz[worst])
    found = compared("i", response.channel, response.load, "error of |H|", value, allowed, "dB", at)
    if response.load != "none":
        told = "told only: what a load changes is objective iv's"
        return replace(found, outcome=Outcome.NOT_JUDGED, remark=told, counts=False)
    doubt = float(response.confidence_db[worst])
    beside = f"confidence {doubt:.2f} dB"
    if bool(np.any(response.saturated)):
        limited = response.frequency_hz[response.saturated]
        remark = (
            f"{beside}; the command was limited at {limited.min():.4g} Hz and {limited.size - 1} more: a lower level"
        )
        return replace(found, outcome=Outcome.NOT_JUDGED, remark=remark)
    if np.any((error <= allowed) & (error + response.confidence_db > allowed)) and found.outcome is Outcome.MET:
        return replace(found, outcome=Outcome.NOT_JUDGED, remark=f"{beside} leaves it open: a smaller --confidence-db")
    if found.outcome is Outcome.NOT_MET and value - doubt <= allowed:
        return replace(found, outcome=Outcome.NOT_JUDGED, remark=f"{beside} leaves it open: a smaller --confidence-db")
    return replace(found, remark=beside)
