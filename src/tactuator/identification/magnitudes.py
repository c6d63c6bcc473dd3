"""Fits to a response of which the magnitudes alone are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.form import (
    Form,
    free_poles,
    numerator_polynomial,
    numerator_weights,
    sections_of,
    stages_of,
)
from tactuator.identification.likelihood import SpectralFit, SpectralProblem
from tactuator.identification.uncertainty import log_slopes

_REACH = 30.0
"""How far beyond the ends of the magnitudes poles and zeros may lie, over them: farther off nothing shows where."""


class Magnitudes(SpectralProblem):
    """A response of which the magnitudes alone are known, weighted by their logarithms' errors: fits of least phase.

    A magnitude follows the square of a slow pole, so one at zero would never leave it. No pole or zero lies far beyond
    the ends, or rings so long that points as far apart as these do not show it.
    """

    def descend(self, form: Form, theta: FloatArray, delay: float, **limits: Any) -> SpectralFit | None:
        """Return the fit to the magnitudes, begun with the numerator of the complex response."""
        begun = super().descend(form, theta, delay, most=0)
        return None if begun is None else self.sized(begun, limits["most"])

    def sized(self, begun: SpectralFit, most: int) -> SpectralFit:
        """Return the fit after Levenberg and Marquardt's descent on the logarithm of the magnitudes."""
        (fit, rest), damping, first = self.shown(begun, begun.form), 1e-3, begun.numerator.size
        slopes = self._slopes(fit)
        for _ in range(most):
            size = np.linalg.norm(slopes, axis=0) + 1e-300
            gram, downhill = (slopes / size).T @ (slopes / size), (slopes / size).T @ rest
            for _ in range(8):
                step = np.linalg.solve(gram + damping * np.eye(size.size), downhill) / size
                theta = fit.theta * np.exp(np.clip(step[first:], -2.0, 2.0))
                trial, ahead = self.shown(replace(fit, numerator=fit.numerator + step[:first], theta=theta), fit.form)
                if float(ahead @ ahead) < float(rest @ rest):
                    break
                damping *= 5.0
            if not float(rest @ rest - ahead @ ahead) > 1e-6:
                break
            fit, rest, slopes, damping = trial, ahead, self._slopes(trial), max(damping / 10.0, 1e-9)
        return replace(fit, cost=0.5 * float(rest @ rest))

    def _covariance_and_step(self, fit: SpectralFit) -> tuple[FloatArray, FloatArray]:
        first = fit.numerator.size
        # deviation of the logarithm of a section's coefficient of which nothing is seen
        unknown = np.diag(np.repeat([0.0, 1.0 / 3.0], [first, fit.theta.size]))
        rows = np.concatenate([self._slopes(fit), unknown])
        root = np.linalg.pinv(rows) * np.append(np.ones(first), fit.theta)[:, None]
        return root @ root.T, np.zeros(len(root))

    def shown(self, fit: SpectralFit, form: Form) -> tuple[SpectralFit, FloatArray]:
        """Return the fit in that form, its poles and zeros moved to where the points show them, those that it lacks far
        off, and what it leaves of the magnitudes' logarithms in their errors, (m,).
        """
        zeros = np.roots(numerator_polynomial(fit.stages, fit.numerator, fit.form)[: fit.form.numerators])
        pairs = (zeros, form.numerators - 1), (free_poles(fit.theta, fit.form), form.free)
        above, below = (self._within(np.append(roots, np.full(count - roots.size, -np.inf))) for roots, count in pairs)
        theta = sections_of(below)
        stages = stages_of(theta, form)
        numerator = numerator_weights(stages, np.atleast_1d(np.poly(above)).real, form)
        fit = replace(fit, form=form, theta=theta, stages=stages, numerator=numerator)
        weight = np.abs(self.weight * self.given.goal)
        rest = np.log(np.abs(self.given.goal / fit.response(self.grid.frequency_hz)))
        gain = np.average(rest, weights=weight**2)
        return replace(fit, numerator=np.exp(gain) * numerator), (rest - gain) * weight

    def _slopes(self, fit: SpectralFit) -> FloatArray:
        """Return the magnitudes' derivatives by (numerator, logarithm of theta) in their errors, (m, k)."""
        slopes = log_slopes(fit, self.grid.frequency_hz).real * np.append(np.ones(fit.numerator.size), fit.theta)
        return np.asarray(slopes * np.abs(self.weight * self.given.goal)[:, None])

    def _within(self, roots: ComplexArray) -> ComplexArray:
        """Return roots of the left half plane, (n,), in reach of the points, that ring no longer than these show."""
        hertz, to_hz = self.grid.frequency_hz, self.grid.scale_rad_s / (2.0 * np.pi)
        size = np.clip(np.abs(roots), hertz[0] / to_hz / _REACH, hertz[-1] / to_hz * _REACH)
        least = np.interp(size * to_hz, hertz, np.gradient(hertz)) / self.grid.scale_rad_s
        decay = np.maximum(np.abs(np.cos(np.angle(roots))) * size, least)
        turn = np.sqrt(np.maximum(size**2 - decay**2, 0.0)) * np.sign(roots.imag)
        return np.asarray(np.where(roots.imag == 0.0, -size, -decay + 1j * turn))
