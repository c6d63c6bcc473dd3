"""Levels of utterances, by hand."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.speech.render import LevelMeter


def level_of(*blocks):
    meter = LevelMeter(4000.0)
    for block in blocks:
        meter.push(np.asarray(block))
    return meter.level_db()


def tone(amplitude, seconds=1.0):
    return amplitude * np.sin(2 * np.pi * 200.0 * np.arange(round(4000 * seconds)) / 4000)[:, None]


@pytest.mark.parametrize(
    ("blocks", "expected"),
    [
        ([tone(10.0)], 20.0),
        ([tone(10.0), np.zeros((40000, 1))], 20.0),
        ([tone(10.0), tone(1.0)], 20.0 + 10 * np.log10((1.0 + 0.1**2) / 2)),
        ([np.concatenate([tone(1.0), tone(10.0)], axis=1)], 20.0),
        ([np.zeros((400, 1))], -np.inf),
    ],
    ids=["its amplitude", "pauses do not count", "soft within 30 dB counts", "the loudest finger", "silence"],
)
def test_level__of_what_is_played__is_that_of_the_hand_calculation(blocks, expected):
    assert level_of(*blocks) == pytest.approx(expected, abs=1e-9)


def test_level__however_it_is_cut__same_and_less_than_a_frame_refused():
    noise = np.random.default_rng(0).standard_normal((5000, 2))
    pieces = np.split(noise, [1, 99, 100, 101, 700, 701, 3333])
    assert level_of(*pieces) == pytest.approx(level_of(noise), abs=1e-12)
    with pytest.raises(BadInput, match="frame"):
        level_of(np.ones((50, 1)))
