"""The structure of a synthesised controller: an integrator, a lead-lag and a notch, each a second-order section.

    C(z) = k / d  *  pair(zeros) / single(pole)  *  pair / pair  *  pair / pair          d = z - 1

Every factor is of unit gain at rest; a pair is d^2 + c1 d + c0 with roots exp(s / rate) for s of natural frequency w
and damping zeta, a single d + c0. The parameters are logarithms, so that no factor can turn unstable or
non-minimum-phase; a notch that is not needed ends as a pair that cancels, or nearly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import exp, expm1, sin, sinh, sqrt

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.signals.systems import ContinuousSystem, SampledSystem

# Position of each factor's parameters: (kind, first index, +1 numerator or -1 denominator)
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

    def vectors(self, controller: SampledSystem) -> Iterator[FloatArray]:
        """Yield the parameter vectors of a controller of this structure: each real pole may be the single one. Real
        roots make pairs with their neighbours."""
        others = np.delete(controller.poles, np.argmin(np.abs(controller.poles - 1.0)))
        at_rest = controller.gain * np.prod(1.0 - controller.zeros) / np.prod(1.0 - others)
        for index in np.flatnonzero(others.imag == 0.0):
            parameters = np.empty(COUNT)
            parameters[0], parameters[_POLE] = np.log(at_rest.real), np.log(-np.log(others[index].real))
            parameters[[1, 2, 4, 5, 8, 9]] = np.log(_pairs_of(controller.zeros)).ravel()
            parameters[[6, 7, 10, 11]] = np.log(_pairs_of(np.delete(others, index))).ravel()
            yield parameters


def _pairs_of(roots: ComplexArray) -> list[tuple[float, float]]:
    """Return (natural frequency in rad/sample, damping) of roots in z, two by two, the slowest first."""
    s = np.log(roots)
    real, upper = np.sort(s[s.imag == 0.0].real)[::-1], s[s.imag > 0.0]
    products = np.append(real[::2] * real[1::2], np.abs(upper) ** 2)
    sums = np.append(real[::2] + real[1::2], 2.0 * upper.real)
    natural = np.sqrt(products)
    return sorted(zip(natural.tolist(), (-0.5 * sums / natural).tolist(), strict=True))


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
"""A pole pair with less damping is a mode, on which a notch may be placed."""


def slow_pair(plant: ContinuousSystem) -> tuple[float, float]:
    """Return natural frequency (rad/s, at least 2 pi) and damping (0.01 to 3.9) of the plant's two slowest poles;
    10 Hz and 1 where it has fewer."""
    slow = plant.poles[np.argsort(np.abs(plant.poles), kind="stable")][:2]
    if slow.size < 2:
        return 2.0 * np.pi * 10.0, 1.0
    natural = max(float(np.sqrt(np.abs(np.prod(slow)))), 2.0 * np.pi)
    return natural, float(np.clip(np.abs(np.sum(slow).real) / 2.0 / natural, 0.01, 3.9))


def other_modes(plant: ContinuousSystem) -> list[tuple[float, float]]:
    """Return (natural frequency in rad/s, damping) of the plant's lightly damped pole pairs, the slowest first, without
    its slowest pair (within 20 %)."""
    pairs = plant.poles[plant.poles.imag > 0.0]
    damped = [(float(abs(pole)), float(-pole.real / abs(pole))) for pole in pairs]
    # the lowest three may get a notch
    modes = sorted(pair for pair in damped if pair[1] < LIGHT_DAMPING)[:3]
    return [mode for mode in modes if abs(mode[0] / slow_pair(plant)[0] - 1.0) > 0.2]
