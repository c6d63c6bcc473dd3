"""Noise, hum and friction of the simulated display, each on its own."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import stats

from tactuator.runtime._core import ffi, lib


def noise(seed: int, channel: int, count: int) -> NDArray[np.float64]:
    state, values = ffi.new("tact_noise *"), np.empty(count)
    lib.tact_noise_seed(state, seed, channel)
    lib.tact_noise_run(state, ffi.from_buffer("double[]", values), count)
    return values


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
