"""The limiter: its bounds on the simulated display, touched and not, and its smoothness."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.rig.rig import with_felt
from tactuator.signals.decibels import db, from_db
from tactuator.speech import limiter as module
from tactuator.speech.band_codings import band_limit_kernel
from tactuator.speech.filters import filter_bank
from tactuator.speech.limiter import Limiter, reduction_envelope
from tests.griffin import distance_db
from tests.measure.loops import loaded
from tests.strength import reshaped

RATE = 4000
TIME = np.arange(14 * RATE) / RATE


def blocks_of(reference):
    return np.split(reference, range(4 * RATE, len(reference), 4 * RATE))


def limited(controller, reference):
    limiter = Limiter(controller)
    return np.concatenate(list(limiter.process(blocks_of(reference)))), limiter.report


def quiet_above_300(signal):
    kernel = band_limit_kernel((0.0, 0.0), (290.0, 20.0), RATE)
    return np.concatenate(list(filter_bank([signal], [kernel]))) * np.ones((1, 3))


def on_the_display(controller, reference, load):
    """Felt samples (weighted with zero phase), displacement and command of the simulated display."""
    rig = loaded(controller, 5)
    for name in rig.channels:
        rig.finger(name).touch(load)
    traces, play = [], rig.play

    def listened(block):
        traces.append(play(block))
        return traces[-1]

    rig.play = listened
    silence = np.zeros((4 * RATE, len(rig.channels)))  # a slow loop's last tenths of a millimetre go in seconds
    displacement = np.concatenate([d for _, d in with_felt(rig, rig.stream([*blocks_of(reference), silence]))])
    size = len(displacement) + 4 * RATE
    frequency = np.fft.rfftfreq(size, 1 / RATE)
    weight = 1.0 / controller.display.channels[0].threshold.curve.displacement_mm(frequency)
    felt = np.fft.irfft(np.fft.rfft(displacement, size, axis=0) * weight[:, None], size, axis=0)[: len(displacement)]
    saturated = any(trace.saturated.any() for trace in traces)
    return felt, displacement, np.concatenate([trace.command_v for trace in traces]), saturated


SIGNALS = {
    "square 0.5 Hz": np.sign(np.sin(2 * np.pi * 0.5 * TIME)),
    "square 30 Hz": np.sign(np.sin(2 * np.pi * 30 * TIME)),
    "square 250 Hz": np.sign(np.sin(2 * np.pi * 250 * TIME)),
    "clicks": np.where(np.arange(len(TIME)) % 4000 == 2000, 50.0, 0.0),
    "dc that begins": (TIME > 5.0).astype(float),
    "noise": np.random.default_rng(0).standard_normal(len(TIME)),
}


@pytest.mark.parametrize("load", [None, "finger"])
@pytest.mark.parametrize("name", SIGNALS)
def test_limiter__nasty_signals__display_within_comfort_travel_and_command(controller, name, load):
    out, reports = limited(controller, 3000.0 * quiet_above_300(SIGNALS[name]))
    felt, displacement, command, saturated = on_the_display(controller, out, load)
    assert 20 * np.log10(np.abs(felt).max()) <= 55.0
    assert np.abs(displacement).max() <= 12.5
    assert np.abs(command).max() < 10.0
    assert not saturated
    if name == "square 30 Hz":  # its component is within comfort as well, over a whole number of periods
        part = felt[4 * RATE : 12 * RATE]
        turn = np.exp(-2j * np.pi * 30 * np.arange(len(part)) / RATE)
        assert 20 * np.log10(2 * np.abs((part * turn[:, None]).mean(axis=0)).max()) <= 55.0
    for report in reports:
        assert 0.0 < report.max_reduction_db < 80.0
        assert report.max_slope_db_per_ms <= 0.5


def test_limiter__harmless_reference__passes_to_the_bit(controller):
    reference = quiet_above_300(30.0 * SIGNALS["noise"])
    out, reports = limited(controller, reference)
    np.testing.assert_array_equal(out, reference)
    assert all(report.max_reduction_db == 0.0 and report.reduced_s == 0.0 for report in reports)


def test_limiter__loud_moment__the_rest_is_untouched(controller):
    reference = np.zeros((30 * RATE, 3))
    burst = slice(13 * RATE, 13 * RATE + 800)
    reference[:, :] = 20.0 * np.sin(2 * np.pi * 100 * np.arange(len(reference)) / RATE)[:, None]
    reference[burst] *= 50.0 * np.hanning(800)[:, None]
    out, reports = limited(controller, reference)
    np.testing.assert_array_equal(out[: 12 * RATE], reference[: 12 * RATE])
    np.testing.assert_array_equal(out[15 * RATE :], reference[15 * RATE :])
    assert all(report.max_reduction_db > 3.0 for report in reports)


def test_limiter__reshaped_by_strength__is_reduced_as_long_as_what_is_felt_asks_for(controller):
    """A tone of 250 Hz, which Griffin's contours raise most: as if it came in louder by so much, not reshaped."""
    reference = np.zeros((14 * RATE, 3))
    part = slice(5 * RATE, 7 * RATE)
    shape = np.minimum(1.0, 5.0 * np.hanning(2 * RATE)) * np.cos(2 * np.pi * 250 * TIME[part])
    reference[part] = from_db(50.5) * shape[:, None]
    assert all(report.reduced_s == 0.0 for report in limited(controller, reference)[1])
    shaped = reshaped(controller)
    out, reports = limited(shaped, reference)
    expected = limited(controller, from_db(distance_db(250.0, 40.0)) * reference)[1]
    for column, (report, other) in enumerate(zip(reports, expected, strict=True)):
        assert report.max_reduction_db == pytest.approx(other.max_reduction_db, abs=0.7)
        assert report.reduced_s == pytest.approx(other.reduced_s, abs=0.1)
        changed = np.abs(out[part, column]) < np.abs(reference[part, column])
        assert np.count_nonzero(changed) / RATE == pytest.approx(report.reduced_s, abs=0.01)
    felt, *_, saturated = on_the_display(shaped, out, None)
    assert 45.0 < db(np.abs(felt).max()) <= 55.0
    assert not saturated


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.integers(0, 1999), st.floats(0.0, 60.0)), max_size=8),
    st.one_of(st.none(), st.floats(0.0, 20.0)),
)
def test_reduction_envelope__any_needs__smooth_enough_and_sufficient(needs, start):
    need = np.zeros(2000)
    for at, depth in needs:
        need[at] = max(need[at], depth)
    got = reduction_envelope(need, start, RATE)
    steps = np.diff(got) if start is None else np.diff(np.r_[start, got])
    assert steps.max(initial=0.0) <= module.ATTACK_DB_PER_MS * 1e3 / RATE + 1e-9
    assert steps.min(initial=0.0) >= -module.RELEASE_DB_PER_MS * 1e3 / RATE - 1e-9
    assert got.min() >= 0.0
    if start is None:
        assert np.all(got >= need - 1e-9)
