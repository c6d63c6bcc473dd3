"""On-board tones against NumPy's sines and cosines: amplitude, frequency, ramps, timing, and an hour without drift."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tactuator.runtime._core import ffi, lib

RATE_HZ = 4000.0
HOUR = 3600 * 4000
FIELDS = ("start", "length", "ramp", "amplitude", "cosine", "sine", "ramp_cosine", "ramp_sine")


@dataclass(frozen=True)
class Tone:
    """In ticks, threshold units and hertz."""

    start: int
    length: int
    ramp: int
    amplitude: float
    hertz: float

    def fill(self, tone: Any) -> None:
        turn, rise = 2.0 * np.pi * self.hertz / RATE_HZ, np.pi / max(self.ramp, 1)
        values = (np.cos(turn), np.sin(turn), np.cos(rise), np.sin(rise))
        for name, value in zip(FIELDS, (self.start, self.length, self.ramp, self.amplitude, *values), strict=True):
            setattr(tone, name, value)

    def wave(self, count: int) -> NDArray[np.float64]:
        """(count,), of the tone's own angle as float32 holds it."""
        at = np.arange(count) - self.start
        turn = np.arctan2(*(float(np.float32(f(2.0 * np.pi * self.hertz / RATE_HZ))) for f in (np.sin, np.cos)))
        envelope = np.where((at >= 0) & (at < self.length), 1.0, 0.0)
        if self.ramp:
            rising, falling = at < self.ramp, at >= self.length - self.ramp
            envelope[rising] *= 0.5 - 0.5 * np.cos(np.pi * at[rising] / self.ramp)
            envelope[falling] *= 0.5 + 0.5 * np.cos(np.pi * (at[falling] - self.length + self.ramp) / self.ramp)
        return np.asarray(self.amplitude * envelope * np.sin(turn * at))


def stimulus_of(tones: list[Tone]) -> Any:
    stimulus = ffi.new("tact_stimulus *")
    stimulus.count = len(tones)
    for index, tone in enumerate(tones):
        tone.fill(stimulus.tone[index])
        assert lib.tact_tone_is_valid(ffi.addressof(stimulus.tone, index)) == 1
    return stimulus


def play(tones: list[Tone], count: int) -> NDArray[np.float32]:
    reference = np.empty(count, dtype=np.float32)
    lib.tact_stimulus_run(stimulus_of(tones), ffi.from_buffer("float[]", reference), count)
    return reference


@st.composite
def any_tone(draw: st.DrawFn) -> Tone:
    length = draw(st.integers(0, 3000))
    ramp = draw(st.integers(0, length // 2))
    return Tone(
        draw(st.integers(0, 2000)), length, ramp, draw(st.floats(-1e4, 1e4, width=32)), draw(st.floats(0.1, 1900.0))
    )


@settings(max_examples=60, deadline=None)
@given(any_tone())
def test_tone__any__is_numpys_with_its_ramps_within_its_amplitude_and_silent_outside(tone: Tone) -> None:
    reference = play([tone], 5200)
    most = abs(tone.amplitude)
    assert np.max(np.abs(reference - tone.wave(5200))) <= 2e-4 * most + 1e-37  # subnormal numbers are coarse
    assert not np.any(reference[: tone.start])
    assert not np.any(reference[tone.start + tone.length :])
    assert np.max(np.abs(reference)) <= most * (1.0 + 1e-6) + 1e-44


@settings(max_examples=15, deadline=None)
@given(st.lists(any_tone(), max_size=lib.TACT_TONES_MAX))
def test_tones__together__are_the_sum_of_each_alone(tones: list[Tone]) -> None:
    together = np.zeros(5200, dtype=np.float32)
    for tone in tones:
        together += play([tone], 5200)
    assert np.array_equal(play(tones, 5200), together)


@settings(max_examples=30, deadline=None)
@given(st.lists(any_tone(), min_size=1, max_size=4))
def test_stimulus__tick_by_tick_and_again__gives_the_same_bits(tones: list[Tone]) -> None:
    reference, stimulus = play(tones, 1500), stimulus_of(tones)
    for _ in range(2):
        lib.tact_stimulus_rewind(stimulus)
        ticks = np.array([lib.tact_stimulus_next(stimulus, k) for k in range(1500)], dtype=np.float32)
        assert np.array_equal(ticks.view(np.uint32), reference.view(np.uint32))


@pytest.mark.parametrize("hertz", [0.4, 300.0])
def test_tone__for_an_hour__keeps_amplitude_and_frequency(hertz: float) -> None:
    reference = play([Tone(0, HOUR, 0, 1.0, hertz)], HOUR)
    assert np.max(np.abs(reference)) <= 1.0 + 1e-6
    stretch = 10 * 4000  # whole periods of each
    time_s = np.arange(stretch) / RATE_HZ
    carrier = np.exp(-2j * np.pi * hertz * time_s)
    phasors = [
        2.0 * np.mean(reference[at : at + stretch] * carrier) * np.exp(-2j * np.pi * hertz * at / RATE_HZ)
        for at in (0, HOUR // 2, HOUR - stretch)
    ]
    assert np.abs(phasors) == pytest.approx([1.0, 1.0, 1.0], rel=1e-4)
    turned = np.unwrap(np.angle(phasors)) / (2.0 * np.pi)
    drift_hz = np.abs(np.diff(turned)) / (np.array([HOUR // 2, HOUR // 2 - stretch]) / RATE_HZ)
    assert np.all(drift_hz <= 1e-6 * hertz + 1e-6)


LIMITS = [
    ("ramp", 50, True),
    ("ramp", 51, False),
    ("ramp", 2**32 - 1, False),
    ("length", 2**31 - 1, True),
    ("length", 2**31, False),
    ("start", 2**31 - 1, True),
    ("start", 2**31, False),
    ("cosine", 1.01, False),
    ("sine", -0.5, False),
    ("ramp_sine", 1.0, False),
    ("amplitude", 3e38, True),
    *((field, value, False) for field in FIELDS[3:] for value in (float("nan"), float("inf"), float("-inf"))),
]


def test_tone__at_its_limits_or_no_number__is_taken_or_refused() -> None:
    for field, value, valid in LIMITS:
        tone = ffi.new("tact_tone *")
        Tone(0, 100, 10, 1.0, 50.0).fill(tone)
        setattr(tone, field, value)
        assert lib.tact_tone_is_valid(tone) == valid, (field, value)


turns, stretches = st.floats(-np.pi, np.pi), st.floats(1.0 - 4.9e-5, 1.0 + 4.9e-5)


@settings(max_examples=60, deadline=None)
@given(turns, stretches, turns, stretches, st.floats(-1e5, 1e5, width=32), st.integers(0, 300))
def test_tone__any_rotation_that_is_valid__stays_within_its_amplitude(turn, stretch, rise, steep, amplitude, length):
    rotations = (stretch * np.cos(turn), stretch * np.sin(turn), steep * np.cos(rise), steep * np.sin(rise))
    stimulus = ffi.new("tact_stimulus *")
    stimulus.count, stimulus.tone[0] = 1, (0, length, length // 2, amplitude, *rotations)
    assert lib.tact_tone_is_valid(ffi.addressof(stimulus.tone, 0)) == 1
    reference = np.empty(300, dtype=np.float32)
    lib.tact_stimulus_run(stimulus, ffi.from_buffer("float[]", reference), 300)
    assert np.max(np.abs(reference)) <= abs(amplitude) * 1.0002 + 1e-44
