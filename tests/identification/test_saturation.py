"""An amplifier that saturates behind the recorded command is told; a linear mechanism is not accused."""

import numpy as np
from scipy import signal

from tactuator.identification.identify import identify
from tactuator.identification.trust import DISTORTION
from tactuator.signals.record import Record
from tests.identification.others import Plant, band_limited, held

PLANT = Plant(np.zeros(0), np.array([-42.65 + 435.0j, -42.65 - 435.0j]), 2.0, 0.0)
RATE_HZ = 1000.0


def said(record: Record) -> bool:
    return any(row.value > 0.0 for row in identify(record, order=2).model.trust if row.name == DISTORTION.name)


def test_identify__command_recorded_before_it_saturates__is_told() -> None:
    rng = np.random.default_rng(3)
    command = rng.standard_normal(8000)
    num, den, _ = signal.cont2discrete(PLANT.polynomials(), 1.0 / RATE_HZ)
    position = signal.lfilter(num[0], den, np.clip(command, -1.5, 1.5))
    assert said(Record(RATE_HZ, command, position + 0.01 * position.std() * rng.standard_normal(command.size)))


def test_identify__linear_mechanism_behind_filters_and_in_a_loop_too__is_not_accused_of_saturating() -> None:
    assert not said(Record(RATE_HZ, *held(PLANT, np.random.default_rng(0), RATE_HZ, 8.0, 40.0)))
    assert not said(Record(RATE_HZ, *band_limited(PLANT, np.random.default_rng(5), RATE_HZ, 8.0, 30.0, True)))
