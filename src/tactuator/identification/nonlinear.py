"""What a residual shows of a mechanism that is not linear: it follows the size of the command, or of the motion.

A command that saturates, or does nothing while it is small, leaves its square or cube or its clipped self in the
residual, moved as the model moves the command; so does a spring whose force is not proportional, with those of the
motion; a sensor leaves them as they are, and play the state of a hysteresis along the motion. Of each the part that a
linear model has already is taken off (Bussgang, 1952). What is left is how far the gain at other sizes may be from the
model's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.friction import dahl_state
from tactuator.identification.lines import POOLED
from tactuator.identification.residual import Residual
from tactuator.signals.spectra import mean_over_frequency

_CERTAIN = 100.0
"""Drop of -2 log likelihood by one parameter from which on a shape is taken to have a part."""
_FEWEST = 9
"""Lines of a mean power at least."""


def distortion_left(residuals: Sequence[Residual], frequency_hz: FloatArray) -> tuple[float, ComplexArray]:
    """Return the size of the distortion that the residuals show over that of the position, and over the response at
    frequencies (m,), as a deviation of its logarithm: play turns the phase too; zeros where none is visible.
    """
    shapes = [list(_shapes(residual)) for residual in residuals]
    total = sum(float(np.sum(np.abs(each.weight[1:] * each.lines[1:]) ** 2)) for each in residuals)
    powers = [residual.weight[1:] ** 2 for residual in residuals]
    best, share, level = 0.0, 0.0, np.zeros(frequency_hz.size, dtype=np.complex128)
    for pairs in zip(*shapes, strict=True):
        pulls, (side, *_) = zip(*pairs, strict=True)
        size = along = 0.0
        for pull, residual, power in zip(pulls, residuals, powers, strict=True):
            size += float(np.sum(np.abs(residual.weight[1:] * pull) ** 2))
            along += float(np.sum((np.conj(pull) * residual.lines[1:]).real * power))
        won = along**2 / max(size, 1e-300)
        # share of the residual from which on it counts
        if size > 0.0 and won > max(best, 0.5 * _CERTAIN, 0.02 * total):
            best = won
            share, relative = _relative(along / size, pulls, residuals, frequency_hz)
            level = np.asarray(relative * side)
    return share, level


def _shapes(residual: Residual) -> Iterator[tuple[ComplexArray, complex]]:
    """Yield the lines but zero of the position that each shape moves, nothing linear in them, and how it turns."""
    taken = residual.taken
    command = np.fft.irfft(taken.command, taken.samples) * np.sqrt(taken.samples)
    size = float(np.std(command))
    # levels of the command, of its deviation, below which it may do nothing
    clipped = [np.clip(command, -part * size, part * size) for part in (0.05, 0.2, 0.6)]
    for shapes in ([command**2, command**3], clipped):
        for bent in _lines(_beyond(shape, command) for shape in shapes):
            bent *= residual.response
            yield bent, 1.0
    motion = residual.simulated
    for bent in _lines(_beyond(motion**power, motion) for power in (2, 3)):
        # a spring moves the resonance, and with it size and phase alike
        yield residual.response * bent, 1.0 + 1.0j
        yield bent, 1.0  # of the sensor
    turned, size = np.fft.irfft(1j * np.fft.rfft(motion), taken.samples), max(float(np.std(motion)), 1e-300)
    # distances over which a hysteresis builds up, of the motion's deviation
    for played in _lines(_beyond(dahl_state(motion, distance * size), motion, turned) for distance in (0.02, 0.1)):
        # deviation of the response's logarithm by play, over what nothing linear follows of it. The hysteresis of a
        # sine is a square wave: 0.90 of it lags a quarter of a turn, 0.44 is the rest, 2.1 times less; under noise it
        # was up to 2.4
        yield played, 1.0 + 2.5j


def _beyond(shape: FloatArray, *linear: FloatArray) -> FloatArray:
    """Return a shape (n,) without its part along what is linear; zeros where nothing else is in it."""
    rest = shape - shape.mean()
    power = float(rest @ rest)
    for along in linear:
        rest = rest - along * float(along @ rest) / max(float(along @ along), 1e-300)
    # power of a shape beyond its linear part, over its own, below which the two cannot be separated
    return rest if float(rest @ rest) > 1e-3 * power else np.zeros(rest.size)


def _lines(rows: Iterable[FloatArray]) -> list[ComplexArray]:
    samples = np.array(list(rows))
    return [lines[1:] / np.sqrt(samples.shape[1]) for lines in np.fft.rfft(samples)]


def _relative(
    amount: float, pulls: Sequence[ComplexArray], residuals: Sequence[Residual], frequency_hz: FloatArray
) -> tuple[float, FloatArray]:
    """Return a shape's size over the position's, and over the response's at frequencies (m,), means over 15 % of it."""
    shape, moved, near = 0.0, 0.0, np.zeros((2, frequency_hz.size))
    for pull, residual in zip(pulls, residuals, strict=True):
        taken = residual.taken
        powers = [np.abs(lines) ** 2 for lines in (amount * pull, residual.response * taken.command[1:])]
        shape, moved = shape + float(powers[0].sum()), moved + float(powers[1].sum())
        near += mean_over_frequency(np.stack(powers), taken.frequency_hz[1:], frequency_hz, 0.5 * POOLED, _FEWEST)
    return float(np.sqrt(shape / max(moved, 1e-300))), np.sqrt(near[0] / np.maximum(near[1], 1e-300))
