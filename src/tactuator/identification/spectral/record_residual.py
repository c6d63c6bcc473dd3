"""The residual that a fit leaves of the record itself, line by line and sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.spectral.hold import edge_lines, transient_columns
from tactuator.identification.spectral.joined import equation_slices
from tactuator.identification.spectral.likelihood import (
    SpectralFit,
    SpectralProblem,
    beside_columns,
    fitted_beside,
)
from tactuator.identification.spectral.lines import Equations, Spectrum, equations
from tactuator.identification.spectral.noise import weights
from tactuator.identification.spectral.search import Choice
from tactuator.identification.spectral.uncertainty import response_of_rows


@dataclass(frozen=True, eq=False)
class Residual:
    """A fit's residual. lines: of position less model and transient, zero first; weight: one over their noise's
    deviation; response: the fit's, hold included, on the lines but zero; simulated, measured: samples of the shifted
    record, without mean, (n,).
    """

    lines: ComplexArray
    weight: FloatArray
    response: ComplexArray
    simulated: FloatArray
    measured: FloatArray


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
    hertz = taken.frequency_hz[1:]
    ahead = np.exp(2j * np.pi * hertz * taken.shift / taken.rate_hz)
    response = response_of_rows(fit, hertz)
    moved = response * ahead * taken.command[1:]
    grid = replace(fit.grid, frequency_hz=given.frequency_hz, rate_hz=given.rate_hz, shift=given.shift)
    columns = given.transient_of(beside_columns(grid, fit.theta, fit.form))
    own = response_of_rows(fit, given.frequency_hz)
    own = own * np.exp(2j * np.pi * given.frequency_hz * given.shift / given.rate_hz)
    weights = fitted_beside(columns, given.goal - given.response_of(own[:, None])[:, 0], weight)
    decays = transient_columns(replace(grid, frequency_hz=hertz), fit.theta, fit.form)
    first = decays.shape[1]
    moved = moved + decays @ weights[:first] + edge_lines(weights[first:], taken.samples)[1:]
    left = np.concatenate([[0.0], taken.position[1:] - moved])
    whole = np.concatenate([[0.0], moved])
    order = np.argsort(given.of_hz, kind="stable")
    spread = np.interp(taken.frequency_hz, given.of_hz[order], weight[order])
    root = np.sqrt(taken.samples)
    measured = np.concatenate([[0.0], taken.position[1:]])
    return Residual(
        left, spread, response, np.fft.irfft(whole, taken.samples) * root, np.fft.irfft(measured, taken.samples) * root
    )
