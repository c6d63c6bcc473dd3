"""Equal strength from matches under a function: Laplace's approximation of contour, biases, JND, and its
evidence.

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
from tactuator.experiment.task.intensity import IntensityFunction, features
from tactuator.perception.curve import ThresholdCurve

NUISANCE_MEAN = (0.0, 0.0, float(np.log(2.5)), float(np.log(0.02 / 0.98)))
NUISANCE_SD = (2.0, 2.0, 0.5, 0.7)
"""Prior of order bias (dB), standard bias (dB), log of sigma (dB) and log odds of a lapse."""
ORDER, STANDARD, NOISE, LAPSE = range(-len(NUISANCE_MEAN), 0)
"""Their places behind all that is a function's."""
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

    curve: the reference of 0 dB SL; None if unknown.
    """

    reference_hz: float = 100.0
    band_hz: tuple[float, float] = (10.0, 300.0)
    curve: ThresholdCurve | None = None


@dataclass(frozen=True, eq=False)
class Surface:
    """A function at places: over, log10 of frequency re the reference; level, of the reference; (n,) each. wave:
    features of its deviation there, (n, features).
    """

    function: IntensityFunction
    over: FloatArray
    level: FloatArray
    wave: FloatArray

    @classmethod
    def of(
        cls, function: IntensityFunction, setting: ContourSetting, frequency_hz: FloatArray, level_db_sl: FloatArray
    ) -> Surface:
        """Return the surface at frequencies and levels of the reference, (n,) each."""
        wave = features(function, setting.reference_hz, setting.band_hz).at(frequency_hz, level_db_sl)
        return cls(function, np.log10(frequency_hz / setting.reference_hz), level_db_sl, wave)

    def at(self, place: FloatArray) -> FloatArray:
        """Return the levels that are as strong under the function with parameters in that place, (n,)."""
        count = len(self.function.mean)
        return np.asarray(self.function.level(place[:count], self.over, self.level) + self.wave @ place[count:ORDER])

    def gradient(self, place: FloatArray) -> FloatArray:
        """Return the gradient of the levels by all parameters, (n, parameters)."""
        count = len(self.function.mean)
        gradient = np.zeros((self.over.size, place.size))
        level = self.function.level(place[:count], self.over, self.level)
        for index, step in enumerate(_STEP_DIFFERENCE * np.eye(count)):
            gradient[:, index] = (self.function.level(place[:count] + step, self.over, self.level) - level) / step[
                index
            ]
        gradient[:, count:ORDER] = self.wave
        return gradient


@dataclass(frozen=True)
class Fit:
    """A function as matches have it.

    place: function's parameters, weights of its deviation, order bias, standard bias, log sigma, log odds of lapses.
    covariance: theirs. log_evidence: of the matches under the function, and of the noise that is held.
    """

    function: IntensityFunction
    setting: ContourSetting
    place: FloatArray
    covariance: FloatArray
    log_evidence: float

    def surface(self, frequency_hz: FloatArray, level_db_sl: FloatArray) -> Surface:
        """Return the function's surface at frequencies and levels of the reference, (n,) each."""
        return Surface.of(self.function, self.setting, frequency_hz, level_db_sl)

    def moments(self, frequency_hz: FloatArray, level_db_sl: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the levels, (n,) each: of a function with parameters over draws of them, since a
        step of a contour moves along the frequency, which no gradient at one place shows.
        """
        surface = self.surface(frequency_hz, level_db_sl)
        if not self.function.mean:
            gradient = surface.gradient(self.place)
            return surface.at(self.place), np.einsum("ij,jk,ik->i", gradient, self.covariance, gradient)
        draws = np.random.default_rng(_DRAWS_SEED).standard_normal((_DRAWS // 2, self.place.size))
        scale = np.linalg.cholesky(self.covariance)
        levels = [surface.at(place) for place in self.place + np.concatenate([draws, -draws]) @ scale.T]
        return np.mean(levels, axis=0), np.var(levels, axis=0)


@dataclass(frozen=True)
class _Prior:
    """Normal prior of every parameter; mean, sd: (parameters,)."""

    mean: FloatArray
    sd: FloatArray

    @classmethod
    def of(cls, function: IntensityFunction, setting: ContourSetting, noise_db: float | None) -> _Prior:
        """Return the prior under a function; noise_db: the noise of a comparison, None where it is to be found."""
        count = features(function, setting.reference_hz, setting.band_hz).count
        nuisance, spread = np.array(NUISANCE_MEAN), np.array(NUISANCE_SD)
        if noise_db is not None:
            nuisance[NOISE], spread[NOISE] = np.log(noise_db), _KNOWN
        mean = np.concatenate([function.mean, np.zeros(count), nuisance])
        return cls(mean, np.concatenate([function.sd, np.ones(count), spread]))


@dataclass(frozen=True)
class _Local:
    """Log posterior at a place, its gradient, and the expected curvature."""

    value: float
    gradient: FloatArray
    curvature: FloatArray


def _local(surface: Surface, prior: _Prior, place: FloatArray, matches: Matches) -> _Local:
    pull = (place - prior.mean) / prior.sd
    value, gradient, curvature = -0.5 * float(pull @ pull), -pull / prior.sd, np.diag(1.0 / prior.sd**2)
    if matches.frequency_hz.size:
        order, role = np.where(matches.second, 1.0, -1.0), np.where(matches.swapped, 1.0, -1.0)
        sigma, lapse = np.exp(place[NOISE]), 1.0 / (1.0 + np.exp(-place[LAPSE]))
        above = matches.comparison_db_sl - surface.at(place)
        z = (above + order * place[ORDER] + role * place[STANDARD]) / sigma
        rise = scipy.special.ndtr(z)
        chance = np.clip(0.5 * lapse + (1.0 - lapse) * rise, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
        steep = (1.0 - lapse) * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        wave = -surface.gradient(place) / sigma
        wave[:, ORDER], wave[:, STANDARD], wave[:, NOISE] = order / sigma, role / sigma, -z
        wave *= steep[:, None]
        wave[:, LAPSE] = (0.5 - rise) * lapse * (1.0 - lapse)
        spread = chance * (1.0 - chance)
        value += float(np.sum(np.log(np.where(matches.stronger, chance, 1.0 - chance))))
        gradient = gradient + wave.T @ ((matches.stronger - chance) / spread)
        curvature = curvature + (wave / spread[:, None]).T @ wave
    return _Local(value, gradient, curvature)


def fit(
    function: IntensityFunction,
    setting: ContourSetting,
    matches: Matches,
    noise_db: float | None = None,
    start: FloatArray | None = None,
    steps: int = _STEPS_MAX,
) -> Fit:
    """Return the function fitted to matches.

    noise_db: the noise of a comparison where it is held. start: a place to begin from. steps: the most that are taken.
    """
    prior = _Prior.of(function, setting, noise_db)
    place = prior.mean.copy() if start is None else start.copy()
    if noise_db is not None:
        place[NOISE] = np.log(noise_db)
    surface = Surface.of(function, setting, matches.frequency_hz, matches.reference_db_sl)
    here = _local(surface, prior, place, matches)
    for _ in range(steps):
        step = np.linalg.solve(here.curvature, here.gradient)
        share = min(1.0, _LONGEST_STEP / max(float(np.max(np.abs(step / prior.sd))), 1e-9))
        there = _local(surface, prior, place + share * step, matches)
        while there.value < here.value - _ROUNDING and share > _SHORTEST_SHARE:
            share *= 0.5
            there = _local(surface, prior, place + share * step, matches)
        if there.value < here.value - _ROUNDING:
            break
        place, gained, here = place + share * step, there.value - here.value, there
        if gained < _CLOSE:
            break
    away = 0.0 if noise_db is None else (np.log(noise_db) - NUISANCE_MEAN[NOISE]) / NUISANCE_SD[NOISE]
    half_log_volume = 0.5 * float(np.linalg.slogdet(here.curvature)[1]) + float(np.sum(np.log(prior.sd)))
    evidence = here.value - half_log_volume - 0.5 * float(away) ** 2
    return Fit(function, setting, place, np.asarray(np.linalg.inv(here.curvature), dtype=np.float64), evidence)


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


def most_telling(
    known: Fit, among: Candidates, reference_db_sl: float, offset: float, second: bool, swapped: bool
) -> Placed:
    """Return the match whose answer is expected to be most informative about the contours at all candidates, at that
    level.

    offset: how far it is put from where it would feel equal, biases included, in standard deviations of a comparison:
    biases are then found at their own point, not by the noise. second, swapped: as in `Matches`. Expected is the
    fall of the contours' mean variance, whose answer has the information of a probit there.
    """
    hertz, reference = among.pairs
    surface, place = known.surface(hertz, reference), known.place
    level, gradient, noise_db = surface.at(place), surface.gradient(place), float(np.exp(place[NOISE]))
    bias_db = (1.0 if second else -1.0) * place[ORDER] + (1.0 if swapped else -1.0) * place[STANDARD]
    target = np.clip(level - bias_db + offset * noise_db, among.lowest_db_sl, among.highest_db_sl)
    z = (target + bias_db - level) / noise_db
    rise = np.clip(scipy.special.ndtr(z), 1e-6, 1.0 - 1e-6)
    information = (np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)) ** 2 / (rise * (1.0 - rise)) / noise_db**2
    shared = gradient @ known.covariance @ gradient.T
    fall = np.sum(shared**2, axis=0) * information / (1.0 + information * np.diag(shared))
    best = int(np.argmax(np.where(reference == reference_db_sl, fall, -np.inf)))
    return Placed(float(hertz[best]), float(np.round(2.0 * target[best]) / 2.0), float(reference[best]))
