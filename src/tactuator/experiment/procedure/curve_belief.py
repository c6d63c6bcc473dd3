"""Belief about threshold curves between trials, and the choice of the next trial that tells most.

The belief is a mixture. Each component is one kind of curve, one psychometric slope and one lapse rate, with a Gaussian
over the curve's points. A response changes a component by moment matching (assumed-density filtering; Minka 2001): the
marginal at the trial's frequency is multiplied by psi, its mean and variance are taken by quadrature, and the rest of
the curve follows by its covariance. The probability of the response weighs the component. The next trial is the one
that is expected to take most off the variance of the whole curve, disagreement between components included. Many runs
are computed at once; a single run is a batch of one.

Learnt one after the other, the first trials shape a belief by the little that was known when they came: a lucky guess
at a low level is never taken back. Now and then, and every 25 trials, every component is therefore refined from all
trials so far together, by expectation propagation. As trials lie at a few points, the likelihood of all of them is a
product of one function for each point, kept here on a grid of levels. Each is replaced by a Gaussian site, adjusted in
turn to the marginal that the others leave (Minka 2001; Rasmussen & Williams 2006, section 3.6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.procedure import Answering

_LEVEL_DB = np.arange(-48.0, 72.0, 0.75)
"""Thresholds at which likelihoods are kept: a sum at this step is exact to 1 % for a spread of 0.4 dB or more."""
_POWERS = np.stack([np.ones_like(_LEVEL_DB), _LEVEL_DB, _LEVEL_DB**2], axis=1)

_SWEEPS = 5
_DAMPING = 0.6
_LEAST_PRECISION = 1e-8
_LEAST_CAVITY_PRECISION = 1e-3
_SETTLED_DB = 1.0
"""Movement of a mean in the last sweep above which a component is not taken from the refinement."""


class PointLikelihoods:
    """Log likelihood of all trials at each point for each threshold on a grid, (runs, answerings, points, levels).

    The psychometric functions are in the order of slopes, then lapses.
    """

    def __init__(self, answering: Answering, runs: int, points: int) -> None:
        self._answering = answering
        self._slope = np.repeat(answering.slopes, len(answering.lapses))[:, None]
        self._lapse = np.tile(answering.lapses, len(answering.slopes))[:, None]
        self.log_likelihood: FloatArray = np.zeros((runs, self._slope.size, points, _LEVEL_DB.size))
        self.seen: NDArray[np.bool_] = np.zeros((runs, points), dtype=bool)

    def learn(self, point: NDArray[np.intp], level_db_sl: FloatArray, correct: NDArray[np.bool_]) -> None:
        """Learn the outcome of one trial of every run; arguments (runs,)."""
        runs = np.arange(point.size)
        psi = self._answering.psi(level_db_sl[:, None, None] - _LEVEL_DB, self._slope, self._lapse)
        self.log_likelihood[runs, :, point] += np.log(np.where(correct[:, None, None], psi, 1.0 - psi))
        self.seen[runs, point] = True


@dataclass(frozen=True)
class Sites:
    """Gaussian sites in place of the likelihoods, (n, points) each: exp(shift g - precision g^2 / 2), g in dB SL."""

    precision: FloatArray
    shift: FloatArray


@dataclass(frozen=True)
class Refined:
    """Refined components, (n, ...). log_evidence: of all trials, (n,). settled: those that may be used, (n,)."""

    mean: FloatArray
    covariance: FloatArray
    log_evidence: FloatArray
    sites: Sites
    settled: NDArray[np.bool_]


def refine(
    prior_mean: FloatArray,
    prior_covariance: FloatArray,
    log_likelihood: FloatArray,
    seen: NDArray[np.bool_],
    sites: Sites,
) -> Refined:
    """Refine n components from their sites, and return them with their evidence.

    prior_mean: (n, points). prior_covariance: (n, points, points). log_likelihood: (n, points, levels) of
    PointLikelihoods. seen: (n, points), points that had trials. sites: where to begin; zeros where nothing is known.
    """
    mean, covariance, log_root = _posterior(prior_mean, prior_covariance, sites)
    moved = np.full(len(mean), np.inf)
    for _ in range(_SWEEPS):
        cavity_mean, cavity_variance = _cavity(mean, covariance, sites)
        _, tilted_mean, tilted_variance = _tilted(log_likelihood, cavity_mean, cavity_variance)
        precision = np.maximum(1.0 / tilted_variance - 1.0 / cavity_variance, _LEAST_PRECISION)
        shift = tilted_mean * (precision + 1.0 / cavity_variance) - cavity_mean / cavity_variance
        sites = Sites(
            _DAMPING * np.where(seen, precision, 0.0) + (1.0 - _DAMPING) * sites.precision,
            _DAMPING * np.where(seen, shift, 0.0) + (1.0 - _DAMPING) * sites.shift,
        )
        before = mean
        mean, covariance, log_root = _posterior(prior_mean, prior_covariance, sites)
        moved = np.abs(mean - before).max(axis=1)
    cavity_mean, cavity_variance = _cavity(mean, covariance, sites)
    log_mass, _, _ = _tilted(log_likelihood, cavity_mean, cavity_variance)
    of_sites = _log_mass_of_sites(cavity_mean, cavity_variance, sites)
    along = sites.shift - sites.precision * prior_mean
    quadratic = np.einsum("np,npq,nq->n", along, covariance, along)
    linear = (sites.shift * prior_mean - 0.5 * sites.precision * prior_mean**2).sum(axis=1)
    evidence = np.where(seen, log_mass - of_sites, 0.0).sum(axis=1) + linear + 0.5 * quadratic - log_root
    settled = (moved < _SETTLED_DB) & np.isfinite(evidence)
    return Refined(mean, covariance, evidence, sites, settled)


def _posterior(
    prior_mean: FloatArray, prior_covariance: FloatArray, sites: Sites
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, covariance and half the log determinant of 1 + K T, for sites of precision T >= 0."""
    root = np.sqrt(sites.precision)
    scaled = prior_covariance * root[:, None, :]
    lower = np.linalg.cholesky(np.eye(root.shape[1]) + root[:, :, None] * scaled)
    half = np.linalg.solve(lower, scaled.transpose(0, 2, 1))
    covariance = prior_covariance - half.transpose(0, 2, 1) @ half
    shift = sites.shift - sites.precision * prior_mean
    mean = prior_mean + np.einsum("npq,nq->np", covariance, shift)
    return mean, covariance, np.log(np.einsum("npp->np", lower)).sum(axis=1)


def _cavity(mean: FloatArray, covariance: FloatArray, sites: Sites) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of each point without its own site, (n, points) each."""
    alone = 1.0 / np.einsum("npp->np", covariance)
    variance = 1.0 / np.maximum(alone - sites.precision, _LEAST_CAVITY_PRECISION)
    return variance * (mean * alone - sites.shift), variance


def _tilted(
    log_likelihood: FloatArray, mean: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return log mass, mean and variance of likelihood times Gaussian at each point, (n, points) each."""
    density = _LEVEL_DB - mean[..., None]
    density *= density
    density *= (-0.5 / variance)[..., None]
    density += log_likelihood
    highest = density.max(axis=-1, keepdims=True)
    density -= highest
    moments = np.exp(density, out=density) @ _POWERS
    mass, first, second = moments[..., 0], moments[..., 1] / moments[..., 0], moments[..., 2] / moments[..., 0]
    step = _LEVEL_DB[1] - _LEVEL_DB[0]
    log_mass = highest[..., 0] + np.log(mass * step) - 0.5 * np.log(2.0 * np.pi * variance)
    return log_mass, first, np.maximum(second - first**2, 0.02)


def _log_mass_of_sites(mean: FloatArray, variance: FloatArray, sites: Sites) -> FloatArray:
    """Return the log of the integral of each site times the Gaussian of its cavity, (n, points)."""
    tau, nu = sites.precision, sites.shift
    spread = 1.0 + tau * variance
    return np.asarray(-0.5 * np.log(spread) + (nu**2 * variance + 2.0 * nu * mean - tau * mean**2) / (2.0 * spread))


OFFSETS_DB = (-12.0, -6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0, 8.0, 11.0, 14.0, 20.0)
"""Levels that are tried, relative to the present estimate at each frequency.

The outermost tell a person of frequent lapses, who misses loud ones too, from one of a higher threshold.
"""

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_FINE_NODES, _FINE_WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
_FINE_WEIGHTS = _FINE_WEIGHTS / _FINE_WEIGHTS.sum()
"""Nodes for learning are finer: psi rises within a few decibels, and a marginal may be twenty wide."""

_CHOOSING_COMPONENTS = 24
"""Number of components that choose a trial: the heaviest of every lapse rate."""
_CHOOSING_POWER = 0.5
"""Power of the weights where trials are chosen, so that a kind not ruled out still counts."""
_READING_POWER = 0.75
"""Power of the weights where the curve and its band are computed.

With 1, the band of a person with a notch held 0.94 of the curve; with 0.5, somebody 30 dB above the display's curve
came out 1.5 dB too good; with 0.75 it is 0.96 and 0.6 dB (25 runs of 150 trials each).
"""
_COMPONENTS_KEPT = {12: 160, 25: 72, 50: 40, 75: 32}
"""Number of components kept after that many trials; those dropped had next to no weight."""
_FIRST_REFINEMENT = 12
_REFINED_EVERY = 25
_JUDGING_COMPONENTS = 32
"""Number of components from which the evidence of other likelihoods is computed: those that a long run keeps."""
_REFINED_AT_ONCE = 128
"""Components that are refined together: their arrays fit a processor's cache."""


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
        shares = (
            np.array([curve_kind.share for curve_kind in prior.kinds])[kind] * np.array(answering.lapse_shares)[lapse]
        )
        start = np.array(
            [curve_kind.covariance(frequency_hz, frequency_hz, prior.middle_hz) for curve_kind in prior.kinds]
        )
        self._start: FloatArray = start + 1e-6 * np.eye(frequency_hz.size)
        self._start_mean: FloatArray = np.array([people.mean_db for people in prior.kinds])
        self._log_share: FloatArray = np.log(shares / shares.sum())
        size = (runs, len(parts))
        self._part = np.broadcast_to(np.arange(len(parts)), size)
        self.kind = np.broadcast_to(kind, size)
        self.slope: FloatArray = np.broadcast_to(slope, size)
        self.lapse: FloatArray = np.broadcast_to(np.array(answering.lapses)[lapse], size)
        self.mean: FloatArray = np.broadcast_to(self._start_mean[kind, None], (*size, frequency_hz.size)).copy()
        self.covariance: FloatArray = np.broadcast_to(self._start[kind], (*size, *self._start.shape[1:])).copy()
        self.log_weight: FloatArray = np.broadcast_to(self._log_share, size).copy()
        self._likelihoods = PointLikelihoods(answering, runs, frequency_hz.size)
        self._precision, self._shift = np.zeros(self.mean.shape), np.zeros(self.mean.shape)
        self.log_chance: FloatArray = np.zeros(runs)
        self.trials = 0

    @property
    def weight(self) -> FloatArray:
        """Return the probability of each component, (runs, components)."""
        relative = np.exp(self.log_weight - self.log_weight.max(axis=1, keepdims=True))
        return np.asarray(relative / relative.sum(axis=1, keepdims=True))

    def _tempered(self, power: float) -> FloatArray:
        tempered = self.weight**power
        return np.asarray(tempered / tempered.sum(axis=1, keepdims=True))

    @property
    def log_bayes_factor(self) -> FloatArray:
        """Return the log evidence for a threshold curve against guessing throughout, (runs,)."""
        highest = self.log_weight.max(axis=1)
        return np.asarray(highest + np.log(np.exp(self.log_weight - highest[:, None]).sum(axis=1)) - self.log_chance)

    def share_of_lapses(self, above: float) -> FloatArray:
        """Return the probability of a lapse rate above the given one, (runs,)."""
        return np.asarray(np.where(self.lapse > above, self.weight, 0.0).sum(axis=1))

    def curve(self, frequency_hz: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation at the frequencies, dB SL, (runs, frequencies) each.

        Components are mixed by their tempered weight.
        """
        others = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        weight = self._tempered(_READING_POWER)
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
        row = np.arange(self.runs)[:, None]
        top, share = self.choosing()
        mean = np.einsum("rk,rkg->rg", share, self.mean[row, top])
        levels = np.round(2.0 * (mean[:, :, None] + np.array(OFFSETS_DB))) / 2.0
        levels = np.clip(levels, floor_db_sl, ceiling_db_sl)
        gain = self._expected_gain(levels, row, top, share).reshape(self.runs, -1)
        best = np.argmax(gain, axis=1)
        return best // levels.shape[2], levels.reshape(self.runs, -1)[np.arange(self.runs), best]

    def choosing(self) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the components that choose a trial and their shares, (runs, chosen) each.

        Every lapse rate chooses with the weight of all its components. The heaviest of all alone would agree on a low
        rate, and would then never play what tells frequent lapses from a higher threshold.
        """
        tempered, rates = self._tempered(_CHOOSING_POWER), self.answering.lapses
        each = min(max(1, _CHOOSING_COMPONENTS // len(rates)), tempered.shape[1])
        row, tops, shares = np.arange(self.runs)[:, None], [], []
        for rate in rates:
            of_rate = np.where(self.lapse == rate, tempered, 0.0)
            top = np.argpartition(-of_rate, each - 1, axis=1)[:, :each]
            heaviest = of_rate[row, top]
            tops.append(top)
            shares.append(heaviest * (of_rate.sum(axis=1) / np.maximum(heaviest.sum(axis=1), 1e-300))[:, None])
        share = np.concatenate(shares, axis=1)
        return np.concatenate(tops, axis=1), np.asarray(share / share.sum(axis=1, keepdims=True))

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
        narrowed = likelihood @ (_FINE_WEIGHTS * _FINE_NODES**2) / evidence - shift**2
        along = self.covariance[rows, :, :, point] / sd[..., None]
        self.log_weight = self.log_weight + np.log(evidence)
        self.log_chance = self.log_chance + self.answering.log_chance(correct)
        self.mean = self.mean + along * shift[..., None]
        self.covariance -= (along * (1.0 - narrowed)[..., None])[..., :, None] * along[..., None, :]
        self._likelihoods.learn(point, level_db_sl, correct)
        self.trials += 1
        if self.trials == _FIRST_REFINEMENT or self.trials % _REFINED_EVERY == 0:
            self._refine()
        if self.trials in _COMPONENTS_KEPT:
            self._keep(_COMPONENTS_KEPT[self.trials])

    def _refine(self) -> None:
        """Refine every component from all trials; one that does not settle stays as it was learnt."""
        runs, components = np.indices(self.log_weight.shape).reshape(2, -1)
        for first in range(0, runs.size, _REFINED_AT_ONCE):
            at = runs[first : first + _REFINED_AT_ONCE], components[first : first + _REFINED_AT_ONCE]
            refined = self._refined(at, self._likelihoods, Sites(self._precision[at], self._shift[at]))
            self._precision[at], self._shift[at] = refined.sites.precision, refined.sites.shift
            settled = refined.settled
            use = at[0][settled], at[1][settled]
            self.mean[use], self.covariance[use] = refined.mean[settled], refined.covariance[settled]
            self.log_weight[use] = self._log_share[self._part[use]] + refined.log_evidence[settled]

    def _refined(
        self, at: tuple[NDArray[np.intp], NDArray[np.intp]], likelihoods: PointLikelihoods, begin: Sites
    ) -> Refined:
        """Return the components at (runs, components), (n,) each, refined from these likelihoods."""
        kind, answerings = self.kind[at], len(self.answering.slopes) * len(self.answering.lapses)
        start_mean = np.broadcast_to(self._start_mean[kind, None], (kind.size, self.mean.shape[2]))
        likelihood = likelihoods.log_likelihood[at[0], self._part[at] % answerings]
        return refine(start_mean, self._start[kind], likelihood, likelihoods.seen[at[0]], begin)

    def log_evidence(self, likelihoods: Sequence[PointLikelihoods]) -> FloatArray:
        """Return the log evidence for a curve if the trials had these likelihoods, (runs, likelihoods).

        It is that of the _JUDGING_COMPONENTS heaviest components, without those that do not settle with every one of
        the likelihoods. The first are likely ones: the others begin where it settled.
        """
        count = min(_JUDGING_COMPONENTS, self.log_weight.shape[1])
        top = np.argsort(-self.log_weight, axis=1, kind="stable")[:, :count]
        runs, components = np.repeat(np.arange(self.runs), count), top.reshape(-1)
        evidences = np.full((runs.size, len(likelihoods)), -np.inf)
        for first in range(0, runs.size, _REFINED_AT_ONCE):
            part = slice(first, first + _REFINED_AT_ONCE)
            at = runs[part], components[part]
            begin = Sites(np.zeros_like(self._precision[at]), np.zeros_like(self._shift[at]))
            begin = self._refined(at, likelihoods[0], begin).sites
            refined = [self._refined(at, each, begin) for each in likelihoods]
            share = self._log_share[self._part[at]][:, None]
            evidence = share + np.stack([each.log_evidence for each in refined], axis=1)
            settled = np.all([each.settled for each in refined], axis=0)
            evidences[part] = np.where(settled[:, None], evidence, -np.inf)
        return np.asarray(scipy.special.logsumexp(evidences.reshape(self.runs, count, -1), axis=1))

    def _keep(self, count: int) -> None:
        """Keep the `count` heaviest components of every run and drop the others."""
        if count >= self.log_weight.shape[1]:
            return
        top = np.argsort(-self.log_weight, axis=1, kind="stable")[:, :count]
        row = np.arange(self.runs)[:, None]
        for name in ("_part", "kind", "slope", "lapse", "mean", "covariance", "log_weight", "_precision", "_shift"):
            setattr(self, name, getattr(self, name)[row, top])
