"""Belief about threshold curves between trials, and the choice of the next trial that tells most.

The belief is a mixture. Each component is one kind of curve, one psychometric slope and one lapse rate, with a Gaussian
over the curve's points. A response changes a component by moment matching (assumed-density filtering; Minka 2001): the
marginal at the trial's frequency is multiplied by psi, its mean and variance are taken by quadrature, and the rest of
the curve follows by its covariance. The probability of the response weighs the component. The next trial is the one
that is expected to take most off the variance of the whole curve, disagreement between components included. Many runs
are computed at once; a single run is a batch of one.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.answering import Answering
from tactuator.experiment.procedure.whole_curve.curve_prior import CurvePrior

OFFSETS_DB = (-6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0, 8.0, 11.0, 14.0)
"""Levels that are tried, relative to the present estimate at each frequency."""

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_FINE_NODES, _FINE_WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
_FINE_WEIGHTS = _FINE_WEIGHTS / _FINE_WEIGHTS.sum()
"""Nodes for learning are finer: psi rises within a few decibels, and a marginal may be twenty wide."""

_CHOOSING_COMPONENTS = 10
"""Number of components, the heaviest, that choose a trial."""
_TEMPERING_POWER = 0.5
"""Power of the weights where trials are chosen and the band is computed, so that a kind not ruled out still counts.

With 1, a band was the narrow one of a smooth curve too often where the truth was wavy or the person lapsed (coverage
0.85 and 0.89); with 0.5 it is 0.89 and 0.97, and normal people's estimates are 0.02 dB worse.
"""
_COMPONENTS_KEPT = {25: 96, 50: 48, 80: 32}
"""Number of components kept after that many trials; those dropped had next to no weight."""


class CurveBelief:
    """Belief of several runs: a mixture of Gaussian components over the curve's points.

    mean: (runs, components, points), dB SL. covariance: (runs, components, points, points). log_weight: (runs,
    components), not normalised; with log_chance, (runs,), it carries the evidence for the model against guessing. kind
    (an index into prior.kinds), slope, lapse: (runs, components).
    """

    def __init__(self, prior: CurvePrior, answering: Answering, runs: int = 1) -> None:
        self.prior, self.answering, self.runs = prior, answering, runs
        frequency_hz = prior.frequency_hz
        parts = list(product(range(len(prior.kinds)), answering.slopes, range(len(answering.lapses))))
        kind, slope, lapse = (np.array(column) for column in zip(*parts, strict=True))
        shares = np.array([one.share for one in prior.kinds])[kind] * np.array(answering.lapse_shares)[lapse]
        start = np.array([one.covariance(frequency_hz, frequency_hz, prior.middle_hz) for one in prior.kinds])
        start = start + 1e-6 * np.eye(frequency_hz.size)
        means = np.array([one.mean_db for one in prior.kinds])[kind]
        size = (runs, len(parts))
        self.kind = np.broadcast_to(kind, size)
        self.slope: FloatArray = np.broadcast_to(slope, size)
        self.lapse: FloatArray = np.broadcast_to(np.array(answering.lapses)[lapse], size)
        self.mean: FloatArray = np.broadcast_to(means[:, None], (*size, frequency_hz.size)).copy()
        self.covariance: FloatArray = np.broadcast_to(start[kind], (*size, *start.shape[1:])).copy()
        self.log_weight: FloatArray = np.broadcast_to(np.log(shares / shares.sum()), size).copy()
        self.log_chance: FloatArray = np.zeros(runs)
        self.trials = 0

    @property
    def weight(self) -> FloatArray:
        """Return the probability of each component, (runs, components)."""
        relative = np.exp(self.log_weight - self.log_weight.max(axis=1, keepdims=True))
        return np.asarray(relative / relative.sum(axis=1, keepdims=True))

    def _tempered(self) -> FloatArray:
        tempered = self.weight**_TEMPERING_POWER
        return np.asarray(tempered / tempered.sum(axis=1, keepdims=True))

    @property
    def log_bayes_factor(self) -> FloatArray:
        """Return the log evidence for a threshold curve against guessing throughout, (runs,)."""
        highest = self.log_weight.max(axis=1)
        return np.asarray(highest + np.log(np.exp(self.log_weight - highest[:, None]).sum(axis=1)) - self.log_chance)

    def share_of_kinds(self) -> dict[str, FloatArray]:
        """Return the probability of each kind of curve by its name, (runs,) each."""
        weight, found = self.weight, dict[str, FloatArray]()
        for index, kind in enumerate(self.prior.kinds):
            share = np.where(self.kind == index, weight, 0.0).sum(axis=1)
            found[kind.name] = found.get(kind.name, np.zeros(self.runs)) + share
        return found

    def share_of_lapses(self, above: float) -> FloatArray:
        """Return the probability of a lapse rate above the given one, (runs,)."""
        return np.asarray(np.where(self.lapse > above, self.weight, 0.0).sum(axis=1))

    def curve(self, frequency_hz: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation at the frequencies, dB SL, (runs, frequencies) each.

        Components are mixed by their tempered weight.
        """
        others = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        weight = self._tempered()
        mean, square = np.zeros((self.runs, others.size)), np.zeros((self.runs, others.size))
        for index in np.unique(self.kind):
            kind = self.prior.kinds[index]
            run, component = np.nonzero((self.kind == index) & (weight > 1e-6))
            if run.size == 0:
                continue
            across, between = kind.between(self.prior.frequency_hz, others, self.prior.middle_hz)
            level = kind.mean_db + (self.mean[run, component] - kind.mean_db) @ across.T
            spread = np.einsum("og,cgo->co", across, self.covariance[run, component] @ across.T) + between
            share = weight[run, component][:, None]
            np.add.at(mean, run, share * level)
            np.add.at(square, run, share * (spread + level**2))
        total = np.where(weight > 1e-6, weight, 0.0).sum(axis=1)[:, None]
        mean, square = mean / total, square / total
        return mean, np.sqrt(np.maximum(square - mean**2, 1e-12))

    def choose(self, floor_db_sl: float, ceiling_db_sl: float) -> tuple[NDArray[np.intp], FloatArray]:
        """Return point (index) and level (to half a dB) of the most telling trial of every run, (runs,) each."""
        tempered = self._tempered()
        chosen = min(_CHOOSING_COMPONENTS, tempered.shape[1])
        top = np.argpartition(-tempered, chosen - 1, axis=1)[:, :chosen]
        row = np.arange(self.runs)[:, None]
        share = tempered[row, top] / tempered[row, top].sum(axis=1, keepdims=True)
        mean = np.einsum("rk,rkg->rg", share, self.mean[row, top])
        levels = np.round(2.0 * (mean[:, :, None] + np.array(OFFSETS_DB))) / 2.0
        levels = np.clip(levels, floor_db_sl, ceiling_db_sl)
        gain = self._expected_gain(levels, row, top, share).reshape(self.runs, -1)
        best = np.argmax(gain, axis=1)
        return best // levels.shape[2], levels.reshape(self.runs, -1)[np.arange(self.runs), best]

    def _expected_gain(
        self, levels: FloatArray, row: NDArray[np.intp], top: NDArray[np.intp], share: FloatArray
    ) -> FloatArray:
        """Return the expected fall of the mixture's variance summed over the curve, (runs, points, levels).

        The mean of the curve after an outcome y is N_y / p_y. The variance that is left is what all trials share less
        the sum of |N_y|^2 / p_y; with N taken about the present mean the sum is |N|^2 / (p (1 - p)), N being that of a
        right answer.
        """
        mean, covariance = self.mean[row, top], self.covariance[row, top]
        sd = np.sqrt(np.einsum("rkgg->rkg", covariance))
        threshold = mean[..., None] + sd[..., None] * _NODES
        slope, lapse = (values[row, top][:, :, None, None, None] for values in (self.slope, self.lapse))
        psi = self.answering.psi(levels[:, None, :, :, None] - threshold[:, :, :, None, :], slope, lapse)
        right = share[:, :, None, None] * (psi @ _WEIGHTS)
        tilted = share[:, :, None, None] * (psi @ (_WEIGHTS * _NODES))
        about = mean - np.einsum("rk,rkg->rg", share, mean)[:, None]
        runs, components, points = mean.shape
        apart = (about.transpose(0, 2, 1) @ right.reshape(runs, components, -1)).reshape(runs, points, points, -1)
        along = (covariance / sd[:, :, None, :]).transpose(0, 3, 2, 1) @ tilted.transpose(0, 2, 1, 3)
        moved = apart + along.transpose(0, 2, 1, 3)
        chance = right.sum(axis=1)
        return np.asarray((moved**2).sum(axis=1) / (chance * (1.0 - chance)))

    def learn(self, point: NDArray[np.intp], level_db_sl: FloatArray, correct: NDArray[np.bool_]) -> None:
        """Learn the outcome of one trial of every run; arguments (runs,)."""
        rows = np.arange(self.runs)
        sd = np.sqrt(self.covariance[rows, :, point, point])
        threshold = self.mean[rows, :, point][..., None] + sd[..., None] * _FINE_NODES
        psi = self.answering.psi(level_db_sl[:, None, None] - threshold, self.slope[..., None], self.lapse[..., None])
        likelihood = np.where(correct[:, None, None], psi, 1.0 - psi)
        evidence = likelihood @ _FINE_WEIGHTS
        shift = likelihood @ (_FINE_WEIGHTS * _FINE_NODES) / evidence
        left = likelihood @ (_FINE_WEIGHTS * _FINE_NODES**2) / evidence - shift**2
        along = self.covariance[rows, :, :, point] / sd[..., None]
        self.log_weight = self.log_weight + np.log(evidence)
        self.log_chance = self.log_chance + self.answering.log_chance(correct)
        self.mean = self.mean + along * shift[..., None]
        self.covariance -= (along * (1.0 - left)[..., None])[..., :, None] * along[..., None, :]
        self.trials += 1
        if self.trials in _COMPONENTS_KEPT:
            self._keep(_COMPONENTS_KEPT[self.trials])

    def _keep(self, count: int) -> None:
        """Keep the `count` heaviest components of every run and drop the others."""
        if count >= self.log_weight.shape[1]:
            return
        top = np.argsort(-self.log_weight, axis=1, kind="stable")[:, :count]
        row = np.arange(self.runs)[:, None]
        for name in ("kind", "slope", "lapse", "mean", "covariance", "log_weight"):
            setattr(self, name, getattr(self, name)[row, top])
