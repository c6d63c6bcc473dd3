"""Delay and volts by a wire on a card whose time is turned by hand."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.sound.cards import full_scale_v, measure_delay, tone, wire_display
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.stream import CardRows
from tests.rig.sound.turned_card import PERIOD, RATE_HZ, TurnedCard


def wire_rig(**card) -> SoundRig:
    rows = CardRows(1, 1, 16384, RATE_HZ)
    turned = TurnedCard(rows, **{"delay": PERIOD} | card)
    return SoundRig(wire_display(RATE_HZ, 1, 1), rows, turned, turned.sleep)


@pytest.mark.parametrize("delay", [PERIOD, 777])
def test_measure_delay__wire__within_no_sample(delay: int):
    noise = np.random.default_rng(3)

    def answer(out: np.ndarray) -> np.ndarray:
        return (-0.5 * out + 0.01 * noise.standard_normal(out.shape)).astype(np.float32)

    found = measure_delay(wire_rig(delay=delay, answer=answer), 0.3, np.random.default_rng(1))
    assert (found.samples, found.spread) == (delay, 0)
    assert found.gain == pytest.approx(-0.5, abs=0.01)


def test_tone__through_a_wire_of_known_gain__its_peak_and_volts():
    heard = tone(wire_rig(answer=lambda out: (0.25 * out).astype(np.float32)), 100.0, 0.4, 2.0)
    assert heard == pytest.approx(0.1, rel=1e-3)
    assert full_scale_v(1.0, 0.4) == pytest.approx(3.5355, rel=1e-4)


@pytest.mark.parametrize("heard", ["nothing", "noise", "hum"])
def test_delay_and_tone__no_wire__are_refused(heard: str):
    noise, rows = np.random.default_rng(3), [0]

    def answer(out: np.ndarray) -> np.ndarray:
        time = (rows[0] + np.arange(len(out))) / RATE_HZ
        rows[0] += len(out)
        hum = 0.01 * np.sin(2.0 * np.pi * 50.0 * time)[:, None] * (heard == "hum")
        return (hum + 0.01 * (heard == "noise") * noise.standard_normal(out.shape)).astype(np.float32)

    with pytest.raises(BadInput, match="does not come back at the input"):
        tone(wire_rig(answer=answer), 100.0, 0.4, 2.0)
    with pytest.raises(BadInput, match="does not come back at the input"):
        measure_delay(wire_rig(answer=answer), 0.3, np.random.default_rng(1))


def test_tone__no_input__is_played_and_none_is_heard():
    rows = CardRows(1, 0, 16384, RATE_HZ)
    turned = TurnedCard(rows)
    assert tone(SoundRig(wire_display(RATE_HZ, 1, 0), rows, turned, turned.sleep), 100.0, 0.4, 2.0) == 0.0


def test_tone_and_full_scale__out_of_range__are_refused():
    for level, frequency in ((0.0, 100.0), (1.0, 100.0), (0.1, 4000.0)):
        with pytest.raises(BadInput, match="allowed: 1 to 3200 Hz"):
            tone(wire_rig(), frequency, level, 1.0)
    with pytest.raises(BadInput, match="a reading of 0 V rms"):
        full_scale_v(0.0, 0.1)
