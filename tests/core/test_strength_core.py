"""A reference reshaped by its own level: the core against NumPy's float32 bit for bit, and against its own response."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tactuator.errors import BadInput
from tactuator.model.controller import StrengthShaping
from tactuator.signals.decibels import db
from tests.core.single_precision import TINY, Single, finite
from tests.runtime.paper_display import RATE_HZ, channel, controller, display
from tests.strength import core, reshaped


@cache
def shaping():
    return reshaped(controller(display(channel()))).channels[0].strength


def run_core(reference, of=None):
    step, _ = core(of or shaping(), RATE_HZ)
    return np.array([step(r) for r in reference], dtype=np.float32)


def run_numpy(reference):
    """The same from the description in strength.h; rows by NumPy's frexp, not by the bits."""
    follow = Single(-np.expm1(-1.0 / (shaping().follow_s * RATE_HZ)))
    turns = (2.0 * np.sin(np.pi * shaping().pairs_hz / RATE_HZ)).astype(np.float32)
    gains, damping = shaping().gains.astype(np.float32), Single(shaping().damping)
    power = level = Single(0.0)
    pairs = np.zeros((4, 2), dtype=np.float32)
    out = []
    for each in reference:
        r = finite(Single(each), 1e6)
        power = power + follow * (r * r - power)
        felt = max(level, Single(0.5))
        level = min(level + follow * (power - level), felt + Single(6.0) * follow * felt)
        mantissa, exponent = np.frexp(level)
        row = int(exponent) - 1 + 1 if level > 0.0 else -1
        low, high, share = gains[0], gains[0], Single(0.0)
        if row >= 20:
            low = high = gains[20]
        elif row >= 0:
            low, high, share = gains[row], gains[row + 1], Single(2.0) * mantissa - Single(1.0)
        gain = low + share * (high - low)
        total = gain[0] * r
        for i in range(4):
            band = pairs[i, 0] + turns[i] * ((r - pairs[i, 1]) - damping * pairs[i, 0])
            band = band if band >= TINY or band <= -TINY else Single(0.0)
            pairs[i] = band, pairs[i, 1] + turns[i] * band
            total = total + (gain[2 * i + 1] * band + gain[2 * i + 2] * pairs[i, 1])
        if level < Single(1e-12):
            power, level = finite(power, 1e12), finite(level, 1e12)
            pairs[np.abs(pairs) < Single(1e-20)] = 0.0
        out.append(total)
    return np.array(out, dtype=np.float32)


LEVELS_DB = np.repeat(np.random.default_rng(3).uniform(-80.0, 60.0, 20), 100)
LIKE_SPEECH = np.random.default_rng(4).standard_normal(2000) * 10.0 ** (LEVELS_DB / 20.0)


@settings(max_examples=30)
@given(hnp.arrays(np.float32, st.integers(1, 40), elements=st.floats(width=32)))
@example(LIKE_SPEECH.astype(np.float32))
def test_strength__any_bits_or_noise_of_every_level__agrees_with_numpy_bit_for_bit(reference) -> None:
    with np.errstate(all="ignore"):
        expected = run_numpy(reference)
    assert np.array_equal(run_core(reference).view(np.uint32), expected.view(np.uint32))


@pytest.mark.parametrize(("level", "hertz"), [(3.0, 250.0), (20.0, 16.0), (20.0, 100.0), (37.0, 100.0)])
def test_strength__steady_tone__is_raised_by_its_response(hertz: float, level: float) -> None:
    time_s = np.arange(6000) / RATE_HZ
    turned = np.exp(-2j * np.pi * hertz * time_s[2000:])
    out = run_core(10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * hertz * time_s))[2000:]
    felt = db(2.0 * np.abs(np.mean(out * turned))) - level
    assert felt == pytest.approx(db(np.abs(shaping().response(level, hertz, RATE_HZ))), abs=0.05)


TIME_S = np.arange(8000) / RATE_HZ
SWELL = 10.0 ** (np.interp(TIME_S, [0.0, 0.5, 1.0, 1.001], [0.0, 50.0, 50.0, 10.0]) / 20.0)
SWEEP = np.sin(2.0 * np.pi * 5.0 * 2.0 / np.log(60.0) * (60.0 ** (TIME_S / 2.0) - 1.0))
SOUNDS = {
    "swell": SWELL * np.sin(2.0 * np.pi * 60.0 * TIME_S),
    "sweep that begins at 40 dB SL": np.r_[np.zeros(400), 100.0 * SWEEP],
}


@pytest.mark.parametrize(("name", "hertz"), [(name, hertz) for name in SOUNDS for hertz in (30.0, 250.0)])
def test_strength__any_sound__moves_its_gain_without_a_step(name: str, hertz: float) -> None:
    """The core's own gain: what comes out over what goes in, where every row gains alike what it gains at a tone."""
    levels = 10.0 * np.log10(2.0) * np.arange(21)
    gains = np.zeros((21, 9))
    gains[:, 0] = np.abs([shaping().response(level, hertz, RATE_HZ) for level in levels])
    sound = (SOUNDS[name] + 1e-9).astype(np.float32)  # nowhere 0
    gain_db = db(run_core(sound, replace(shaping(), gains=gains)) / sound)
    assert np.abs(np.diff(gain_db)).max() < 0.1
    assert np.abs(gain_db[80:] - gain_db[:-80]).max() < 5.0
    assert np.ptp(gain_db) > 3.0


def test_strength__silence__comes_to_rest_without_subnormal_numbers() -> None:
    step, state = core(shaping(), RATE_HZ)
    for sample, r in enumerate(np.concatenate((1e3 * np.ones(4000), np.zeros(60000)))):
        step(r)
        if sample % 200:
            continue
        values = np.abs([state.power, state.level, *(value for pair in state.pair for value in pair)])
        assert np.all((values == 0.0) | (values > float(TINY) * 1e-6))
    assert not np.any(values)


@pytest.mark.parametrize("changes", [{"damping": 1e9}, {"gains": np.full((21, 9), 1e5)}, {"gains": np.zeros((20, 9))}])
def test_strength_table__figures_that_cannot_run__are_refused(changes) -> None:
    figures = {"pairs_hz": shaping().pairs_hz, "damping": 1.2, "gains": shaping().gains, "follow_s": 0.05} | changes
    with pytest.raises(BadInput, match="strength"):
        run_core([0.0], StrengthShaping(**figures))
