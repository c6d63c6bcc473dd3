"""The same samples under another rate label or in other units are the same mechanism."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.identification.identify import identify
from tactuator.signals.record import Record
from tests.identification.motors import motor
from tests.identification.others import Plant, band_limited

PLANT = Plant(np.zeros(0), np.array([-42.65 + 435.0j, -42.65 - 435.0j]), 2.0, 1e-3)
SAMPLES = band_limited(PLANT, np.random.default_rng(7), 610.35, 6.0, 40.0)
MOTOR = motor(np.random.default_rng(8), 10.0)[1:]
BASE = identify(Record(610.35, *SAMPLES))
MOTOR_BASE = identify(Record(1000.0, *MOTOR))
factors = st.floats(-3.0, 3.0).map(lambda power: 10.0**power)


@settings(max_examples=4, deadline=None)
@given(factors, factors, factors)
def test_identify__other_label_and_units__same_scaled_model(faster: float, command: float, position: float) -> None:
    record = Record(610.35 * faster, command * SAMPLES[0], position * SAMPLES[1])
    found = identify(record)
    assert (found.order, found.model.num.size) == (BASE.order, BASE.model.num.size)
    assert found.between.hold == BASE.between.hold == "band-limited"
    frequency = np.array([5.0, 60.0, 150.0])
    same = BASE.model.response(frequency) * position / command
    np.testing.assert_allclose(found.model.response(frequency * faster), same, rtol=1e-3)
    assert abs(found.model.delay_s * faster / BASE.model.delay_s - 1.0) < 1e-2


@settings(max_examples=4, deadline=None)
@given(factors, factors, factors)
def test_identify__other_label_and_units_of_a_motor__same_friction(faster: float, command: float, place: float) -> None:
    found = identify(Record(1000.0 * faster, command * MOTOR[0], place * MOTOR[1]))
    assert found.friction is not None
    assert MOTOR_BASE.friction is not None
    assert abs(found.friction.coulomb / command / MOTOR_BASE.friction.coulomb - 1.0) < 1e-6
    assert abs(found.model.den[1] / faster / MOTOR_BASE.model.den[1] - 1.0) < 1e-6
    assert abs(found.model.num[0] / (faster**2 * place / command) / MOTOR_BASE.model.num[0] - 1.0) < 1e-6
