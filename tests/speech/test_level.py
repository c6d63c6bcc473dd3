"""Levels of utterances, by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.speech.render import LevelMeter


def level_of(*blocks):
    meter = LevelMeter(4000.0)
    for block in blocks:
        meter.push(np.asarray(block))
    return meter.level_db()


def tone(amplitude, seconds):
    return amplitude * np.sin(2 * np.pi * 200.0 * np.arange(round(4000 * seconds)) / 4000)[:, None]


def test_level__sinusoid__is_that_of_its_amplitude():
    assert level_of(tone(10.0, 1.0)) == pytest.approx(20.0, abs=1e-9)


def test_level__pauses__do_not_count():
    assert level_of(tone(10.0, 1.0), np.zeros((40000, 1))) == pytest.approx(20.0, abs=1e-9)


def test_level__soft_part_within_30_db__counts():
    expected = 20.0 + 10 * np.log10((1.0 + 0.1**2) / 2)
    assert level_of(tone(10.0, 1.0), tone(1.0, 1.0)) == pytest.approx(expected, abs=1e-9)


def test_level__several_fingers__the_loudest():
    both = np.concatenate([tone(1.0, 1.0), tone(10.0, 1.0)], axis=1)
    assert level_of(both) == pytest.approx(20.0, abs=1e-9)


def test_level__silence__is_minus_infinity():
    assert level_of(np.zeros((400, 1))) == -np.inf


@given(st.lists(st.integers(1, 4999), max_size=6))
def test_level__however_it_is_cut__same(cuts):
    noise = np.random.default_rng(0).standard_normal((5000, 2))
    assert level_of(*np.split(noise, sorted(cuts))) == pytest.approx(level_of(noise), abs=1e-12)


def test_level__less_than_a_frame__refused():
    with pytest.raises(BadInput, match="frame"):
        level_of(np.ones((50, 1)))
