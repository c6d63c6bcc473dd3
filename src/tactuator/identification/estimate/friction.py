"""Friction in a record: its Coulomb level and presliding distance, by what they explain of the residual."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.descent import Minimum
from tactuator.identification.estimate.loops import dahl_state
from tactuator.identification.estimate.prediction import Model, Problem, Projector
from tactuator.identification.estimate.structure import Structure

_CERTAIN = 30.0
"""A squared t value: below it no friction is claimed."""


@dataclass(frozen=True)
class Friction:
    """Levels in units of command, with their 95 % half-widths.

    coulomb: what friction takes. presliding: units of position over which it builds up after a reversal (Dahl); None
    where the record cannot tell. offset: command that stands against a steady pull. small_command: amplitude of a slow
    command of which friction takes 1 dB.
    """

    coulomb: float
    confidence: float
    presliding: float | None
    offset: float = 0.0
    offset_confidence: float = 0.0

    @property
    def small_command(self) -> float:
        """Return the level by the describing function of Coulomb friction, 4 c/(pi U), in phase with the command at
        worst.
        """
        return float(4.0 * self.coulomb / np.pi / (1.0 - 10.0 ** (-1.0 / 20.0)))


def seen_presliding(presliding: float, position: FloatArray) -> float | None:
    """Return the presliding distance, or None where the position (n,) passes more than it in a usual (median) sample.

    Friction then builds up between two samples, and only that it is short can be seen.
    """
    return presliding if presliding > float(np.median(np.abs(np.diff(position)))) else None


class FrictionSearch:
    """The share of a fit's residual that friction along a path would explain, everything else
    refitted to first order.

    cost: the squared error without it.
    """

    def __init__(self, problem: Problem, structure: Structure, minimum: Minimum, path: FloatArray) -> None:
        """Keep what every trial shares. problem: without friction and not whitened; minimum: of it, or near it; path:
        noise-free position (n,).
        """
        bare = replace(problem, friction=None)
        self._path, self._skip = path, problem.skip
        self._model = Model(bare, structure, minimum.theta, 0.0)
        nuisance = self._model.nuisance()
        self._residual, level = Projector(nuisance, bare.skip).apply(bare.position - self._model.output())
        self._known = np.hstack([nuisance, self._model.derivatives(level)])[bare.skip :]
        gram = self._known.T @ self._known
        self._size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        self._inverse = np.linalg.pinv(gram / np.outer(self._size, self._size), rcond=1e-12, hermitian=True)
        self.cost = float(self._residual @ self._residual)
        self._tried: dict[float, tuple[float, float]] = {}

    def gain(self, presliding: float) -> tuple[float, float]:
        """Drop of the squared error, and the Coulomb level that brings it (0, 0 where it would be negative)."""
        if presliding not in self._tried:
            self._tried[presliding] = self._gain(presliding)
        return self._tried[presliding]

    def _gain(self, presliding: float) -> tuple[float, float]:
        column = self._model.resistance(dahl_state(self._path, presliding))[self._skip :]
        left = column - self._known @ self._explained(column)
        power = float(left @ left)
        pull = float(left @ self._residual)
        if pull <= 0.0 or power <= 1e-9 * float(column @ column):
            return 0.0, 0.0
        return pull**2 / power, pull / power

    def _explained(self, values: FloatArray) -> FloatArray:
        goal = (self._known.T @ values) / self._size
        return np.asarray(self._inverse @ goal / self._size)

    def best(self, low: float, high: float, count: int, refinements: int = 3) -> tuple[float, float, float]:
        """Return the presliding distance within low .. high that explains most, its gain and its level."""
        for x in np.geomspace(low, high, count):
            self.gain(float(x))
        ratio = (high / low) ** (1.0 / (count - 1))
        for _ in range(refinements):
            ratio = float(np.sqrt(ratio))
            centre = max(self._tried, key=lambda x: self._tried[x][0])
            self.gain(centre / ratio)
            self.gain(centre * ratio)
        chosen = max(self._tried, key=lambda x: self._tried[x][0])
        return chosen, *self._tried[chosen]


def certain(gain: float, cost: float, count: int) -> bool:
    """Tell whether a drop of the squared error is more than chance and more than a trifle."""
    return gain > max(_CERTAIN * cost / count, 1e-3 * cost)
