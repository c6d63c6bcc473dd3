"""Continuous systems as a processor sees them: plants through a zero-order hold, controllers by the bilinear transform.

Systems keep zeros and poles: no polynomial in z is expanded, so that nothing is lost at high rates. Every held command,
here and elsewhere, is one matrix exponential (Van Loan 1978, IEEE Trans. Automatic Control 23). For x' = a x + b u over
the period t, u rising by r,

        [a t  b t   0 ]   [Ad  B0  B1]
    exp [ 0    0    1 ] = [ 0   1   1],     x(k+1) = Ad x + B0 u(k) + B1 r,
        [ 0    0    0 ]   [ 0   0   1]

with r = 0 for a zero-order hold and r = u(k+1) - u(k) for a first-order one.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.signals.systems import ContinuousSystem, SampledSystem

_WHOLE = 1e-9
"""Samples by which dead time may miss a whole number of them: rounding of delay times rate."""


@lru_cache(maxsize=32)  # of a display's plants: an experiment asks for them after every interval
def discretise(
    system: ContinuousSystem, rate_hz: float, method: Literal["zoh", "bilinear"], delay_samples: int = 0
) -> SampledSystem:
    """Return the sampled equivalent of `system` at `rate_hz`, `delay_samples` late.

    method: "zoh", exact for a command that is held between samples and any dead time; or "bilinear", Tustin's transform
    s = 2 rate (z - 1)/(z + 1) without prewarping, for dead time of whole samples.

    Raises BadInput for an improper system; for a bilinear transform also where a root lies at s = 2 rate or the dead
    time is not whole.
    """
    zeros, poles = system.zeros.size, system.poles.size
    if zeros > poles:
        raise BadInput(f"system has {zeros} zeros and {poles} poles", "no more zeros than poles")
    sampled = _held(system, rate_hz) if method == "zoh" else _bilinear(system, rate_hz)
    # of a plant with fewer than two poles more than zeros, samples show images of the steps; of others < 0.02 dB
    shows_images = method == "zoh" and poles - zeros < 2
    held = replace(system, delay_s=system.delay_s + delay_samples / rate_hz) if shows_images else None
    return replace(sampled, delay_samples=sampled.delay_samples + delay_samples, held=held)


def held_matrices(a: FloatArray, b: FloatArray, step: float, *, ramp: bool = False) -> tuple[FloatArray, FloatArray]:
    """Return Ad, (n, n), and B0, (n,), of x' = a x + b u over `step`; with `ramp` B0 and B1, (n, 2)."""
    order = b.size
    block = np.zeros((order + 1 + ramp, order + 1 + ramp))
    # the input's column weighs as much as the rest: the exponential's error is relative to the norm
    weight = np.linalg.norm(b * step) or 1.0
    block[:order, :order], block[:order, order] = a * step, b * step / weight
    if ramp:
        block[order, order + 1] = 1.0
    exponential = scipy.linalg.expm(block)
    driven = exponential[:order, order:] * weight
    return exponential[:order, :order], driven if ramp else driven[:, 0]


def late_input(a: FloatArray, b: FloatArray, step: float, fraction: float) -> FloatArray:
    """Return what `fraction` of a sample of dead time adds to a held step, (n,): x(k+1) = Ad x + B0 u(k) +
    late (u(k-1) - u(k)) (Franklin, Powell & Workman 1990, section 4.3)."""
    if fraction == 0.0:
        return np.zeros_like(b)
    after, _ = held_matrices(a, b, (1.0 - fraction) * step)
    return np.asarray(after @ held_matrices(a, b, fraction * step)[1])


def first_order(decay: complex, values: NDArray[Any]) -> NDArray[Any]:
    """Return y(k) = decay y(k-1) + x(k) of values x (n,), from rest: a triangular banded system, solved downwards.

    As `scipy.signal.lfilter`, whose package takes a second to import.
    """
    band = np.empty((2, values.size), dtype=values.dtype, order="F")
    band[0], band[1] = 1.0, -decay
    solve = scipy.linalg.blas.ztbsv if np.iscomplexobj(values) else scipy.linalg.blas.dtbsv
    return np.asarray(solve(1, band, values, lower=1, diag=1))


def held_state_space(system: ContinuousSystem, rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray, float, int]:
    """Return Ad, Bd, C, D and the whole samples of dead time of x(k+1) = Ad x + Bd u, y = C x + D u under a zero-order
    hold; a fraction of a sample adds the last input as a state.

    The others are those of the controller canonical form in units of the period, (xi, T xi', T^2 xi'', ...), y =
    num(xi): a load that only changes the denominator may be put on with position and velocity continuous.
    """
    whole = math.floor(system.delay_s * rate_hz + _WHOLE)
    fraction = max(0.0, system.delay_s * rate_hz - whole)
    order, step = system.poles.size, 1.0 / rate_hz
    denominator = np.atleast_1d(np.real(np.poly(system.poles * step)))
    numerator = np.zeros(order + 1)
    scaled = np.real(np.poly(system.zeros * step)) * step ** float(order - system.zeros.size)
    numerator[order - system.zeros.size :] = system.gain * scaled
    d = float(numerator[0])
    c = (numerator[1:] - d * denominator[1:])[::-1]
    a, b = np.eye(order, k=1), np.zeros(order)
    a[-1:], b[-1:] = -denominator[:0:-1], 1.0
    ad, bd = held_matrices(a, b, 1.0)
    if fraction <= _WHOLE:
        return ad, bd, c, d, whole
    late = late_input(a, b, 1.0, fraction)
    held = np.zeros((order + 1, order + 1))
    held[:order, :order], held[:order, order] = ad, late
    return held, np.append(bd - late, 1.0), np.append(c, d), 0.0, whole


def _held(system: ContinuousSystem, rate_hz: float) -> SampledSystem:
    """Return the poles exp(p T), 0 for a fraction of a sample, and the zeros of the held state space."""
    ad, bd, c, d, late = held_state_space(system, rate_hz)
    poles = np.append(np.exp(system.poles / rate_hz), np.zeros(bd.size - system.poles.size))
    zeros = _zeros(ad, bd, c, d)
    after = poles.size - zeros.size  # the gain is the first sample of the impulse response that is not zero
    gain = d if after == 0 else float(c @ np.linalg.matrix_power(ad, after - 1) @ bd)
    return SampledSystem(zeros, poles, gain, rate_hz, late)


def _zeros(ad: FloatArray, bd: FloatArray, c: FloatArray, d: float) -> ComplexArray:
    """Return the transmission zeros in z: finite generalised eigenvalues of the system matrix, found for z - 1. A zero
    that a double cannot distinguish from infinity is left out.
    """
    order, system = bd.size, np.zeros((bd.size + 1, bd.size + 1))
    system[:order, :order] = ad - np.eye(order)
    scale = np.linalg.norm(bd) or 1.0
    system[:order, order] = bd / scale
    gain = np.linalg.norm(c) or 1.0
    system[order, :order] = c / gain
    system[order, order] = d / (gain * scale)
    mass = np.zeros_like(system)
    mass[:order, :order] = np.eye(order)
    alpha, beta = scipy.linalg.eig(system, mass, right=False, homogeneous_eigvals=True)
    nearness = np.abs(beta) / np.hypot(np.abs(alpha), np.abs(beta))
    nearest = np.argsort(-nearness)[: order - int(d == 0.0)]
    finite = nearest[nearness[nearest] > np.finfo(np.float64).eps]
    roots = alpha[finite] / beta[finite]
    return np.asarray(1.0 + np.where(np.abs(roots.imag) < 1e-13, roots.real, roots), dtype=np.complex128)


def _bilinear(system: ContinuousSystem, rate_hz: float) -> SampledSystem:
    delay, twice = system.delay_s * rate_hz, 2.0 * rate_hz
    if abs(delay - round(delay)) > _WHOLE:
        raise BadInput(f"dead time is {delay:g} samples; allowed for a bilinear transform: a whole number of them")
    if np.any(system.poles == twice) or np.any(system.zeros == twice):
        raise BadInput(f"a root lies at s = {twice:g} rad/s, twice the rate", "any other place")
    nyquist = -np.ones(system.poles.size - system.zeros.size)
    zeros = np.append((twice + system.zeros) / (twice - system.zeros), nyquist)
    poles = (twice + system.poles) / (twice - system.poles)
    gain = system.gain * np.real(np.prod(twice - system.zeros) / np.prod(twice - system.poles))
    return SampledSystem(zeros, poles, float(gain), rate_hz, round(delay))
