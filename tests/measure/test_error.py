"""The verdict on a measured response, against errors and confidences that are written down here."""

from __future__ import annotations

import numpy as np
import pytest

from tactuator.measure.error import error_db, response_verdict
from tactuator.model.verdict import Finding
from tactuator.signals.record import Response
from tests.synthesis.displays import channel, of

DISPLAY = of(channel().plant, 4)
NAME = DISPLAY.channels[0].name
FREQUENCY_HZ = np.array([5.0, 20.0, 100.0])


def finding(errors_db: list[float], confidence_db: list[float], load: str = "none", limited: int = 0) -> Finding:
    """The finding on a response with these errors; the first `limited` points reached a limit."""
    threshold_v = DISPLAY.channels[0].threshold_voltage(FREQUENCY_HZ)
    amplitude = 10.0 * threshold_v * 10.0 ** (np.array(errors_db) / 20.0)
    zeros, truth = np.zeros(3), np.ones(3, dtype=bool)
    response = Response(
        NAME, load, 20.0, "multisine", FREQUENCY_HZ, amplitude + 0j, np.full(3, 10.0), np.array(confidence_db),
        zeros, zeros, np.arange(3) < limited, truth, np.ones(3),
    )  # fmt: skip
    assert np.allclose(error_db(response, DISPLAY), errors_db)
    ((one,),) = (objective.findings for objective in response_verdict([response], DISPLAY).objectives)
    return one


@pytest.mark.parametrize(
    ("errors", "confidence", "outcome", "at_hz"),
    [
        ([0.2, -0.6, 0.1], [0.05, 0.0023, 0.05], "met", 20.0),
        ([0.2, -1.3, 0.1], [0.05, 0.1, 0.05], "not met", 20.0),
        ([0.2, -0.9, 0.1], [0.05, 0.2, 0.05], "not judged", 20.0),
        ([0.2, -0.9, 0.7], [0.05, 0.05, 0.4], "not judged", 100.0),
        ([1.5, -1.2, 0.1], [0.6, 0.01, 0.05], "not met", 20.0),
    ],
    ids=["within", "beyond", "left open", "left open by a lesser point", "beyond, and a greater one left open"],
)
def test_response_verdict__errors_with_confidence__the_point_that_decides(
    errors: list[float], confidence: list[float], outcome: str, at_hz: float
) -> None:
    one = finding(errors, confidence)
    assert (one.outcome.value, one.frequency_hz) == (outcome, at_hz)
    assert f"differences of 1.65 dB; {'confidence 0.0023 dB' if outcome == 'met' else 'confidence 0.'}" in one.remark


def test_response_verdict__under_a_load__told_only() -> None:
    one = finding([3.0, 0.0, 0.0], [0.01] * 3, load="finger")
    assert (one.outcome.value, one.counts) == ("not judged", False)


@pytest.mark.parametrize(
    ("limited", "words"), [(1, "at 5 Hz: a lower level"), (2, "at 5 Hz and 1 more: a lower level")]
)
def test_response_verdict__a_limit_was_reached__not_judged(limited: int, words: str) -> None:
    one = finding([0.0] * 3, [0.01] * 3, limited=limited)
    assert one.outcome.value == "not judged"
    assert one.remark.endswith(words)
