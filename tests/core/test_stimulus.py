"""On-board tones against NumPy's sines and cosines; noise, hum and friction of the simulated display, each alone."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import stats

from tactuator.runtime._core import ffi, lib

RATE_HZ = 4000.0
LONG = 400 * 4000
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
    return run(stimulus_of(tones), count)


def run(stimulus: Any, count: int) -> NDArray[np.float32]:
    lib.tact_stimulus_rewind(stimulus)
    return np.array([lib.tact_stimulus_next(stimulus, tick) for tick in range(count)], dtype=np.float32)


@st.composite
def any_tone(draw: st.DrawFn) -> Tone:
    length = draw(st.integers(0, 3000))
    ramp = draw(st.integers(0, length // 2))
    return Tone(
        draw(st.integers(0, 2000)), length, ramp, draw(st.floats(-1e4, 1e4, width=32)), draw(st.floats(0.1, 1900.0))
    )


@settings(max_examples=60, deadline=None)
@given(any_tone())
def test_tone__any__is_numpys_within_its_amplitude_and_silent_outside(tone: Tone) -> None:
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


@pytest.mark.parametrize("hertz", [0.4, 300.0])
def test_tone__for_minutes__keeps_amplitude_and_frequency(hertz: float) -> None:
    reference = play([Tone(0, LONG, 0, 1.0, hertz)], LONG)
    assert np.max(np.abs(reference)) <= 1.0 + 1e-6
    stretch = 10 * 4000  # whole periods of each
    time_s = np.arange(stretch) / RATE_HZ
    carrier = np.exp(-2j * np.pi * hertz * time_s)
    phasors = [
        2.0 * np.mean(reference[at : at + stretch] * carrier) * np.exp(-2j * np.pi * hertz * at / RATE_HZ)
        for at in (0, LONG // 2, LONG - stretch)
    ]
    assert np.abs(phasors) == pytest.approx([1.0, 1.0, 1.0], rel=1e-4)
    turned = np.unwrap(np.angle(phasors)) / (2.0 * np.pi)
    drift_hz = np.abs(np.diff(turned)) / (np.array([LONG // 2, LONG // 2 - stretch]) / RATE_HZ)
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
    assert np.max(np.abs(run(stimulus, 300))) <= abs(amplitude) * 1.0002 + 1e-44


def noise(seed: int, channel: int, count: int) -> NDArray[np.float64]:
    state = ffi.new("tact_noise *")
    lib.tact_noise_seed(state, seed, channel)
    return np.array([lib.tact_noise_next(state) for _ in range(count)]) / np.sqrt((2.0**32 - 1.0) / 3.0)


def test_noise_bits__known_state__are_those_of_xoshiro128plusplus() -> None:
    # First outputs from the state 1, 2, 3, 4 of the algorithm as published, worked out with Python's integers.
    words, mask = [1, 2, 3, 4], 0xFFFFFFFF

    def rotate(value: int, bits: int) -> int:
        return ((value << bits) | (value >> (32 - bits))) & mask

    state = ffi.new("tact_noise *", {"word": words})
    for _ in range(1000):
        expected = (rotate((words[0] + words[3]) & mask, 7) + words[0]) & mask
        shifted = (words[1] << 9) & mask
        words[2] ^= words[0]
        words[3] ^= words[1]
        words[1] ^= words[2]
        words[0] ^= words[3]
        words[2] ^= shifted
        words[3] = rotate(words[3], 11)
        assert lib.tact_noise_bits(state) == expected


def test_noise__half_a_million_samples__has_unit_rms_and_is_white() -> None:
    count = 2**19
    values = noise(3, 0, count)
    assert np.mean(values) == pytest.approx(0.0, abs=4.0 / np.sqrt(count))
    # the variance of a sum of four uniforms: (kurtosis - 1)/n with kurtosis 2.7
    assert np.var(values) == pytest.approx(1.0, abs=4.0 * np.sqrt(1.7 / count))
    assert stats.kurtosis(values) == pytest.approx(-0.3, abs=0.03)
    for lag in (1, 2, 3, 7, 66, 67, 1000):
        assert abs(np.mean(values[lag:] * values[:-lag])) < 4.5 / np.sqrt(count)
    bands = np.abs(np.fft.rfft(values)[1:-1]) ** 2 / count
    averages = bands[: bands.size // 64 * 64].reshape(64, -1).mean(axis=1)
    assert np.max(np.abs(averages - 1.0)) < 5.0 / np.sqrt(bands.size // 64)


def test_noise__other_seed_or_channel__is_independent() -> None:
    streams = [noise(seed, channel, 20_000) for seed in (0, 1) for channel in (0, 1, 2)]
    correlation = np.corrcoef(streams) - np.eye(len(streams))
    assert np.max(np.abs(correlation)) < 5.0 / np.sqrt(20_000)
    assert np.array_equal(noise(1, 2, 1000), noise(1, 2, 1000))


def test_hum__25_s__keeps_amplitude_and_phase() -> None:
    hum, state = ffi.new("tact_hum *"), ffi.new("tact_hum_state *")
    frequencies, amplitudes = (60.0, 120.0, 180.0), (1.0e-3, 0.3e-3, 0.2e-3)
    hum.count = 3
    for i, (frequency, amplitude) in enumerate(zip(frequencies, amplitudes, strict=True)):
        angle = 2.0 * np.pi * frequency / 4000.0
        hum.cosine[i], hum.sine[i], hum.amplitude_v[i] = np.cos(angle), np.sin(angle), amplitude
        state.cosine[i] = 1.0
    last = 0.0
    for _ in range(100_001):
        last = lib.tact_hum_next(hum, state)
    assert last == pytest.approx(0.0, abs=1e-11)  # 100 000 samples are whole periods of 60 Hz
    assert [state.cosine[i] ** 2 + state.sine[i] ** 2 for i in range(3)] == pytest.approx([1.0] * 3, abs=1e-12)


def friction(position: NDArray[np.float64], level_v: float = 4e-3, presliding: float = 10e-3) -> NDArray[np.float64]:
    table = ffi.new("tact_friction *", {"stiffness": level_v / presliding, "per_presliding": 1.0 / presliding})
    state, force = ffi.new("tact_friction_state *"), np.empty(position.size)
    source = ffi.from_buffer("double[]", np.ascontiguousarray(position))
    lib.tact_friction_run(table, state, source, ffi.from_buffer("double[]", force), position.size)
    return force


@settings(max_examples=50)
@given(hnp.arrays(np.float64, st.integers(1, 60), elements=st.floats(-0.05, 0.05)))
def test_friction__any_closed_path__keeps_its_level_and_gives_no_energy(path) -> None:
    fine = np.interp(np.linspace(0, path.size + 1, 4000), np.arange(path.size + 2), np.concatenate([[0], path, [0]]))
    force = friction(fine)
    assert max(np.max(np.abs(force)), np.max(np.abs(friction(2e7 * path)))) <= 4e-3 * (1.0 + 1e-12)
    stored = 0.5 * 4e-3 * 10e-3  # at most what the spring of presliding can hold
    assert np.sum(force * np.diff(fine, prepend=0.0)) > -stored


def test_friction__slow_slide__follows_dahl() -> None:
    position = np.linspace(0.0, 0.05, 200_001)
    np.testing.assert_allclose(friction(position), 4e-3 * (1.0 - np.exp(-position / 10e-3)), rtol=0.0, atol=2e-8)
