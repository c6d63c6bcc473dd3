"""The samples of a motor that moves: against a search sample by sample."""

import numpy as np
import pytest

from tactuator.identification.inverse_dynamics import _APART, _SLOW, _moving


@pytest.mark.parametrize(("count", "corner"), [(5000, 3.0), (4000, 40.0), (997, 20.0)])
def test_moving__samples_that_count__are_far_from_every_slow_one(count: int, corner: float) -> None:
    rate_hz = 1000.0
    velocity = np.random.default_rng(count).standard_normal(count).cumsum()
    slow = np.flatnonzero(np.abs(velocity) < _SLOW * velocity.std())
    width, ends = int(_APART * rate_hz / corner), int(2.0 * rate_hz / corner)
    places = range(ends, count - ends, max(int(rate_hz / (4.0 * corner)), 1))
    expected = [k for k in places if not np.any(np.abs(slow - k) <= width)]
    assert len(expected) > 0
    assert _moving(velocity, rate_hz, corner).tolist() == expected


def test_moving__nothing_slow__every_place_counts() -> None:
    assert _moving(np.tile([1.0, -1.0], 500), 1000.0, 20.0).size == 67
