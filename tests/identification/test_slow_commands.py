"""Commands that are logged more slowly than the position, and commands that are held as long."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from tactuator.errors import BadInput
from tactuator.identification.alignment import moved_between
from tactuator.identification.identify import identify
from tactuator.signals.record import Record

RATE_HZ = 2000.0
COUNT = 8000
NUM, DEN = np.array([0.5 * (120.0 * np.pi) ** 2]), np.array([1.0, 72.0 * np.pi, (120.0 * np.pi) ** 2])
HERTZ = np.geomspace(2.0, 150.0, 40)
Array = NDArray[np.float64]


def position(command: Array) -> Array:
    b, a, _ = signal.cont2discrete((NUM, DEN), 1.0 / RATE_HZ, "zoh")
    noise = 2e-4 * np.random.default_rng(3).standard_normal(command.size)
    return np.asarray(signal.lfilter(b.ravel(), a, command) + noise)


def smooth() -> Array:
    low = signal.butter(4, 60.0, fs=RATE_HZ, output="sos")
    return np.asarray(5.0 * signal.sosfiltfilt(low, np.random.default_rng(1).standard_normal(COUNT)))


def every(command: Array, many: int) -> Array:
    return np.repeat(command[::many], many)[: command.size]


@pytest.mark.parametrize("many", [2, 4, 16])
def test_identify__smooth_command_logged_more_slowly__is_refused_with_what_helps(many: int) -> None:
    moved = smooth()
    with pytest.raises(BadInput, match=rf"repeats its values, {many} samples each.*`hold` zero-order"):
        identify(Record(RATE_HZ, every(moved, many), position(moved)), order=2, friction=False)


@pytest.mark.parametrize(
    "command",
    [
        every(smooth(), 8),
        every(np.sign(np.random.default_rng(2).standard_normal(COUNT)), 8),
        np.repeat(np.random.default_rng(4).uniform(-1.0, 1.0, COUNT), 25)[:COUNT],
    ],
    ids=["smooth", "binary", "levels"],
)
def test_identify__command_that_was_held__is_modelled_as_held(command: Array) -> None:
    found = identify(Record(RATE_HZ, command, position(command)), order=2, friction=False)
    s = 2j * np.pi * HERTZ
    true = np.polyval(NUM, s) / np.polyval(DEN, s)
    assert np.max(np.abs(20.0 * np.log10(np.abs(found.model.response(HERTZ) / true)))) < 0.1
    assert found.holds


def test_moved_between__command_that_rests_or_has_few_codes__is_left_alone() -> None:
    resting = np.where(np.arange(COUNT) < COUNT // 2, smooth(), 0.0)
    assert moved_between(resting) is None
    assert moved_between(np.round(2.0 * smooth())) is None
    np.testing.assert_allclose(moved_between(every(smooth(), 4))[: COUNT - 4], smooth()[: COUNT - 4], atol=0.05)  # type: ignore[index]
