"""What is said of fixed values that the record does not agree with."""

import numpy as np
import pytest

from tactuator.identification.asked import Fixed
from tactuator.identification.standing import FixedAgainstOwn, weighed_against_own
from tactuator.model.plant_model import PlantModel


def model(num: list[float], den: list[float]) -> PlantModel:
    free = len(num) + len(den) - 1
    return PlantModel(np.array(num), np.array(den), 0.0, np.eye(free + 1), band_hz=(0.2, 300.0))


def test_said__gain_that_a_pole_near_0_hz_evades__pole_is_named() -> None:
    free, slow = model([2740.0], [1.0, 97.0, 305.0]), 1e-6
    evading = model([2740.0, 3.0 * 305.0 * slow], np.polymul([1.0, 97.0, 305.0], [1.0, slow]).tolist())
    known = [FixedAgainstOwn(Fixed.parse("gain=3"), (9.0, 0.03))]
    off, apart = weighed_against_own(known, evading, free)
    assert off.refuses
    assert off.value == pytest.approx(200.0)
    assert apart.where == "a pole at 1.6e-07 Hz evades a value at 0 Hz"
    assert not any("evades" in row.where for same in (free, evading) for row in weighed_against_own(known, same, same))
