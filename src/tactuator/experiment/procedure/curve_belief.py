"""Belief about threshold curves between trials, and the choice of the most informative next trial.

The belief is a mixture. Each component is one kind of curve, one psychometric slope and one lapse rate, with a Gaussian
over the curve's points. A response changes a component by moment matching (assumed-density filtering; Minka 2001): the
marginal at the trial's frequency is multiplied by psi, its mean and variance are taken by quadrature, and the rest of
the curve follows by its covariance. The probability of the response weighs the component. The next trial is the one
that is expected to take most off the variance of the whole curve, disagreement between components included. Many runs
are computed at once; a single run is a batch of one.

Learnt one after the other, the first trials shape a belief by the little that was known when they came: a lucky guess
at a low level is never taken back. Every component is therefore refined now and then from all trials so far together
(curve_refinement).

Kinds with a notch or an edge are many: one for every place and width. They are not all kept. At every refinement each
is weighed by what its feature would add to the likeliest other components: with Gaussian sites in the place of the
answers, the evidence for a feature of normal amplitude is known in closed form (Rasmussen & Williams 2006, section
2.7). The likeliest are then refined and weighed as components like any other, so that a notch that nothing spoke for
early in the run can still be found late.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.curve_prior import CurvePrior, CurveReading, mixed
from tactuator.experiment.procedure.curve_refinement import PointLikelihoods, Refined, Sites, refine
from tactuator.experiment.procedure.procedure import Answering

OFFSETS_DB = (-12.0, -6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0, 8.0, 11.0, 14.0, 20.0)
"""Levels that are tried, relative to the present estimate at each frequency.

The outermost separate a person with frequent lapses, who also misses loud ones, from one with a higher threshold.
"""

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
"""Fine enough: psi rises within a few decibels, and a marginal may be twenty wide."""

_CHOOSING_COMPONENTS = 24
"""Number of components that choose a trial: the heaviest of every lapse rate."""
_CHOOSING_POWER = 0.5
"""Power of the weights where trials are chosen, so that a kind not ruled out still counts."""
_READING_POWER = 0.75
"""Power of the weights where the curve and its band are computed.

With 1, the band of a person with a notch held 0.94 of the curve; with 0.5, a person 30 dB above the display's curve
came out 1.5 dB too good; with 0.75 it is 0.96 and 0.6 dB (25 runs of 150 trials each).
"""
_LEAST_DENSITY = 0.5
"""Least number of trials at every point, as a share of what each would have if all had the same."""
UNSEEN_NOTCH_DB = 15.0
"""Depth of the notches that trials are put to exclude."""


@dataclass(frozen=True)
class _Unseen:
    """A loss that trials are put to exclude: depth, width, probability about a point, number of points it reaches."""

    depth_db: float
    decades: float
    share: float
    points: float


_UNSEEN_CHANNEL, _UNSEEN_NOTCH = _Unseen(20.0, 0.3, 0.1, 10.0), _Unseen(UNSEEN_NOTCH_DB, 0.02, 0.02, 2.0)
_NOTCHES_FROM = 45
"""Number of trials from which notches are looked for; before, losses as wide as a channel's are."""
_UNSEEN_SD_DB = 2.0
"""What the threshold beside a loss is known to when it is looked for."""
_REFINED_EVERY = 15
_FEATURES_FROM = 30
"""Number of trials from which local features are weighed: one at each point, about."""
_FEATURES_WEIGHED, _FEATURES_TAKEN = 4, 16
"""Components that a feature is weighed on, and features that become components at a refinement."""
_COMPONENTS_KEPT = 40
"""Number of components kept after a refinement; those dropped had next to no weight."""
_JUDGING_COMPONENTS = 32
"""Number of components from which the evidence of other likelihoods is computed."""
_REFINED_AT_ONCE = 128
"""Components that are refined together: their arrays fit a processor's cache."""

_FORESEEN_DB = np.arange(-60.0, 60.25, 0.5)
_FORESEEN_SD_DB = np.geomspace(0.5, 40.0, 30)


@lru_cache(maxsize=8)
def _foreseen(answering: Answering) -> FloatArray:
    """Return the mean of psi, and of psi times the deviate, over normal thresholds.

    Shape (2, answerings, standard deviations, levels above the mean); to the nearest is enough where trials are chosen.
    """
    slope, lapse = (np.array(column)[:, None, None, None] for column in answering.pairs)
    threshold = _FORESEEN_SD_DB[:, None, None] * _NODES
    psi = answering.psi(_FORESEEN_DB[:, None] - threshold, slope, lapse)
    return np.stack([psi @ _WEIGHTS, psi @ (_WEIGHTS * _NODES)])


class CurveBelief:
    """Belief of several runs: a mixture of Gaussian components over the curve's points.

    mean: (runs, components, points), dB SL. covariance: (runs, components, points, points). log_weight: (runs,
    components), not normalised; with log_chance, (runs,), it carries the evidence for the model against guessing.
    likelihoods: of all trials at each point.
    """

    def __init__(self, prior: CurvePrior, answering: Answering, runs: int = 1) -> None:
        self.prior, self.answering, self.runs = prior, answering, runs
        frequency_hz = prior.frequency_hz
        slopes, lapses = (np.array(column) for column in answering.pairs)
        self._local: NDArray[np.bool_] = np.array([kind.is_local for kind in prior.kinds])
        begun = np.flatnonzero(~self._local) if not self._local.all() else np.arange(len(prior.kinds))
        part = (begun[:, None] * slopes.size + np.arange(slopes.size)).reshape(-1)
        start = np.array([each.covariance(frequency_hz, frequency_hz, prior.middle_hz) for each in prior.kinds])
        self._start: FloatArray = start + 1e-6 * np.eye(frequency_hz.size)
        self._start_mean: FloatArray = np.array([each.mean(frequency_hz) for each in prior.kinds])
        self._feature: FloatArray = np.array([each.shape(frequency_hz) for each in prior.kinds])
        shares = np.outer([each.share for each in prior.kinds], np.tile(answering.lapse_shares, len(answering.slopes)))
        self._log_share: FloatArray = np.log(shares / shares.sum()).reshape(-1)
        self._slopes, self._lapses = slopes, lapses
        self._part = np.broadcast_to(part, (runs, part.size))
        self.mean: FloatArray = self._start_mean[self.kind]
        self.covariance: FloatArray = self._start[self.kind]
        self.log_weight: FloatArray = self._log_share[self._part]
        self.likelihoods = PointLikelihoods(answering, runs, frequency_hz.size)
        self._precision, self._shift = np.zeros(self.mean.shape), np.zeros(self.mean.shape)
        self._count: NDArray[np.intp] = np.zeros((runs, frequency_hz.size), dtype=np.intp)
        self.log_chance: FloatArray = np.zeros(runs)
        self.trials = self._refined_trials = 0

    @property
    def kind(self) -> NDArray[np.intp]:
        """Return the kind of each component, an index into prior.kinds, (runs, components)."""
        return np.asarray(self._part // self._slopes.size)

    @property
    def slope(self) -> FloatArray:
        """Return the slope of each component, (runs, components)."""
        return np.asarray(self._slopes[self._part % self._slopes.size])

    @property
    def lapse(self) -> FloatArray:
        """Return the lapse rate of each component, (runs, components)."""
        return np.asarray(self._lapses[self._part % self._slopes.size])

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

    def curve(self, frequency_hz: ArrayLike) -> CurveReading:
        """Return the curve with its band at the frequencies; components are mixed by their tempered weight."""
        asked = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        weight = self._tempered(_READING_POWER)
        share, size = np.where(weight > 1e-6, weight, 0.0), (*weight.shape, asked.size)
        level, variance = np.zeros(size), np.ones(size)
        at_points = np.array_equal(asked, self.prior.frequency_hz)
        if at_points:
            level, variance = self.mean, np.einsum("rkgg->rkg", self.covariance)
        for index in () if at_points else np.unique(self.kind[share > 0.0]).tolist():
            kind, at = self.prior.kinds[index], np.nonzero((self.kind == index) & (share > 0.0))
            across, between = kind.between(self.prior.frequency_hz, asked, self.prior.middle_hz)
            level[at] = kind.mean(asked) + (self.mean[at] - self._start_mean[index]) @ across.T
            variance[at] = np.einsum("og,cgo->co", across, self.covariance[at] @ across.T) + between
        return mixed(share / share.sum(axis=1, keepdims=True), level, np.sqrt(np.maximum(variance, 1e-12)))

    def choose(self, floor_db_sl: float, ceiling_db_sl: float) -> tuple[NDArray[np.intp], FloatArray]:
        """Return point (index) and level (to half a dB) of the most informative trial of every run, (runs,) each.

        Points that have fewer trials than their least density come first.
        """
        row = np.arange(self.runs)[:, None]
        top, share = self.choosing()
        mean = np.einsum("rk,rkg->rg", share, self.mean[row, top])
        levels = np.round(2.0 * (mean[:, :, None] + np.array(OFFSETS_DB))) / 2.0
        levels = np.clip(levels, floor_db_sl, ceiling_db_sl)
        gain = self._expected_gain(levels, row, top, share) + self._gain_of_exclusion(mean)
        few = self._count < int(_LEAST_DENSITY * self.trials / self._count.shape[1])
        gain = np.where((few | ~few.any(axis=1, keepdims=True))[..., None], gain, 0.0).reshape(self.runs, -1)
        best = np.argmax(gain, axis=1)
        return best // levels.shape[2], levels.reshape(self.runs, -1)[np.arange(self.runs), best]

    def choosing(self) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the components that choose a trial and their shares, (runs, chosen) each.

        Every lapse rate chooses with the weight of all its components. The heaviest of all alone would agree on a low
        rate, and would then never play what separates frequent lapses from a higher threshold.
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
        spread = np.searchsorted(np.sqrt(_FORESEEN_SD_DB[1:] * _FORESEEN_SD_DB[:-1]), sd)
        above = np.rint((levels[:, None] - mean[..., None] - _FORESEEN_DB[0]) / (_FORESEEN_DB[1] - _FORESEEN_DB[0]))
        row_of = (self._part[row, top] % self._slopes.size)[..., None] * _FORESEEN_SD_DB.size + spread
        place = row_of[..., None] * _FORESEEN_DB.size + np.clip(above, 0, _FORESEEN_DB.size - 1).astype(np.intp)
        right, tilted = (share[:, :, None, None] * table.reshape(-1)[place] for table in _foreseen(self.answering))
        about = mean - np.einsum("rk,rkg->rg", share, mean)[:, None]
        runs, components, points = mean.shape
        apart = (about.transpose(0, 2, 1) @ right.reshape(runs, components, -1)).reshape(runs, points, points, -1)
        along = (covariance / sd[:, :, None, :]).transpose(0, 3, 2, 1) @ tilted.transpose(0, 2, 1, 3)
        moved = apart + along.transpose(0, 2, 1, 3)
        chance = right.sum(axis=1)
        return np.asarray((moved**2).sum(axis=1) / (chance * (1.0 - chance)))

    def answered(self, power: float = 1.0) -> FloatArray:
        """Return the share of every psychometric function, (runs, answerings); power: that of the weights."""
        share = np.zeros((self.runs, self._slopes.size))
        np.add.at(share, (np.arange(self.runs)[:, None], self._part % self._slopes.size), self._tempered(power))
        return share

    def _gain_of_exclusion(self, mean: FloatArray) -> FloatArray:
        """Return the expected fall of the variance that unseen losses leave, (runs, points, levels).

        A loss below the mean, (runs, points), has the odds that the trials at and beside each point leave of its share.
        The components alone do not see to this: before anything speaks for a notch, each weighs next to nothing, and
        after three lucky guesses so does the loss of a channel.
        """
        loss = _UNSEEN_CHANNEL if self.trials < _NOTCHES_FROM else _UNSEEN_NOTCH
        share, decades = self.answered(_CHOOSING_POWER), np.log10(self.prior.frequency_hz)
        reach = np.exp(-0.5 * ((decades[:, None] - decades) / loss.decades) ** 2)
        evidence = self.likelihoods.at(mean + loss.depth_db) - self.likelihoods.at(mean)
        log_odds = scipy.special.logsumexp(evidence @ reach, axis=1, b=share[..., None])
        odds = loss.share / (1.0 - loss.share) * np.exp(np.minimum(log_odds, 5.0))
        there = (odds / (1.0 + odds))[..., None]
        foreseen = _foreseen(self.answering)[0][:, np.searchsorted(_FORESEEN_SD_DB, _UNSEEN_SD_DB)]
        without, with_loss = (
            (share @ foreseen[:, np.searchsorted(_FORESEEN_DB, np.array(OFFSETS_DB) - depth_db)])[:, None]
            for depth_db in (0.0, loss.depth_db)
        )
        chance = there * with_loss + (1.0 - there) * without
        explained = (there * (1.0 - there) * (with_loss - without)) ** 2 / (chance * (1.0 - chance))
        return np.asarray(loss.points * loss.depth_db**2 * explained)

    def learn(self, point: NDArray[np.intp], level_db_sl: FloatArray, correct: NDArray[np.bool_]) -> None:
        """Learn the outcome of one trial of every run; arguments (runs,)."""
        rows = np.arange(self.runs)
        sd = np.sqrt(self.covariance[rows, :, point, point])
        threshold = self.mean[rows, :, point][..., None] + sd[..., None] * _NODES
        psi = self.answering.psi(level_db_sl[:, None, None] - threshold, self.slope[..., None], self.lapse[..., None])
        likelihood = np.where(correct[:, None, None], psi, 1.0 - psi)
        evidence = likelihood @ _WEIGHTS
        shift = likelihood @ (_WEIGHTS * _NODES) / evidence
        narrowed = likelihood @ (_WEIGHTS * _NODES**2) / evidence - shift**2
        along = self.covariance[rows, :, :, point] / sd[..., None]
        self.log_weight = self.log_weight + np.log(evidence)
        self.log_chance = self.log_chance + self.answering.log_chance(correct)
        self.mean = self.mean + along * shift[..., None]
        self.covariance -= (along * (1.0 - narrowed)[..., None])[..., :, None] * along[..., None, :]
        self.likelihoods.learn(point, level_db_sl, correct)
        self._count[rows, point] += 1
        self.trials += 1
        if self.trials % _REFINED_EVERY == 0:
            self.refine()

    def refine(self) -> None:
        """Refine every component from all trials, weigh local features, and keep the heaviest.

        A component that does not settle stays as it was learnt. After the last trial, too: what came since the last
        refinement was learnt in its order.
        """
        if self._refined_trials == self.trials:
            return
        self._refined_trials = self.trials
        at = np.indices(self.log_weight.shape)
        self._refine_at(at[0].reshape(-1), at[1].reshape(-1))
        if self.trials >= _FEATURES_FROM and self._local.any():
            added = self._add_features()
            self._refine_at(np.repeat(np.arange(self.runs), added), np.tile(np.arange(-added, 0), self.runs))
        self._keep(_COMPONENTS_KEPT)

    def _refine_at(self, runs: NDArray[np.intp], components: NDArray[np.intp]) -> None:
        for first in range(0, runs.size, _REFINED_AT_ONCE):
            at = runs[first : first + _REFINED_AT_ONCE], components[first : first + _REFINED_AT_ONCE]
            refined = self._refined(at, self.likelihoods, Sites(self._precision[at], self._shift[at]))
            self._precision[at], self._shift[at] = refined.sites.precision, refined.sites.shift
            settled = refined.settled
            use = at[0][settled], at[1][settled]
            self.mean[use], self.covariance[use] = refined.mean[settled], refined.covariance[settled]
            self.log_weight[use] = self._log_share[self._part[use]] + refined.log_evidence[settled]

    def _add_features(self) -> int:
        """Add the likeliest kinds with a local feature to every run, not yet refined, and return their number.

        Each is weighed on the heaviest components without such a feature. A feature of shape f whose amplitude is
        normal changes the evidence by the ratio of two normal integrals, in which f' (shift - T mean) is the slope and
        f' (T - T V T) f the bend, with sites of precision T and the component's covariance V.
        """
        row, answerings = np.arange(self.runs)[:, None], self._slopes.size
        others = np.where(self._local[self.kind], -np.inf, self.log_weight)
        on = np.argsort(-others, axis=1, kind="stable")[:, :_FEATURES_WEIGHED]
        local = np.flatnonzero(self._local)
        shape, kinds = self._feature[local], [self.prior.kinds[index] for index in local]
        centre, spread = (
            np.array([getattr(kind, name) for kind in kinds]) for name in ("feature_mean_db", "feature_db")
        )
        precision, shift = self._precision[row, on], self._shift[row, on]
        slope = (shift - precision * self.mean[row, on]) @ shape.T
        scaled = precision[..., None, :] * shape
        bend = (precision @ (shape**2).T) - np.einsum("rkjg,rkjg->rkj", scaled @ self.covariance[row, on], scaled)
        total = np.maximum(bend, 0.0) + spread**-2
        gained = 0.5 * ((slope + centre / spread**2) ** 2 / total - (centre / spread) ** 2 - np.log(total * spread**2))
        answered = self._part[row, on] % answerings
        part = local * answerings + answered[..., None]
        before = self.log_weight[row, on] - self._log_share[self._part[row, on]]
        score = np.full((self.runs, self._log_share.size), -np.inf)
        np.maximum.at(score, (row[..., None], part), before[..., None] + gained + self._log_share[part])
        score[row, self._part] = -np.inf
        best = np.argsort(-score, axis=1, kind="stable")[:, :_FEATURES_TAKEN]
        like = np.argmax(answered[:, None, :] == (best % answerings)[..., None], axis=2)
        source = np.take_along_axis(on, like, axis=1)
        for name in ("mean", "covariance", "_precision", "_shift"):
            values = getattr(self, name)
            setattr(self, name, np.concatenate([values, values[row, source]], axis=1))
        self._part = np.concatenate([self._part, best], axis=1)
        self.log_weight = np.concatenate([self.log_weight, np.full(best.shape, -np.inf)], axis=1)
        return int(best.shape[1])

    def _refined(
        self, at: tuple[NDArray[np.intp], NDArray[np.intp]], likelihoods: PointLikelihoods, begin: Sites
    ) -> Refined:
        """Return the components at (runs, components), (n,) each, refined from these likelihoods."""
        kind, answered = divmod(self._part[at], self._slopes.size)
        likelihood = likelihoods.log_likelihood[at[0], answered]
        return refine(self._start_mean[kind], self._start[kind], likelihood, likelihoods.seen[at[0]], begin)

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
        if count >= self.log_weight.shape[1]:
            return
        top = np.argsort(-self.log_weight, axis=1, kind="stable")[:, :count]
        row = np.arange(self.runs)[:, None]
        for name in ("_part", "mean", "covariance", "log_weight", "_precision", "_shift"):
            setattr(self, name, getattr(self, name)[row, top])
