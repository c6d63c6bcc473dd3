"""What is said of fixed values that the record does not agree with."""

import numpy as np

from tactuator.identification.asked import Fixed
from tactuator.identification.standing import FixedAgainstOwn, said_of_disagreement
from tactuator.model.plant_model import PlantModel


def model(num: list[float], den: list[float]) -> PlantModel:
    free = len(num) + len(den) - 1
    return PlantModel(np.array(num), np.array(den), 0.0, np.eye(free + 1), band_hz=(0.2, 300.0))


def test_said__gain_that_a_pole_near_0_hz_evades__pole_is_named() -> None:
    free, slow = model([2740.0], [1.0, 97.0, 305.0]), 1e-6
    evading = model([2740.0, 3.0 * 305.0 * slow], np.polymul([1.0, 97.0, 305.0], [1.0, slow]).tolist())
    known = [FixedAgainstOwn(Fixed.parse("gain=3"), (9.0, 0.03))]
    said, untrusted = said_of_disagreement(known, evading, free)
    assert untrusted
    assert "since a pole at 1.6e-07 Hz evades it: the value holds below that pole alone, and not from 0.2 Hz on" in said
    assert "evades" not in said_of_disagreement(known, free, free)[0]
    assert "evades" not in said_of_disagreement(known, evading, evading)[0]
