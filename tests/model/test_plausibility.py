"""The checks of numbers that can hardly be: each by its bounds, and a response's units by its phase.

The slips of whole files, and the right files beside them, are in `tests/verbs/test_slips.py`.
"""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.model.description import Display
from tactuator.model.plausibility import EXPECTED, doubtful, record_doubts, response_doubts, swing
from tactuator.model.verdict import Outcome
from tactuator.signals.record import FrequencyResponse, Record
from tests.measure.loops import display


@pytest.mark.parametrize("name", EXPECTED)
def test_check__on_either_side_of_each_bound__doubts_beyond_it_alone_and_names_a_slip(name: str) -> None:
    check = EXPECTED[name]
    for bound, outwards, slip in ((check.low, -1.0, check.below), (check.high, 1.0, check.above)):
        if not np.isfinite(bound):
            assert slip == ""
            continue
        size = 1e-6 * max(abs(bound), 1e-3)
        assert list(check.doubts(bound)) == list(check.doubts(bound - outwards * size)) == []
        (doubt,) = check.doubts(bound + outwards * size)
        assert doubt.bound == bound
        if slip or bound != 0.0:
            assert slip
            assert slip in str(doubt)


def test_record__in_no_unit_or_another__has_no_doubts_about_volts() -> None:
    values = np.sin(np.arange(1000.0))
    assert record_doubts(Record(1000.0, values, 1e6 * values, "", "um")) == ()
    assert [doubt.expected for doubt in record_doubts(Record(1000.0, values, 1e6 * values))] == [EXPECTED["position"]]


def test_swing__of_a_signal_far_off_zero__is_its_amplitude() -> None:
    assert swing(100.0 + 2.0 * np.sin(np.arange(10_000.0))) == pytest.approx(2.0, rel=1e-4)


def beam(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A response of one to four modes of any gain, with a dead time of up to a period of the highest frequency."""
    low = 10.0 ** rng.uniform(-0.5, 1.5)
    hertz = np.geomspace(low, 10.0 ** rng.uniform(1.3, 2.5) * low, int(rng.integers(25, 120)))
    s, value = 2j * np.pi * hertz, np.zeros(hertz.size, dtype=complex)
    for _ in range(int(rng.integers(1, 5))):
        w, damping = 2.0 * np.pi * np.exp(rng.uniform(*np.log(hertz[[0, -1]]))), 10.0 ** rng.uniform(-1.5, 0.0)
        value += rng.uniform(0.2, 1.0) * w**2 / (s**2 + 2.0 * damping * w * s + w**2)
    value *= 10.0 ** rng.uniform(-3.0, 1.5) * rng.choice([1.0, 1.0, -1.0]) * s ** int(rng.integers(0, 2))
    late = rng.uniform(0.0, 0.5) / hertz[-1]
    return hertz, value * np.exp(-s * late) * (1.0 + 0.01 * rng.standard_normal(hertz.size))


def given(hertz: np.ndarray, size: np.ndarray, phase: np.ndarray) -> FrequencyResponse:
    return FrequencyResponse(hertz, size, phase, np.full(hertz.size, 0.01))


def test_response__of_right_units__is_never_doubted_and_of_radians_for_degrees_nearly_always() -> None:
    rng, wrong, caught, tried = np.random.default_rng(11), [], 0, 0
    for _ in range(60):
        hertz, value = beam(rng)
        phase = np.unwrap(np.angle(value))
        try:
            wrong += response_doubts(given(hertz, np.abs(value), phase))
        except BadInput:
            continue
        if np.ptp(phase) > 2.0:
            tried += 1
            caught += bool(response_doubts(given(hertz, np.abs(value), phase * np.pi / 180.0)))
    assert wrong == []
    assert caught > 0.8 * tried > 20.0


def altered(travel_mm: float = 12.5, friction_v: float = 4e-3) -> Display:
    (channel,) = display().channels
    environment = replace(channel.environment, friction_v=friction_v)
    return replace(display(), channels=(replace(channel, travel_mm=travel_mm, environment=environment),))


def test_doubtful__display_with_what_cannot_be__is_not_met_and_else_not_judged() -> None:
    assert list(doubtful(altered())) == []
    assert Outcome.NOT_MET in {finding.outcome for finding in doubtful(altered(travel_mm=0.0125))}
    assert {finding.outcome for finding in doubtful(altered(friction_v=4.0))} == {Outcome.NOT_JUDGED}
