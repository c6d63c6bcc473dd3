"""The same samples under another rate label or in other units are the same mechanism."""

import numpy as np
import pytest

from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.signals.record import Record
from tests.identification.motors import motor
from tests.identification.others import Plant, band_limited

PLANT = Plant(np.zeros(0), np.array([-42.65 + 435.0j, -42.65 - 435.0j]), 2.0, 1e-3)


FACTORS = [(1e3, 1e-3, 30.0), pytest.param(0.01, 250.0, 1e3, marks=pytest.mark.slow)]
"""Of the rate, of the command's unit and of the position's."""


@pytest.fixture(scope="module", params=["resonator", "motor"])
def known(request: pytest.FixtureRequest) -> tuple[Record, Identification]:
    """A record, of a motor with friction or of none, and what is identified of it as it is."""
    if request.param == "motor":
        record = Record(1000.0, *motor(np.random.default_rng(8), 7.0)[1:])
    else:
        record = Record(610.35, *band_limited(PLANT, np.random.default_rng(7), 610.35, 4.0, 40.0))
    return record, identify(record)


@pytest.mark.parametrize(("faster", "command", "position"), FACTORS)
def test_identify__other_label_and_units__same_scaled_model(known, faster, command, position) -> None:
    record, was = known
    found = identify(Record(record.rate_hz * faster, command * record.command, position * record.position))
    assert (found.order, found.model.num.size) == (was.order, was.model.num.size)
    assert found.between.hold == was.between.hold
    frequency = np.array([5.0, 60.0, 150.0])
    same = was.model.response(frequency) * position / command
    np.testing.assert_allclose(found.model.response(frequency * faster), same, rtol=1e-3)
    assert found.model.delay_s * faster == pytest.approx(was.model.delay_s, rel=1e-2)
    if was.friction is not None:
        assert found.friction.coulomb == pytest.approx(command * was.friction.coulomb, rel=1e-6)
