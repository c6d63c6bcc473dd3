"""The residual that a fit leaves of the record itself, line by line and sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.algebra.elimination import fitted_beside
from tactuator.identification.spectral.hold import edge_lines, transient_columns
from tactuator.identification.spectral.joined import equation_slices
from tactuator.identification.spectral.likelihood import SpectralFit, SpectralProblem, beside_columns
from tactuator.identification.spectral.lines import Equations, Spectrum, equations
from tactuator.identification.spectral.noise import weights
from tactuator.identification.spectral.search import Choice
from tactuator.identification.spectral.uncertainty import response_on


@dataclass(frozen=True, eq=False)
class Residual:
    """A fit's residual. lines: of position less model and transient, zero first; weight: one over their noise's
    deviation; response: the fit's, hold included, on the lines but zero; taken: the record's lines.
    """

    lines: ComplexArray
    weight: FloatArray
    response: ComplexArray
    taken: Spectrum

    @cached_property
    def measured(self) -> FloatArray:
        """Return the position's samples, shifted and without mean, (n,)."""
        return self._samples(np.concatenate([[0.0], self.taken.position[1:]]))

    @cached_property
    def simulated(self) -> FloatArray:
        """Return the samples of model and transient, (n,)."""
        return self.measured - self._samples(self.lines)

    def _samples(self, lines: ComplexArray) -> FloatArray:
        return np.asarray(np.fft.irfft(lines, self.taken.samples) * np.sqrt(self.taken.samples))


def record_residual(choice: Choice, spectra: Sequence[Spectrum]) -> tuple[Residual, ...]:
    """Return the residual of the chosen fit on the lines of every record that it was fitted to."""
    given, weight = choice.problem.given, choice.problem.weight
    pieces = zip(given.parts, equation_slices(given), spectra, strict=True)
    return tuple(line_residual(choice.fit, part, weight[piece], taken) for part, piece, taken in pieces)


def residual_of_record(fit: SpectralFit, taken: Spectrum) -> Residual:
    """Return the residual of a fit that comes from elsewhere on all lines of a record, weighted by its own spectrum."""
    part = equations(taken, 0.0, 0.5 * taken.rate_hz)
    grid = replace(fit.grid, frequency_hz=part.frequency_hz, rate_hz=part.rate_hz, shift=part.shift)
    flat = SpectralProblem(part, np.ones(part.of_hz.size), grid)
    return line_residual(fit, part, weights(part, flat.residual(fit), 0.5 * taken.rate_hz), taken)


def line_residual(fit: SpectralFit, given: Equations, weight: FloatArray, taken: Spectrum) -> Residual:
    """Return the residual of a fit on all lines of one record, the transient solved for on its weighted equations."""
    grid = taken.grid.like(fit.grid.scale_rad_s, fit.grid.hold)
    response = response_on(fit, grid)
    moved = response * taken.ahead * taken.command[1:]
    there = replace(fit.grid, frequency_hz=given.frequency_hz, rate_hz=given.rate_hz, shift=given.shift)
    columns = given.transient_of(beside_columns(there, fit.theta, fit.form))
    own = response_on(fit, there)
    weights = fitted_beside(columns, given.goal - given.response_of(own[:, None])[:, 0], weight)
    decays = transient_columns(grid, fit.theta, fit.form)
    first = decays.shape[1]
    moved = moved + decays @ weights[:first] + edge_lines(weights[first:], taken.samples)[1:]
    left = np.concatenate([[0.0], taken.position[1:] - moved])
    order = np.argsort(given.of_hz, kind="stable")
    spread = np.interp(taken.frequency_hz, given.of_hz[order], weight[order])
    return Residual(left, spread, response, taken)
