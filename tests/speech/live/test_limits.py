"""The live limiter: its limits at the finger ports of the simulated display, whatever comes."""

import numpy as np
import pytest

from tactuator.speech.live.limiter import LiveLimiter
from tests.speech.test_limiter import SIGNALS, on_the_display

BLOCK = 16
TOGGLED = np.sign(np.sin(2 * np.pi * 30 * np.arange(56000) / 4000)) * (np.arange(56000) // 700 % 2)


def limited(controller, reference):
    limiter = LiveLimiter(controller, BLOCK)
    rows = np.asarray(reference)[:, None] * np.ones((1, 3))
    return np.concatenate([limiter.push(block) for block in np.split(rows, len(rows) // BLOCK)]), limiter


@pytest.mark.parametrize("load", [None, "finger"])
@pytest.mark.parametrize(
    "signal", [*SIGNALS.values(), TOGGLED], ids=[*(name.replace(" ", "-") for name in SIGNALS), "toggled"]
)
def test_live_limiter__anything__display_within_comfort_travel_and_command(controller, signal, load):
    ending = np.zeros(400)  # a stream fades out before the limiter: an end cut off behind it is not its own
    out, _ = limited(controller, np.concatenate([3000.0 * signal[16000:28000], ending]))
    felt, displacement, command, saturated = on_the_display(controller, out, load)
    assert 20 * np.log10(np.abs(felt).max()) <= 55.0
    assert np.abs(displacement).max() <= 12.5
    assert np.abs(command).max() < 10.0
    assert not saturated
    assert np.abs(out).max() > 50.0


def test_live_limiter__what_reaches_no_limit__passes_to_the_bit_five_milliseconds_later(controller):
    quiet = 30.0 * np.sin(2 * np.pi * 100 * np.arange(8000) / 4000)
    out, limiter = limited(controller, quiet)
    np.testing.assert_array_equal(out[20:, 0], quiet[:-20])
    assert limiter.max_reduction_db == 0.0


def test_live_limiter__a_shout__taken_back_and_let_go_at_the_slope(controller):
    time = np.arange(16000) / 4000
    tone = np.where(time < 1.0, 3000.0, 20.0) * np.sin(2 * np.pi * 60 * time)
    out, limiter = limited(controller, tone)
    assert limiter.max_reduction_db > 15.0
    assert 0.9 < limiter.reduced / 4000 < 2.0
    np.testing.assert_allclose(out[12020:, 0], tone[12000:-20], rtol=1e-12)


def test_live_limiter__a_shout_out_of_silence__no_more_taken_back_than_came(controller):
    shout = np.where(np.arange(8000) % 4000 < 2000, 0.0, 3000.0)
    _, limiter = limited(controller, shout)
    assert 15.0 < limiter.max_reduction_db <= 20 * np.log10(3000.0)
    assert limiter.reduced <= 4000
