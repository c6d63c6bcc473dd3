"""Candidate loops: a fixed, ordered set that depends on the plant and the rate alone, never on what is asked.

    C(z) = k / d  *  pair(zeros) / single(pole)  *  pair / pair  *  pair / pair          d = z - 1

A controller is an integrator with two zeros and a pole, a lead-lag and a notch: three second-order sections. Every
factor is of unit gain at rest; a pair is d^2 + c1 d + c0 with roots exp(s / rate) for s of natural frequency w and
damping zeta, a single d + c0. The parameters are logarithms, so that no factor can turn unstable or non-minimum-phase;
a notch that is not needed ends as a pair that cancels, or nearly.

A search that only ever asks "which of these keeps every limit?" cannot turn a yes into a no when a limit is relaxed:
whatever kept the tighter limits is in the set again, and keeps the looser ones. Shapes are built from the plant's own
roots: an integrator alone, with one zero (PI), with two (PID); each with and without a lead or a roll-off, and a notch
on each lightly damped mode. Later blocks fill the parameters' space evenly (Sobol), or with finer grids. Gains put the
crossover of the nominal plant on a grid of 48 frequencies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import exp, expm1, sin, sinh, sqrt

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis.even_points import even_points

# Where each factor's parameters stand: (kind, first index, +1 numerator or -1 denominator)
_PAIRS = ((1, 1), (4, 1), (6, -1), (8, 1), (10, -1))
_FIRST = [index for index, _ in _PAIRS]
_SECOND = [index + 1 for index, _ in _PAIRS]
_SIGNS = np.array([[float(sign)] for _, sign in _PAIRS])
_POLE = 3
COUNT = 12
FREQUENCIES = (1, 3, 4, 6, 8, 10)
"""Indices of the parameters that are log natural frequencies (log of rad/sample)."""
POLES = (3, 6, 10)
"""Those of them that are of poles."""
ZERO_DAMPINGS, POLE_DAMPINGS = (2, 5, 9), (7, 11)
"""Indices of the parameters that are log dampings, of zeros and of poles."""


@dataclass(frozen=True)
class LoopStructure:
    """The structure at one rate. A parameter vector is (log k, log w and log zeta of the zeros, log w of the pole, then
    log w and log zeta of numerator and denominator of lead-lag and notch), w in rad/sample."""

    rate_hz: float

    def response_and_slope(self, parameters: FloatArray, difference: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return C, shape (n,), and the derivatives of log C, shape (COUNT, n), at difference = z - 1, shape (n,)."""
        coefficients, slopes = _all_coefficients(parameters)
        c1, c0 = coefficients[:, :1], coefficients[:, 1:]
        polynomials = difference * (difference + c1) + c0
        inverse = _SIGNS / polynomials
        along, rest = difference * inverse, inverse - _SIGNS / c0
        slope = np.empty((COUNT, difference.size), dtype=np.complex128)
        slope[0] = 1.0
        slope[_FIRST] = slopes[0, :, :1] * along + slopes[0, :, 1:] * rest
        slope[_SECOND] = slopes[1, :, :1] * along + slopes[1, :, 1:] * rest
        factor, by_frequency = _single(float(parameters[_POLE]), difference)
        slope[_POLE] = -by_frequency
        # the two pairs below appear as their inverses, each with the sign -1: the signs cancel
        gain = np.exp(parameters[0]) * float(np.prod(c0[:, 0] ** -_SIGNS[:, 0]))
        above = polynomials[0] * polynomials[1] * polynomials[3]
        return gain * above * inverse[2] * inverse[4] / (difference * factor), slope

    def responses(self, parameters: FloatArray, difference: ComplexArray) -> ComplexArray:
        """Return C of many parameter vectors, (n, COUNT), at difference = z - 1, shape (f,): shape (n, f)."""
        above: ComplexArray = np.exp(parameters[:, :1]) + 0j
        pole = -np.expm1(-np.exp(parameters[:, _POLE, None]))
        below: ComplexArray = difference * ((difference + pole) / pole)
        for index, sign in _PAIRS:
            factor = _pairs(parameters[:, index, None], parameters[:, index + 1, None], difference)
            above, below = (above * factor, below) if sign > 0 else (above, below * factor)
        return above / below

    def system(self, parameters: FloatArray) -> SampledSystem:
        """Return the controller of a parameter vector."""
        zeros: list[complex] = []
        poles: list[complex] = [1.0, complex(np.exp(-np.exp(parameters[_POLE])))]
        gain = float(np.exp(parameters[0])) * -float(np.expm1(-np.exp(parameters[_POLE])))
        for index, sign in _PAIRS:
            roots, at_rest = _roots(parameters[index], parameters[index + 1])
            (zeros if sign > 0 else poles).extend(roots)
            gain *= at_rest**-sign
        return SampledSystem(np.array(zeros), np.array(poles), gain, self.rate_hz)


def _coefficients(log_frequency: float, log_damping: float) -> tuple[float, float]:
    """Return (c1, c0) of a pair, without cancellation at high rates."""
    frequency, damping = exp(log_frequency), exp(log_damping)
    decay = damping * frequency
    inner = frequency**2 * (1.0 - damping**2)  # square of the angle; negative when overdamped
    half = sqrt(abs(inner)) / 2.0
    square = sin(half) ** 2 if inner >= 0.0 else -(sinh(half) ** 2)
    c0 = expm1(-decay) ** 2 + 4.0 * exp(-decay) * square
    return c0 - expm1(-2.0 * decay), c0


def _coefficient_slopes(
    log_frequency: float, log_damping: float, c0: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the derivatives of (c1, c0) by log frequency and by log damping."""
    frequency, damping = exp(log_frequency), exp(log_damping)
    decay = damping * frequency
    inner = frequency**2 * (1.0 - damping**2)
    angle = sqrt(abs(inner))
    by_inner = 1.0 if angle < 1e-8 else (sin(angle) if inner >= 0.0 else sinh(angle)) / angle
    rest = c0 - expm1(-decay) ** 2  # 4 exp(-decay) square, which falls with the decay too
    slopes = []
    for inner_slope in (2.0 * inner, -2.0 * decay**2):
        by_c0 = -2.0 * expm1(-decay) * exp(-decay) * decay - rest * decay + exp(-decay) * by_inner * inner_slope
        slopes.append((by_c0 + 2.0 * exp(-2.0 * decay) * decay, by_c0))
    return slopes[0], slopes[1]


def _all_coefficients(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (c1, c0) of every pair, shape (5, 2), and their derivatives by log frequency and by log damping,
    shape (2, 5, 2).
    """
    coefficients = [_coefficients(float(parameters[index]), float(parameters[index + 1])) for index in _FIRST]
    slopes = [
        _coefficient_slopes(float(parameters[index]), float(parameters[index + 1]), c0)
        for index, (_, c0) in zip(_FIRST, coefficients, strict=True)
    ]
    return np.array(coefficients), np.array(slopes).transpose(1, 0, 2)


def _pairs(log_frequency: FloatArray, log_damping: FloatArray, difference: ComplexArray) -> ComplexArray:
    """Return the pairs of unit gain at rest, many at once: parameters (n, 1), difference (f,), result (n, f)."""
    frequency, damping = np.exp(log_frequency), np.exp(log_damping)
    decay = damping * frequency
    inner = frequency**2 * (1.0 - damping**2)
    half = np.sqrt(np.abs(inner)) / 2.0
    square = np.where(inner >= 0.0, np.sin(half) ** 2, -(np.sinh(half) ** 2))
    c0 = np.expm1(-decay) ** 2 + 4.0 * np.exp(-decay) * square
    c1 = c0 - np.expm1(-2.0 * decay)
    # by the reciprocal, as a complex number is divided by a real one
    return np.asarray((difference * (difference + c1) + c0) * (1.0 / c0))


def _single(log_frequency: float, difference: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    frequency = exp(log_frequency)
    c0 = -expm1(-frequency)
    slope = frequency * exp(-frequency)
    return (difference + c0) / c0, slope / (difference + c0) - slope / c0


def _roots(log_frequency: float, log_damping: float) -> tuple[list[complex], float]:
    """Return both roots in z, and the pair's value at rest, c0."""
    frequency, damping = np.exp(log_frequency), np.exp(log_damping)
    spread = frequency * np.sqrt(complex(damping**2 - 1.0))
    roots = [complex(np.exp(-damping * frequency + spread)), complex(np.exp(-damping * frequency - spread))]
    return roots, _coefficients(log_frequency, log_damping)[1]


LIGHT_DAMPING = 0.5
"""A pole pair of less damping counts as a mode, which a notch may stand on."""
_CROSSOVERS = 48
_LOWEST_CROSSOVER_HZ, _HIGHEST_CROSSOVER = 0.2, 0.06
_FAR = 2.0 * np.pi * 0.45
_OFF = (0.9 * _FAR, 1.0, 0.9 * _FAR, 1.0)
"""A pair that cancels: numerator's frequency and damping, then the denominator's."""
_MODES_MAX = 3
_SOBOL_LOG2 = (12, 14)


def modes(plant: ContinuousSystem) -> list[tuple[float, float]]:
    """Return (natural frequency in rad/s, damping) of the plant's lightly damped pole pairs, the slowest first."""
    pairs = plant.poles[plant.poles.imag > 0.0]
    damped = [(float(abs(pole)), float(-pole.real / abs(pole))) for pole in pairs]
    return sorted(pair for pair in damped if pair[1] < LIGHT_DAMPING)[:_MODES_MAX]


def crossovers_hz(rate_hz: float) -> FloatArray:
    """Return the frequencies at which a candidate's open loop is put to one, hertz, shape (48,)."""
    return np.geomspace(_LOWEST_CROSSOVER_HZ, _HIGHEST_CROSSOVER * rate_hz, _CROSSOVERS)


def shapes(plant: ContinuousSystem, rate_hz: float) -> Iterator[FloatArray]:
    """Yield blocks of shapes, each (n, COUNT) with a gain of one at index 0, the simplest first."""
    # integrator, PI and PID, each with and without a roll-off, and a notch on each mode
    fronts = [*_integrator_and_pi(rate_hz, 20), *_pid(plant, rate_hz, (1.0, 2.0), (None, 0.1))]
    seconds = [_OFF, *_roll_offs(rate_hz, 4), *_leads(rate_hz, 7, (5.0,))]
    yield _combined(fronts, seconds, [_OFF, *_notches(plant, rate_hz, (1.0,), (1.0,))])
    yield _even(plant, rate_hz, 0)
    # the same with finer grids, detuned notches, notches for the hum, and a second notch in place of the lead
    fronts = [*_integrator_and_pi(rate_hz, 24), *_pid(plant, rate_hz, (0.7, 1.0, 1.6), (None, 0.05, 0.2))]
    seconds = [_OFF, *_roll_offs(rate_hz, 6), *_leads(rate_hz, 6, (2.5, 6.0, 15.0))]
    if len(modes(plant)) > 1:
        seconds += _notches(plant, rate_hz, (1.0,), (1.0,))
    notches = _notches(plant, rate_hz, (0.92, 1.0, 1.08), (0.6, 1.0, 1.6))
    corners = np.geomspace(30.0, 0.1 * rate_hz, 3) * 2.0 * np.pi / rate_hz
    notches += [(corner, 0.7, corner * width, 0.9) for corner, width in product(corners.tolist(), (0.7, 1.0))]
    yield _combined(fronts, seconds, [_OFF, *notches])
    yield _even(plant, rate_hz, 1)


Front = tuple[float, float, float]
Second = tuple[float, float, float, float]


def _combined(fronts: list[Front], seconds: list[Second], notches: list[Second]) -> FloatArray:
    rows = [(1.0, *front, *second, *notch) for front, second, notch in product(fronts, seconds, notches)]
    return np.asarray(np.log(np.array(rows)))


def _zeros(first: float, second: float) -> tuple[float, float]:
    """Return the natural frequency and damping of two real roots at `first` and `second` rad/sample."""
    natural = float(np.sqrt(first * second))
    return natural, max(1.0, (first + second) / (2.0 * natural))


def _integrator_and_pi(rate_hz: float, count: int) -> list[Front]:
    """Return the fronts k/s and PI: the second zero cancels the single pole, or stands next to z = 0."""
    fast, slow = _FAR * (1.3 + np.sqrt(0.69)), _FAR * (1.3 - np.sqrt(0.69))
    corners = np.geomspace(1.0, 0.1 * rate_hz, count) * 2.0 * np.pi / rate_hz
    return [(*_zeros(fast, slow), slow), *((*_zeros(corner, _FAR), _FAR) for corner in corners.tolist())]


def _pid(
    plant: ContinuousSystem, rate_hz: float, scales: tuple[float, ...], poles: tuple[float | None, ...]
) -> list[Front]:
    """Return the PID fronts: two zeros near the plant's two slowest poles, or together; the pole far away or at a share
    of the rate (rad per sample).
    """
    natural, damping = slow_pair(plant)
    pairs = [(natural * scale / rate_hz, min(max(damping, 0.7) * more, 4.0)) for scale in scales for more in (0.7, 1.0)]
    step = 2.0 * np.pi / rate_hz
    pairs += [(corner * step, 1.0) for corner in np.geomspace(5.0, 0.02 * rate_hz, 2 + 2 * len(scales)).tolist()]
    return [
        (natural, damping, _FAR if pole is None else pole)
        for (natural, damping), pole in product(pairs, poles)
        if natural < _FAR
    ]


def slow_pair(plant: ContinuousSystem) -> tuple[float, float]:
    """Return natural frequency (rad/s, at least 2 pi) and damping (0.01 to 3.9) of the plant's two slowest poles;
    10 Hz and 1 where it has fewer."""
    slow = plant.poles[np.argsort(np.abs(plant.poles), kind="stable")][:2]
    if slow.size < 2:
        return 2.0 * np.pi * 10.0, 1.0
    natural = max(float(np.sqrt(np.abs(np.prod(slow)))), 2.0 * np.pi)
    return natural, float(np.clip(np.abs(np.sum(slow).real) / 2.0 / natural, 0.01, 3.9))


def _roll_offs(rate_hz: float, count: int) -> list[Second]:
    corners = np.geomspace(10.0, 0.2 * rate_hz, count) * 2.0 * np.pi / rate_hz
    return [(_FAR, 1.0, corner, 0.9) for corner in corners.tolist()]


def _leads(rate_hz: float, count: int, ratios: tuple[float, ...]) -> list[Second]:
    """Return the leads: one zero at a corner, one pole above it; the pair's other roots cancel near z = 0."""
    corners = np.geomspace(3.0, 0.1 * rate_hz, count) * 2.0 * np.pi / rate_hz
    return [
        (*_zeros(corner, _FAR), *_zeros(min(ratio * corner, _FAR), _FAR))
        for corner, ratio in product(corners.tolist(), ratios)
    ]


def _notches(
    plant: ContinuousSystem, rate_hz: float, detunings: tuple[float, ...], widths: tuple[float, ...]
) -> list[Second]:
    """Return a notch on each mode: zeros as soft as the mode or three times that, poles of damping 0.9."""
    return [
        (natural / rate_hz * detuning, soft, natural / rate_hz * detuning * width, 0.9)
        for natural, damping in modes(plant)
        for detuning, width, soft in product(detunings, widths, (max(damping, 1e-3), max(3.0 * damping, 0.1)))
        if natural / rate_hz * detuning * width < _FAR
    ]


def _even(plant: ContinuousSystem, rate_hz: float, block: int) -> FloatArray:
    """Return Sobol points over all eleven parameters of a shape; the block's share of one sequence."""
    skipped = 1 + sum(2**power for power in _SOBOL_LOG2[:block])
    share = even_points(COUNT - 1, skipped, 2 ** _SOBOL_LOG2[block])
    natural = slow_pair(plant)[0] / rate_hz
    step = 2.0 * np.pi / rate_hz
    soft = min([0.7, *(damping for _, damping in modes(plant))])
    top = 0.4 * rate_hz * step
    ranges = [
        (min(natural * 0.5, 0.5 * top), min(natural * 4.0, top)),
        (0.7, 4.0),
        (20.0 * step, top),
        (20.0 * step, 0.1 * rate_hz * step),
        (0.7, 2.0),
        (1.0, 8.0),
        (0.9, 1.5),
        (20.0 * step, 0.1 * rate_hz * step),
        (max(soft, 1e-3), 1.5),
        (0.5, 2.0),
        (0.9, 1.5),
    ]
    low, high = np.log(np.array(ranges)).T
    points = np.zeros((share.shape[0], COUNT))
    points[:, 1:] = low + (high - low) * share
    points[:, 6] += points[:, 4]
    points[:, 10] += points[:, 8]
    limit = np.log(_FAR)
    points[:, [1, 3, 4, 6, 8, 10]] = np.minimum(points[:, [1, 3, 4, 6, 8, 10]], limit)
    return points
