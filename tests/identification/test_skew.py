"""Channels that are read one after the other: the motion is made here on a finer grid by SciPy."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from tactuator.identification.identify import identify
from tactuator.identification.validation import validate
from tactuator.signals.record import Record

RATE_HZ, FINE, COUNT = 4000.0, 25, 24000
NUM, DEN = np.array([(120.0 * np.pi) ** 2]), np.array([1.0, 72.0 * np.pi, (120.0 * np.pi) ** 2])
Array = NDArray[np.float64]


def sweep() -> Array:
    time = np.arange(COUNT) / RATE_HZ
    return np.asarray(signal.chirp(time, 0.5, time[-1], 500.0, "logarithmic"))


def skewed(command: Array, steps: int) -> Record:
    """The position that answers a held command, read `steps` of 10 us later than the command."""
    a, b, c, _, _ = signal.cont2discrete(signal.tf2ss(NUM, DEN), 1.0 / (RATE_HZ * FINE), "zoh")
    b_, a_ = signal.ss2tf(a, b, c, np.zeros((1, 1)))
    motion = signal.lfilter(b_.ravel(), a_, np.repeat(command, FINE))
    position = np.roll(motion, -steps)[::FINE]
    return Record(RATE_HZ, command, position + 3e-4 * np.random.default_rng(6).standard_normal(command.size))


COMMANDS = {"sweep": sweep(), "levels": np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, COUNT), 40)[:COUNT]}


@pytest.mark.parametrize(
    ("name", "steps"), [("sweep", -6), ("sweep", -1), ("sweep", 2), ("sweep", 4), ("levels", -6), ("levels", 4)]
)
def test_identify__channels_read_one_after_the_other__is_a_dead_time_and_no_zero(name: str, steps: int) -> None:
    found = identify(skewed(COMMANDS[name], steps), friction=False)
    late_s, half_s = -1e-5 * steps, found.model.confidence()["delay_s"]
    skew_s = found.model.record.get("skew_s", 0.0)
    assert found.model.delay_s - skew_s == pytest.approx(late_s, abs=1.3 * half_s + 1e-8)
    assert (found.order, found.model.num.size, found.holds) == (2, 1, True)
    assert found.model.delay_s >= 0.0
    assert any("likely the position was read" in remark for remark in found.remarks) == (steps > 0)
    hertz = np.geomspace(*found.model.valid_hz, 60)
    s = 2j * np.pi * hertz
    off = np.log(found.model.response(hertz) * np.exp(s * max(late_s, 0.0)) * np.polyval(DEN, s) / NUM[0])
    assert np.max(np.abs(off.real)) * 8.686 < 0.1
    assert np.max(np.abs(np.degrees(off.imag))) < 1.0


def test_validate__record_of_the_same_channels__is_judged_with_their_skew() -> None:
    found = identify(skewed(COMMANDS["sweep"], 4), friction=False)
    assert not validate(found, skewed(COMMANDS["levels"], 4)).failures


def test_identify__position_in_a_noisy_loop__is_not_taken_to_be_read_later() -> None:
    rng, command, position = np.random.default_rng(2), np.zeros(COUNT // 2), np.zeros(COUNT // 2)
    b, a, _ = signal.cont2discrete((NUM, DEN), 1.0 / RATE_HZ, "zoh")
    dither = 0.3 * np.repeat(np.sign(rng.standard_normal(command.size)), 8)[: command.size]
    noise, true = 0.01 * rng.standard_normal(command.size), np.zeros(command.size)
    for k in range(command.size):
        past = (command[max(k - 1, 0)] * (k > 0), command[max(k - 2, 0)] * (k > 1))
        true[k] = b[0, 1] * past[0] + b[0, 2] * past[1] - a[1] * true[k - 1] - a[2] * true[k - 2]
        position[k] = true[k] + noise[k]
        command[k] = dither[k] - 2.0 * position[k]
    found = identify(Record(RATE_HZ, command, position), order=2, friction=False)
    assert "skew_s" not in found.model.record
    assert found.tests.feedback
