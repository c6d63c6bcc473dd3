"""What a command that follows the noise tells of the hold: by hand, and in a loop of the outside generator."""

import numpy as np
import pytest
from scipy import signal

from tactuator.identification.identify import identify
from tactuator.identification.lines import spectrum
from tactuator.identification.residual import Residual, explained_by_loop
from tactuator.signals.record import Record
from tests.identification.others import Plant, held

RATE_HZ, COUNT = 1000.0, 8000


def residual_of(command: np.ndarray, residual: np.ndarray) -> Residual:
    taken = spectrum(command, residual, RATE_HZ)
    ones = np.ones(taken.position.size)
    return Residual(taken.position, ones, ones[1:] + 0j, taken)


def noises(seed: int) -> tuple[np.ndarray, np.ndarray]:
    first, second = np.random.default_rng(seed).standard_normal((2, COUNT))
    return signal.lfilter([1.0], [1.0, -0.9], first), second


def test_explained_by_loop__command_apart_from_the_residual_or_ahead_of_it__is_nothing() -> None:
    for seed in range(5):
        own, noise = noises(seed)
        ahead = signal.lfilter([1.0, -0.9], [1.0], own) + np.roll(noise, -20)
        for command in (own, ahead):
            assert explained_by_loop(residual_of(command, noise), 470.0, filtered=True) == 0.0


def test_explained_by_loop__command_that_follows__is_the_likelihood_of_its_regression() -> None:
    own, noise = noises(6)
    # white innovations, so that the regression's sum of squares is the likelihood
    white = signal.lfilter([1.0, -0.9], [1.0], own)
    command = white - 0.5 * noise - 0.25 * np.roll(noise, 1)
    found = explained_by_loop(residual_of(command, noise), 500.0, filtered=False)
    expected = COUNT * np.log(np.var(command) / np.var(white)) - 2.0 * np.log(COUNT)
    assert found == pytest.approx(expected, rel=0.05)


def test_identify__held_loop_whose_noise_a_prompt_model_would_take__is_told_or_left_open() -> None:
    """The command answers the noise within its sample: read as band-limited the position alone is likelier."""
    plant = Plant(np.zeros(0), np.array([-315.0 + 774.0j, -315.0 - 774.0j, -650.0]), 0.6, 0.0)
    record = Record(600.0, *held(plant, np.random.default_rng(13), 600.0, 10.0, 22.0, closed=True))
    found = identify(record, order=3)
    assert found.between.hold == "zero-order"
    frequency = np.geomspace(1.0, 180.0, 100)
    off = np.log(found.model.response(frequency) / plant.response(frequency))
    assert np.mean(np.abs(off.imag) <= found.model.band_rad(frequency)) > 0.9
