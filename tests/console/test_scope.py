"""The newest samples, and their pictures: against all that was ever added, kept in a plain array."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.console.scope import ScopeSamples, Trigger, newest_crossing
from tactuator.errors import BadInput


def filled(lengths, capacity=200, seed=0):
    """ScopeSamples of one channel, filled piece by piece, and all that was added."""
    every = np.random.default_rng(seed).standard_normal((sum(lengths), 3)).astype(np.float32)
    samples, at = ScopeSamples(1, capacity), 0
    for length in lengths:
        samples.add(at, every[at : at + length])
        at += length
    return samples, every


@settings(max_examples=40)
@given(
    st.lists(st.integers(0, 90), min_size=1, max_size=12), st.integers(0, 400), st.integers(1, 400), st.integers(1, 50)
)
def test_window__of_any_stretch__holds_least_and_greatest_of_its_rows_and_what_is_held_has_no_gap(
    lengths, start, length, columns
):
    samples, every = filled(lengths)
    held = samples.rows(0, samples.end)
    assert samples.lost == 0
    assert len(held) >= min(len(every), 200)
    np.testing.assert_array_equal(held, every[len(every) - len(held) :])
    window = samples.window(start, start + length, columns)
    assert len(window.low) <= columns
    assert window.first % window.step == 0
    for place, (low, high) in enumerate(zip(window.low, window.high, strict=True)):
        rows = every[window.first + place * window.step : window.first + (place + 1) * window.step]
        assert len(rows) == window.step
        np.testing.assert_array_equal(low, rows.min(axis=0))
        np.testing.assert_array_equal(high, rows.max(axis=0))


def test_rows__that_are_missing_were_there_or_have_another_shape__are_no_number_or_refused():
    samples, every = filled([40])
    for first, shape in ((39, (5, 3)), (40, (5, 2)), (40, (5,))):
        with pytest.raises(BadInput, match="from 40 on"):
            samples.add(first, np.zeros(shape, np.float32))
    samples.add(47, every[:10])
    assert (samples.lost, samples.end) == (7, 57)
    assert np.all(np.isnan(samples.rows(40, 47)))
    np.testing.assert_array_equal(samples.rows(47, 57), every[:10])
    window = filled([50] * 8, capacity=4000)[0].window(0, 400, 10)
    assert (window.first, window.step, len(window.low)) == (0, 48, 8)  # at most two columns late


def sampled(values):
    samples = ScopeSamples(1, 1 << 12)
    rows = np.zeros((len(values), 3), np.float32)
    rows[:, 2] = values
    samples.add(0, rows)
    return samples


def test_trigger__on_a_sine__stands_at_its_last_crossing_or_nowhere():
    samples = sampled(np.sin(2.0 * np.pi * (np.arange(1000) - 0.5) / 100.0))
    for edge, quarter in (("rising", 0), ("falling", 2)):
        assert newest_crossing(samples, Trigger(2, 0.0, edge), 0, 1000) == 901 + 25 * quarter
    for level in (2.0, -2.0, float("inf")):
        assert newest_crossing(samples, Trigger(2, level), 0, 1000) is None


def test_trigger__in_noise_about_the_level__passes_once_in_each_period():
    noise = 0.008 * np.random.default_rng(1).standard_normal(4000)
    samples = sampled(-np.cos(2.0 * np.pi * np.arange(4000) / 2000.0) + noise)
    crossings = {newest_crossing(samples, Trigger(2, 0.0), 1400, stop) for stop in range(2400, 2700)}
    assert len(crossings) == 2
    assert None in crossings
