"""A start for mechanisms that friction rules: least squares with the friction among the regressors.

Where friction eats much of the command, no response y/u describes the record and every fit that starts from one goes
astray. The equation A y = B u - c z with z the sign of the velocity, filtered like the rest, is linear in A, B and c.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.refined import Disturbance, Fit, Samples, fit_model
from tactuator.identification.estimate.states import companion_states
from tactuator.identification.estimate.structure import RationalModel, Structure


def friction_fit(samples: Samples, poles: int, integrated: int = 0) -> Fit | None:
    """Return a fit of `poles` poles and no zeros with friction, or None where the regression finds no positive
    friction.
    """
    best: Fit | None = None
    for corner, sharper in itertools.product(_corners(samples), (1.0, 5.0, 25.0)):
        path = smoothed(samples.position, min(sharper * corner, 0.4 * samples.rate_hz), samples.rate_hz)
        found = _regress(samples, path, poles, 2.0 * np.pi * corner)
        if found is None:
            continue
        numerator, denominator, coulomb = found
        scale = 2.0 * np.pi * corner / 5.0
        structure = Structure(poles, integrated, integrated=integrated)
        powers = np.arange(poles)
        b = np.zeros(integrated + 1)
        b[integrated] = numerator / scale ** (poles - integrated)
        a = denominator[:0:-1] / scale ** (poles - powers.astype(float))
        presliding = 1e-3 * float(np.std(path))
        disturbance = Disturbance(np.zeros(0), presliding, path)
        fit = fit_model(samples, structure, RationalModel(b, a, scale, 0.0), disturbance, coulomb, most=8)
        if np.isfinite(fit.cost) and fit.coulomb > 0.0 and (best is None or fit.cost < best.cost):
            best = fit
    if best is None:
        return None
    finer = replace(best.disturbance, presliding=0.1 * best.disturbance.presliding)
    fit = fit_model(samples, best.structure, best.model, finer, best.coulomb, most=8)
    return fit if fit.cost < best.cost else best


def smoothed(values: FloatArray, corner_hz: float, rate_hz: float) -> FloatArray:
    """Return the zero-phase low-pass of Gaussian shape with its corner at corner_hz, ends mirrored, (n,)."""
    count = values.size
    mirrored = np.concatenate([2.0 * values[0] - values[::-1], values, 2.0 * values[-1] - values[::-1]])
    frequency = np.fft.rfftfreq(mirrored.size, 1.0 / rate_hz)
    spectrum = np.fft.rfft(mirrored) * np.exp(-0.35 * (frequency / corner_hz) ** 2)
    return np.asarray(np.fft.irfft(spectrum, mirrored.size)[count : 2 * count])


def _corners(samples: Samples) -> list[float]:
    """Return the frequency where the velocity's power ends, and twice and half as much, hertz."""
    window = np.hanning(samples.position.size)
    spectrum = np.abs(np.fft.rfft(window * (samples.position - samples.position.mean()))) ** 2
    frequency = np.fft.rfftfreq(samples.position.size, 1.0 / samples.rate_hz)
    share = np.cumsum(spectrum * np.minimum(frequency, 0.02 * samples.rate_hz) ** 2)
    edge = float(frequency[np.searchsorted(share, 0.9 * share[-1])])
    return [
        min(max(factor * edge, 20.0 / samples.position.size * samples.rate_hz), 0.1 * samples.rate_hz)
        for factor in (1.0, 3.0)
    ]


def _regress(samples: Samples, path: FloatArray, poles: int, corner: float) -> tuple[float, FloatArray, float] | None:
    rate = samples.rate_hz
    e = np.real(np.poly(np.full(poles, -corner)))
    velocity = np.gradient(path)
    sign = velocity / np.hypot(velocity, 0.02 * float(np.std(velocity)))
    from_u = companion_states(e, samples.command, rate)[:, :1]
    from_sign = companion_states(e, sign, rate)[:, :1]
    centred = samples.position - samples.position.mean()
    from_y = companion_states(e, centred, rate, hold="first-order")
    highest = centred - from_y @ e[:0:-1]
    constant = np.ones((centred.size, 1))
    columns = np.hstack([from_u, -from_sign, -from_y[:, ::-1], constant])
    start = int(min(8.0 * rate / corner, 0.2 * centred.size))
    columns, goal = columns[start:], highest[start:]
    size = np.sqrt(np.sum(columns**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = columns / size
    theta = np.linalg.lstsq(scaled.T @ scaled, scaled.T @ goal, rcond=1e-12)[0] / size
    numerator, pull, denominator = float(theta[0]), float(theta[1]), np.append(1.0, theta[2 : 2 + poles])
    if numerator == 0.0 or pull / numerator <= 0.0:
        return None
    roots = np.roots(denominator)
    mirrored = np.where(roots.real > 0.0, -np.conj(roots), roots)
    return numerator, np.real(np.poly(mirrored)), pull / numerator
