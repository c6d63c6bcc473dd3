"""Continuous systems seen through converters: zero-order hold for plants, bilinear for controllers.

Both keep zeros and poles: no polynomial in z is expanded, so that nothing is lost at high rates.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.signals.systems import ContinuousSystem, SampledSystem


@lru_cache(maxsize=32)  # of a display's plants: an experiment asks for them after every interval
def zero_order_hold(system: ContinuousSystem, rate_hz: float, delay_samples: int = 0) -> SampledSystem:
    """Return the sampled equivalent of a plant driven through a zero-order hold, `delay_samples` late. Of one with
    fewer than two poles more than zeros it keeps the plant itself (`held`); of others, images of the hold are below
    0.02 dB.

    Dead time may be any: whole samples become `delay_samples`, what is left splits the held input in two (Franklin,
    Powell & Workman 1990, section 4.3) and adds a pole at z = 0. Poles are exp(p T); zeros are those of the held state
    space. Raises BadInput for an improper system.
    """
    if not system.is_proper:
        raise BadInput(f"plant has {system.zeros.size} zeros and {system.poles.size} poles", "no more zeros than poles")
    samples = system.delay_s * rate_hz
    whole = math.floor(samples + 1e-9)
    fraction = max(0.0, samples - whole)
    late = whole + delay_samples
    step = 1.0 / rate_hz
    late_s = system.delay_s + delay_samples * step
    held = replace(system, delay_s=late_s) if system.poles.size - system.zeros.size < 2 else None
    poles = np.exp(system.poles * step)
    if system.poles.size == 0:
        return SampledSystem(np.empty(0), np.empty(0), system.gain, rate_hz, late + (fraction > 1e-9), held)
    ad, bd, c, d = held_state_space(system, step, fraction if fraction > 1e-9 else 0.0)
    if ad.shape[0] > system.poles.size:
        poles = np.append(poles, 0.0)
    zeros = _zeros(ad, bd, c, d)
    return SampledSystem(zeros, poles, _answer(ad, bd, c, d, ad.shape[0] - zeros.size), rate_hz, late, held)


def _answer(ad: FloatArray, bd: FloatArray, c: FloatArray, d: float, after: int) -> float:
    """Return the impulse response `after` samples: the gain, where there are so many more poles than zeros."""
    return d if after == 0 else float(c @ np.linalg.matrix_power(ad, after - 1) @ bd)


def state_space(system: ContinuousSystem, step: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return the controller canonical form in time units of `step`: states (xi, T xi', T^2 xi'', ...), y = num(xi).

    Returns A * step (n, n), B * step (n,), C (n,), D. A load that only changes the denominator leaves the meaning of
    the states as it is, so it may be put on and taken off with position and velocity continuous.
    """
    order = system.poles.size
    denominator = np.real(np.poly(system.poles * step))
    numerator = np.zeros(order + 1)
    scaled = np.real(np.poly(system.zeros * step)) * step ** float(order - system.zeros.size)
    numerator[order - system.zeros.size :] = system.gain * scaled
    direct = float(numerator[0])
    a = np.eye(order, k=1)
    a[-1] = -denominator[:0:-1]
    b = np.zeros(order)
    b[-1] = 1.0
    c = (numerator[1:] - direct * denominator[1:])[::-1]
    return a, b, c, direct


def held_state_space(
    system: ContinuousSystem, step: float, fraction: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return the matrices of x(k+1) = Ad x + Bd u, y = C x + D u under a zero-order hold; `fraction` of a sample of
    dead time adds the last input as a state.

    The states are those of `state_space`.
    """
    a, b, c, d = state_space(system, step)
    ad, bd, late = held_matrices(a, b, 1.0, fraction)
    if fraction == 0.0:
        return ad, bd, c, d
    order = a.shape[0]
    held = np.zeros((order + 1, order + 1))
    held[:order, :order], held[:order, order] = ad, late
    return held, np.append(bd - late, 1.0), np.append(c, d), 0.0


def held_matrices(
    a: FloatArray, b: FloatArray, step: float, fraction: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Ad (n, n), Bd (n,) and late (n,) of x' = a x + b u under a zero-order hold and `fraction` of a sample of
    dead time: x(k+1) = Ad x + Bd u(k) + late (u(k-1) - u(k))."""
    ad, bd = _integrated(a, b, step)
    if fraction == 0.0:
        return ad, bd, np.zeros_like(bd)
    after, _ = _integrated(a, b, (1.0 - fraction) * step)
    return ad, bd, after @ _integrated(a, b, fraction * step)[1]


def _integrated(a: FloatArray, b: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
    """Return exp(a t) and its integral over [0, t] times b, t the duration.

        exp [a t  b t] = [exp(a t)  integral b]
            [ 0    0 ]   [   0          1     ]

    (Van Loan 1978, IEEE Trans. Automatic Control 23). The input's column weighs as much as the rest: the exponential's
    error is relative to the norm.
    """
    order = b.size
    block = np.zeros((order + 1, order + 1))
    weight = np.linalg.norm(b * duration) or 1.0
    block[:order, :order], block[:order, order] = a * duration, b * duration / weight
    exponential = scipy.linalg.expm(block)
    return exponential[:order, :order], exponential[:order, order] * weight


def _zeros(ad: FloatArray, bd: FloatArray, c: FloatArray, d: float) -> ComplexArray:
    """Return the transmission zeros in z: finite generalised eigenvalues of the system matrix, found for z - 1. One so
    far away that no double tells it from infinity is none.
    """
    order = ad.shape[0]
    system = np.zeros((order + 1, order + 1))
    system[:order, :order] = ad - np.eye(order)
    scale = np.linalg.norm(bd) or 1.0
    system[:order, order] = bd / scale
    gain = np.linalg.norm(c) or 1.0
    system[order, :order] = c / gain
    system[order, order] = d / (gain * scale)
    mass = np.zeros_like(system)
    mass[:order, :order] = np.eye(order)
    alpha, beta = scipy.linalg.eig(system, mass, right=False, homogeneous_eigvals=True)
    expected = order if d != 0.0 else order - 1
    nearness = np.abs(beta) / np.hypot(np.abs(alpha), np.abs(beta))
    nearest = np.argsort(-nearness)[:expected]
    finite = nearest[nearness[nearest] > np.finfo(np.float64).eps]
    roots = alpha[finite] / beta[finite]
    return np.asarray(1.0 + np.where(np.abs(roots.imag) < 1e-13, roots.real, roots), dtype=np.complex128)


def bilinear(system: ContinuousSystem, rate_hz: float) -> SampledSystem:
    """Return Tustin's transform s = 2 rate (z - 1)/(z + 1), without prewarping, root by root.

    Raises BadInput for an improper system, a root at s = 2 rate, or dead time that is not a whole number of samples.
    """
    delay = system.delay_s * rate_hz
    if abs(delay - round(delay)) > 1e-9:
        raise BadInput(f"dead time is {delay:g} samples; allowed for a bilinear transform: a whole number of them")
    if not system.is_proper:
        raise BadInput(
            f"system has {system.zeros.size} zeros and {system.poles.size} poles", "no more zeros than poles"
        )
    twice = 2.0 * rate_hz
    if np.any(system.poles == twice) or np.any(system.zeros == twice):
        raise BadInput(f"a root lies at s = {twice:g} rad/s, twice the rate", "any other place")
    zeros = (twice + system.zeros) / (twice - system.zeros)
    poles = (twice + system.poles) / (twice - system.poles)
    gain = system.gain * np.real(np.prod(twice - system.zeros) / np.prod(twice - system.poles))
    nyquist = -np.ones(system.poles.size - system.zeros.size)
    return SampledSystem(np.append(zeros, nyquist), poles, float(gain), rate_hz, round(delay))
