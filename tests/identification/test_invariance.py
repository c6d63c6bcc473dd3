"""The same samples under another rate label or in other units are the same mechanism."""

from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.identification.identify import identify
from tactuator.signals.record import Record
from tests.identification.motors import motor
from tests.identification.others import Plant, band_limited

PLANT = Plant(np.zeros(0), np.array([-42.65 + 435.0j, -42.65 - 435.0j]), 2.0, 1e-3)


@cache  # not while the tests are collected, which every worker does
def base():
    """A record's samples, and what is identified from them as they are."""
    samples = band_limited(PLANT, np.random.default_rng(7), 610.35, 6.0, 40.0)
    return samples, identify(Record(610.35, *samples))


@cache
def motor_base():
    """The same of a motor with friction."""
    samples = motor(np.random.default_rng(8), 10.0)[1:]
    return samples, identify(Record(1000.0, *samples))


factors = st.floats(-3.0, 3.0).map(lambda power: 10.0**power)


@settings(max_examples=4, deadline=None)
@given(factors, factors, factors)
def test_identify__other_label_and_units__same_scaled_model(faster: float, command: float, position: float) -> None:
    samples, known = base()
    found = identify(Record(610.35 * faster, command * samples[0], position * samples[1]))
    assert (found.order, found.model.num.size) == (known.order, known.model.num.size)
    assert found.between.hold == known.between.hold == "band-limited"
    frequency = np.array([5.0, 60.0, 150.0])
    same = known.model.response(frequency) * position / command
    np.testing.assert_allclose(found.model.response(frequency * faster), same, rtol=1e-3)
    assert abs(found.model.delay_s * faster / known.model.delay_s - 1.0) < 1e-2


@settings(max_examples=4, deadline=None)
@given(factors, factors, factors)
def test_identify__other_label_and_units_of_a_motor__same_friction(faster: float, command: float, place: float) -> None:
    samples, known = motor_base()
    found = identify(Record(1000.0 * faster, command * samples[0], place * samples[1]))
    assert found.friction is not None
    assert known.friction is not None
    assert abs(found.friction.coulomb / command / known.friction.coulomb - 1.0) < 1e-6
    assert abs(found.model.den[1] / faster / known.model.den[1] - 1.0) < 1e-6
    assert abs(found.model.num[0] / (faster**2 * place / command) / known.model.num[0] - 1.0) < 1e-6
