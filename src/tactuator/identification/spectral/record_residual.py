"""What a fit leaves of the record itself, line by line and sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.identification.spectral.between import Grid
from tactuator.identification.spectral.likelihood import beside_columns, solve
from tactuator.identification.spectral.lines import Spectrum
from tactuator.identification.spectral.search import Choice
from tactuator.identification.spectral.uncertainty import response_of_rows

Array = NDArray[np.float64]
Complex = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Residual:
    """lines: of position less model and transient, zero first; weight: one over their noise's deviation; simulated,
    measured: samples of the shifted record, without mean, (n,)."""

    lines: Complex
    weight: Array
    simulated: Array
    measured: Array


def record_residual(choice: Choice, taken: Spectrum) -> Residual:
    """Return the residual of the chosen fit on the lines it was fitted to, the transient solved for on all of them."""
    fit, problem = choice.fit, choice.problem
    hertz = taken.frequency_hz[1:]
    ahead = np.exp(2j * np.pi * hertz * taken.shift / taken.rate_hz)
    moved = response_of_rows(fit, hertz) * ahead * taken.command[1:]
    given = problem.given
    columns = given.transient_of(beside_columns(problem.grid, fit.theta, fit.form)) * problem.weight[:, None]
    own = response_of_rows(fit, given.frequency_hz)
    own = own * np.exp(2j * np.pi * given.frequency_hz * given.shift / given.rate_hz)
    goal = (given.goal - given.response_of(own[:, None])[:, 0]) * problem.weight
    weights, _ = solve(np.concatenate([columns.real, columns.imag]), np.concatenate([goal.real, goal.imag]))
    grid = Grid(hertz, taken.rate_hz, fit.grid.scale_rad_s, choice.hold, taken.shift)
    moved = moved + beside_columns(grid, fit.theta, fit.form) @ weights
    left = np.concatenate([[0.0], taken.position[1:] - moved])
    whole = np.concatenate([[0.0], moved])
    order = np.argsort(given.of_hz, kind="stable")
    weight = np.interp(taken.frequency_hz, given.of_hz[order], problem.weight[order])
    root = np.sqrt(taken.samples)
    measured = np.concatenate([[0.0], taken.position[1:]])
    return Residual(
        left, weight, np.fft.irfft(whole, taken.samples) * root, np.fft.irfft(measured, taken.samples) * root
    )
