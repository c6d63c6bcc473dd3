"""Periodic records of a sampled loop: what follows the reference is free of the noise that the loop feeds back."""

import numpy as np
from scipy import signal

from tactuator.identification.distortion import distortion_of
from tactuator.signals.multisine import Periods

PERIOD, PERIODS, REALISATIONS, RATE_HZ = 256, 4, 40, 1000.0
LINES = np.arange(1, 100, 2)[np.arange(50) % 3 != 1]
PLAN = Periods(PERIOD, PERIODS, REALISATIONS, LINES)
NUMERATOR, DENOMINATOR, GAIN = np.array([0.0, 0.3]), np.array([1.0, -0.8]), 2.0


def loop(noise: float, feedback: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reference, command and position of 0.3 z^-1 / (1 - 0.8 z^-1) under a gain of 2, or without a loop."""
    rng = np.random.default_rng(4)
    spectrum = np.zeros((REALISATIONS, PERIOD // 2 + 1), dtype=complex)
    spectrum[:, LINES] = np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, (REALISATIONS, LINES.size)))
    reference = np.concatenate([np.tile(one, PERIODS) for one in np.fft.irfft(spectrum, PERIOD, axis=1) * 20.0])
    sensor = noise * rng.standard_normal(reference.size)
    if not feedback:
        return reference, reference, signal.lfilter(NUMERATOR, DENOMINATOR, reference) + sensor
    closed = DENOMINATOR + GAIN * NUMERATOR
    position = signal.lfilter(GAIN * NUMERATOR, closed, reference) + signal.lfilter(DENOMINATOR, closed, sensor)
    return reference, GAIN * (reference - position), position


def plant() -> np.ndarray:
    step = np.exp(-2j * np.pi * LINES / PERIOD)
    return 0.3 * step / (1.0 - 0.8 * step)


def test_distortion_of__open_loop__command_repeats_itself_and_noise_is_right() -> None:
    _, command, position = loop(0.3, False)
    seen = distortion_of([(command, position)], None, [PLAN], RATE_HZ)
    assert seen.repeats is True
    assert not seen.shows
    amplitude = np.sqrt(np.mean(np.abs(np.fft.rfft(command[:PERIOD])[LINES]) ** 2))
    expected = 0.3 * np.sqrt(PERIOD / (PERIODS - 1)) / amplitude
    np.testing.assert_allclose(np.median(seen.noise), expected, rtol=0.1)
    off = np.abs(seen.value - plant()) / np.sqrt(seen.variance)
    assert 0.6 < np.mean(off**2) < 1.6


def test_distortion_of__loop__does_not_repeat_and_the_reference_takes_its_bias_away() -> None:
    reference, command, position = loop(1.0, True)
    biased = distortion_of([(command, position)], None, [PLAN], RATE_HZ)
    free = distortion_of([(command, position)], [reference], [PLAN], RATE_HZ)
    assert biased.repeats is False
    errors = [np.abs(np.mean((one.value - plant()) / plant())) for one in (biased, free)]
    assert errors[1] < 0.3 * errors[0]
    off = np.abs(free.value - plant()) / np.sqrt(free.variance)
    assert 0.5 < np.mean(off**2) < 2.0


def test_distortion_of__one_multisine__takes_the_distortion_from_the_silent_lines() -> None:
    _, command, position = loop(1e-4, False)
    bent = position + 0.05 * command**3
    one = Periods(PERIOD, PERIODS, 1, LINES)
    many = distortion_of([(command, bent)], None, [PLAN], RATE_HZ)
    single = distortion_of([(command, bent)], None, [one], RATE_HZ)
    assert many.shows
    assert single.shows
    assert abs(20.0 * np.log10(np.median(single.distortion) / np.median(many.distortion))) < 3.0
    assert np.nanmedian(many.even) < 0.1 * np.median(many.odd)
