"""The samples of a motor that moves, against a search sample by sample; constants of motors with other frictions."""

import numpy as np
import pytest

from tactuator.identification.asked import Fixed
from tactuator.identification.identify import identify
from tactuator.identification.inverse_dynamics import _APART, _SLOW, _moving, motor_estimate
from tactuator.identification.result import Identification
from tactuator.identification.validation import validate
from tactuator.signals.record import Record
from witnesses.identification.friction import said
from witnesses.identification.motors import RATE_HZ, Motors, drawn, recorded


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


@pytest.fixture(scope="module")
def motors() -> tuple[Motors, list[Record], list[Identification]]:
    """Four motors with Stribeck's and asymmetric friction, and what is identified of each."""
    rng = np.random.default_rng(5)
    own = drawn(rng, 4)
    forces, positions = recorded(own, rng, seconds=6.0, steps=10)
    records = [Record(RATE_HZ, forces[:, k], positions[:, k]) for k in range(4)]
    return own, records, [identify(record) for record in records]


def test_identify__friction_that_the_model_does_not_have__constants_inside_their_intervals(motors) -> None:
    own, _, fits = motors
    for k, found in enumerate(fits):
        assert found.model.method == "inverse dynamics"
        assert not found.distrust
        values, half_widths = said(found)
        truth = np.array([own.mass[k], own.viscous[k], own.coulomb[k]])
        assert np.all(np.abs(values - truth) <= half_widths)
        assert np.all(half_widths < [0.02, 0.5, 0.2] * truth)


def test_identify__mass_fixed_beside_friction__stands_and_the_rest_stays(motors) -> None:
    own, records, fits = motors
    bound = identify(records[0], fixed=(Fixed("mass", float(own.mass[0])),))
    assert bound.model.method == "inverse dynamics"
    assert bound.model.num[0] == pytest.approx(1.0 / own.mass[0], rel=1e-12)
    assert bound.model.covariance[0, 0] == pytest.approx(0.0, abs=1e-20)
    assert bound.friction.coulomb == pytest.approx(own.coulomb[0], abs=bound.friction.confidence)
    assert bound.model.valid_hz == fits[0].model.valid_hz
    assert not bound.distrust


def test_identify__wrong_mass_fixed_beside_friction__is_not_trusted(motors) -> None:
    own, records, _ = motors
    found = identify(records[0], fixed=(Fixed("mass", 1.3 * float(own.mass[0])),))
    assert any("off the record's own" in reason for reason in found.distrust)


def test_identify__pole_fixed_beside_friction__damping_over_mass_stands(motors) -> None:
    own, records, _ = motors
    damping = float(own.viscous[1] / own.mass[1])
    found = identify(records[1], fixed=(Fixed("pole", damping / (2.0 * np.pi)),))
    assert found.model.den[1] == pytest.approx(damping, rel=1e-9)
    assert found.model.covariance[1, 1] == pytest.approx(0.0, abs=1e-18)


def test_validate__motor_of_other_constants__half_inside_does_not_hold(motors) -> None:
    _, records, fits = motors
    other = Record(RATE_HZ, 1.05 * records[2].command, records[2].position)
    stands = validate(fits[2], other, "another")
    assert stands.inside < 0.8
    assert any("at least 80 %" in failure for failure in stands.failures)


def test_motor_estimate__hold_not_known__intervals_hold_both() -> None:
    rng = np.random.default_rng(6)
    forces, positions = recorded(drawn(rng, 1), rng, seconds=6.0, steps=4)
    held, both = (
        motor_estimate(forces[:, 0], positions[:, 0], RATE_HZ, holds=holds) for holds in ((True,), (True, False))
    )
    assert np.all(both.covariance.diagonal() >= held.covariance.diagonal() * (1.0 - 1e-9))
