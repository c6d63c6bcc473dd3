"""The checks of numbers that can hardly be: each by its bounds.

The slips of whole files, and the right files beside them, are in `tests/verbs/test_slips.py`.
"""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.model.description import Display
from tactuator.model.plausibility import EXPECTED, doubtful, record_doubts, swing
from tactuator.model.verdict import Outcome
from tactuator.signals.record import Record
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


def altered(travel_mm: float = 12.5, friction_v: float = 4e-3) -> Display:
    (channel,) = display().channels
    environment = replace(channel.environment, friction_v=friction_v)
    return replace(display(), channels=(replace(channel, travel_mm=travel_mm, environment=environment),))


def test_doubtful__display_with_what_cannot_be__is_not_met_and_else_not_judged() -> None:
    assert list(doubtful(altered())) == []
    assert Outcome.NOT_MET in {finding.outcome for finding in doubtful(altered(travel_mm=0.0125))}
    assert {finding.outcome for finding in doubtful(altered(friction_v=4.0))} == {Outcome.NOT_JUDGED}
