"""What matches tell of equal strength under a law: Laplace's approximation of contour, biases, JND, and its evidence.

In a match the comparison at frequency f has L_c dB SL, the reference L_r. With h(f, L_r) the level that is as strong,
the comparison is called stronger with probability e / 2 + (1 - e) Phi((L_c - h + o b + r s) / sigma): b is how much
stronger the second interval is felt (o = 1 where the comparison is second, else -1), s how much stronger the tone is
felt that serves as standard (r = -1 where that is the reference, else 1), e the lapse rate, sigma the noise of a
comparison. All parameters are found together by Fisher scoring; the curvature there gives bands and the evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.strength.laws import Law, features
from tactuator.perception.curve import ThresholdCurve

NUISANCE_MEAN = (0.0, 0.0, float(np.log(2.5)), float(np.log(0.02 / 0.98)))
NUISANCE_SD = (2.0, 2.0, 0.5, 0.7)
"""Prior of order bias (dB), standard bias (dB), log of sigma (dB) and log odds of a lapse."""
_NUISANCES = len(NUISANCE_MEAN)
_KNOWN = 1e-3
_STEPS_MAX, _CLOSE, _ROUNDING = 60, 1e-4, 1e-9
_LONGEST_STEP, _SHORTEST_SHARE = 3.0, 1e-3
"""Longest step of a parameter in standard deviations of its prior, and how far a step is shortened."""
_STEP_DIFFERENCE = 1e-4
_LEAST_PROBABILITY = 1e-9
_DRAWS, _DRAWS_SEED = 64, 5


@dataclass(frozen=True)
class Matches:
    """Answers to matches, each (n,).

    frequency_hz, comparison_db_sl: of the tone that is not at the reference frequency. reference_db_sl: of the other.
    second: the comparison was in the second interval. swapped: the comparison served as standard. stronger: it was
    called stronger.
    """

    frequency_hz: FloatArray
    comparison_db_sl: FloatArray
    reference_db_sl: FloatArray
    second: NDArray[np.bool_]
    swapped: NDArray[np.bool_]
    stronger: NDArray[np.bool_]

    @classmethod
    def of(cls, rows: Sequence[tuple[float, float, float, bool, bool, bool]]) -> Matches:
        """Return the matches of rows in the order of the fields."""
        columns = list(zip(*rows, strict=True)) if rows else [()] * 6
        kinds = (np.float64,) * 3 + (np.bool_,) * 3
        return cls(*(np.array(column, dtype=kind) for column, kind in zip(columns, kinds, strict=True)))


@dataclass(frozen=True)
class ContourSetting:
    """Reference frequency of the contours and the band that they go over, Hz.

    curve: that 0 dB SL stands for; None where nobody knows it.
    """

    reference_hz: float = 100.0
    band_hz: tuple[float, float] = (10.0, 300.0)
    curve: ThresholdCurve | None = None


@dataclass(frozen=True)
class Fit:
    """A law as matches have it.

    place: law's parameters, weights of its deviation, order bias, standard bias, log sigma, log odds of lapses.
    covariance: theirs. log_evidence: of the matches under the law.
    """

    law: Law
    setting: ContourSetting
    place: FloatArray
    covariance: FloatArray
    log_evidence: float

    def levels(self, frequency_hz: FloatArray, level_db_sl: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the levels as strong as level_db_sl at the reference, (n,), and their gradient, (n, parameters)."""
        return _levels(self.law, self.setting, self.place, frequency_hz, level_db_sl)

    def moments(self, frequency_hz: FloatArray, level_db_sl: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the levels, (n,) each: of a law with parameters over draws of them, since a step
        of a contour moves along the frequency, which no gradient at one place tells.
        """
        level, gradient = self.levels(frequency_hz, level_db_sl)
        if not self.law.mean:
            return level, np.einsum("ij,jk,ik->i", gradient, self.covariance, gradient)
        draws = np.random.default_rng(_DRAWS_SEED).standard_normal((_DRAWS // 2, self.place.size))
        scale = np.linalg.cholesky(self.covariance)
        moved = self.place + np.concatenate([draws, -draws]) @ scale.T
        levels = [_level(self.law, self.setting, place, frequency_hz, level_db_sl) for place in moved]
        return np.mean(levels, axis=0), np.var(levels, axis=0)

    @property
    def order_db(self) -> float:
        """Return how much stronger the second interval is felt, dB."""
        return float(self.place[-4])

    @property
    def standard_db(self) -> float:
        """Return how much stronger the standard is felt, dB."""
        return float(self.place[-3])

    @property
    def noise_db(self) -> float:
        """Return the standard deviation of a comparison, dB."""
        return float(np.exp(self.place[-2]))


def _levels(
    law: Law, setting: ContourSetting, place: FloatArray, frequency_hz: FloatArray, level_db_sl: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the levels under a law with parameters in that place, and their gradient."""
    wave = features(law, setting.reference_hz, setting.band_hz).at(frequency_hz, level_db_sl)
    law_own, over = len(law.mean), np.log10(frequency_hz / setting.reference_hz)
    weights = place[law_own:-_NUISANCES]
    level = law.level(place[:law_own], over, level_db_sl)
    gradient = np.zeros((frequency_hz.size, place.size))
    for index in range(law_own):
        moved = place[:law_own].copy()
        moved[index] += _STEP_DIFFERENCE
        gradient[:, index] = (law.level(moved, over, level_db_sl) - level) / _STEP_DIFFERENCE
    gradient[:, law_own:-_NUISANCES] = wave
    return level + wave @ weights, gradient


def _level(
    law: Law, setting: ContourSetting, place: FloatArray, frequency_hz: FloatArray, level_db_sl: FloatArray
) -> FloatArray:
    """Return the levels under a law with parameters in that place."""
    wave = features(law, setting.reference_hz, setting.band_hz).at(frequency_hz, level_db_sl)
    count, over = len(law.mean), np.log10(frequency_hz / setting.reference_hz)
    return np.asarray(law.level(place[:count], over, level_db_sl) + wave @ place[count:-_NUISANCES])


@dataclass(frozen=True)
class _Prior:
    """Normal prior of every parameter; mean, sd: (parameters,)."""

    mean: FloatArray
    sd: FloatArray

    @classmethod
    def of(cls, law: Law, setting: ContourSetting, noise_db: float | None) -> _Prior:
        """Return the prior under a law; noise_db: the noise of a comparison, None where it is to be found."""
        count = features(law, setting.reference_hz, setting.band_hz).count
        nuisance, spread = np.array(NUISANCE_MEAN), np.array(NUISANCE_SD)
        if noise_db is not None:
            nuisance[-2], spread[-2] = np.log(noise_db), _KNOWN
        mean = np.concatenate([law.mean, np.zeros(count), nuisance])
        return cls(mean, np.concatenate([law.sd, np.ones(count), spread]))


@dataclass(frozen=True)
class _Local:
    """Log posterior at a place, its gradient, and the expected curvature."""

    value: float
    gradient: FloatArray
    curvature: FloatArray


def _local(law: Law, setting: ContourSetting, prior: _Prior, place: FloatArray, matches: Matches) -> _Local:
    pull = (place - prior.mean) / prior.sd
    value, gradient, curvature = -0.5 * float(pull @ pull), -pull / prior.sd, np.diag(1.0 / prior.sd**2)
    if matches.frequency_hz.size:
        level, slope = _levels(law, setting, place, matches.frequency_hz, matches.reference_db_sl)
        order, role = np.where(matches.second, 1.0, -1.0), np.where(matches.swapped, 1.0, -1.0)
        sigma, lapse = np.exp(place[-2]), 1.0 / (1.0 + np.exp(-place[-1]))
        z = (matches.comparison_db_sl - level + order * place[-4] + role * place[-3]) / sigma
        rise = scipy.special.ndtr(z)
        chance = np.clip(0.5 * lapse + (1.0 - lapse) * rise, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
        steep = (1.0 - lapse) * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        wave = -slope / sigma
        wave[:, -4], wave[:, -3], wave[:, -2] = order / sigma, role / sigma, -z
        wave *= steep[:, None]
        wave[:, -1] = (0.5 - rise) * lapse * (1.0 - lapse)
        spread = chance * (1.0 - chance)
        value += float(np.sum(np.log(np.where(matches.stronger, chance, 1.0 - chance))))
        gradient = gradient + wave.T @ ((matches.stronger - chance) / spread)
        curvature = curvature + (wave / spread[:, None]).T @ wave
    return _Local(value, gradient, curvature)


def fit(
    law: Law,
    setting: ContourSetting,
    matches: Matches,
    noise_db: float | None = None,
    start: FloatArray | None = None,
    steps: int = _STEPS_MAX,
) -> Fit:
    """Return the law fitted to matches.

    noise_db: the noise of a comparison where it is held. start: a place to begin from. steps: the most that are taken.
    """
    prior = _Prior.of(law, setting, noise_db)
    place = prior.mean.copy() if start is None else start.copy()
    if noise_db is not None:
        place[-2] = np.log(noise_db)
    here = _local(law, setting, prior, place, matches)
    for _ in range(steps):
        step = np.linalg.solve(here.curvature, here.gradient)
        share = min(1.0, _LONGEST_STEP / max(float(np.max(np.abs(step / prior.sd))), 1e-9))
        there = _local(law, setting, prior, place + share * step, matches)
        while there.value < here.value - _ROUNDING and share > _SHORTEST_SHARE:
            share *= 0.5
            there = _local(law, setting, prior, place + share * step, matches)
        if there.value < here.value - _ROUNDING:
            break
        place, gained, here = place + share * step, there.value - here.value, there
        if gained < _CLOSE:
            break
    half_log_volume = 0.5 * float(np.linalg.slogdet(here.curvature)[1]) + float(np.sum(np.log(prior.sd)))
    return Fit(
        law, setting, place, np.asarray(np.linalg.inv(here.curvature), dtype=np.float64), here.value - half_log_volume
    )


@dataclass(frozen=True)
class Placed:
    """A match to be asked next: comparison at frequency_hz and comparison_db_sl, reference at reference_db_sl."""

    frequency_hz: float
    comparison_db_sl: float
    reference_db_sl: float


@dataclass(frozen=True)
class Candidates:
    """What may be asked: frequencies of the comparison, levels of the reference, and the greatest level of both."""

    frequency_hz: FloatArray
    reference_db_sl: FloatArray
    highest_db_sl: float = 55.0
    lowest_db_sl: float = 3.0

    @cached_property
    def pairs(self) -> tuple[FloatArray, FloatArray]:
        """Return every frequency with every level, (n,) each."""
        hertz, level = np.meshgrid(self.frequency_hz, self.reference_db_sl, indexing="ij")
        return hertz.ravel(), level.ravel()


def most_telling(known: Fit, among: Candidates, offset: float, second: bool, swapped: bool) -> Placed:
    """Return the match whose answer is expected to tell most of the contours at all candidates.

    offset: how far it is put from where it would feel equal, biases included, in standard deviations of a comparison:
    biases are then found at their own point, not by the noise. second, swapped: as in `Matches`. Expected is the
    fall of the contours' mean variance, whose answer has the information of a probit there.
    """
    hertz, reference = among.pairs
    level, gradient = known.levels(hertz, reference)
    bias_db = (1.0 if second else -1.0) * known.order_db + (1.0 if swapped else -1.0) * known.standard_db
    target = np.clip(level - bias_db + offset * known.noise_db, among.lowest_db_sl, among.highest_db_sl)
    z = (target + bias_db - level) / known.noise_db
    rise = np.clip(scipy.special.ndtr(z), 1e-6, 1.0 - 1e-6)
    information = (np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)) ** 2 / (rise * (1.0 - rise)) / known.noise_db**2
    shared = gradient @ known.covariance @ gradient.T
    fall = np.sum(shared**2, axis=0) * information / (1.0 + information * np.diag(shared))
    best = int(np.argmax(fall))
    return Placed(float(hertz[best]), float(np.round(2.0 * target[best]) / 2.0), float(reference[best]))
