"""Contours, biases and JND of a person from matches, over all functions by their evidence, and the function that they
speak for.

The noise of a comparison is held at each of several values in turn, and every function is fitted with each: result
together with a contour of many degrees of freedom it comes out too small, and the biases and the band with it. What is
reported is over all of these fits, each with its share of the evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.task.intensity import FUNCTIONS, POINT, IntensityFunction, equal_velocity
from tactuator.experiment.task.matches import NOISE, ORDER, STANDARD, ContourSetting, Fit, Matches, fit

SURE = 0.98
"""Share of the evidence from which a function is named."""
CANNOT_TELL = "cannot tell"
_NOISES_DB = (0.8, 1.2, 1.6, 2.0, 2.5, 3.1, 3.9, 5.0, 6.5, 8.5)
_NORMAL_95 = 1.959964
_LEAST_MATCHES = 20
_LEAST_RISE_DB = 0.05
_LEAST_SHARE = 1e-4
_JND_SHARE = 0.75


@dataclass(frozen=True)
class Measured:
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float

    def __format__(self, spec: str) -> str:
        """Return value and interval in words, each by the spec of a number."""
        return f"{self.value:{spec}} ({self.low:{spec}} – {self.high:{spec}})"


@dataclass(frozen=True)
class StrengthEstimate:
    """The results of matches. fits: every function with every noise. shares: of the evidence, (fits,)."""

    setting: ContourSetting
    matches: int
    fits: tuple[Fit, ...]
    shares: FloatArray

    @cached_property
    def evidence(self) -> dict[str, float]:
        """Return the share of the evidence that each function has."""
        shares: dict[str, float] = {}
        for each, share in zip(self.fits, self.shares, strict=True):
            shares[each.function.name] = shares.get(each.function.name, 0.0) + float(share)
        return shares

    @property
    def intensity_function(self) -> str:
        """Return the function that the matches speak for, or CANNOT_TELL where none has a share of SURE."""
        name = max(self.evidence, key=lambda name: self.evidence[name])
        return name if self.evidence[name] >= SURE else CANNOT_TELL

    @property
    def order_db(self) -> Measured:
        """Return how much stronger the second interval is felt, dB."""
        return self._parameter(ORDER)

    @property
    def standard_db(self) -> Measured:
        """Return how much stronger the tone that serves as standard is felt, dB."""
        return self._parameter(STANDARD)

    @property
    def jnd_db(self) -> Measured:
        """Return the difference, dB, of which three in four answers without lapses and biases are right."""
        noise = self._parameter(NOISE, known=False)
        scale = float(scipy.special.ndtri(_JND_SHARE))
        return Measured(*(scale * float(np.exp(value)) for value in (noise.value, noise.low, noise.high)))

    def levels(self, frequency_hz: FloatArray, level_db_sl: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return level as strong as level_db_sl at the reference, and its standard deviation, (n,) each."""
        counted = self.shares > _LEAST_SHARE
        fits = [each for each, counts in zip(self.fits, counted, strict=True) if counts]
        shares = self.shares[counted] / self.shares[counted].sum()
        moments = np.array([each.moments(frequency_hz, level_db_sl) for each in fits])
        mean = shares @ moments[:, 0]
        square = shares @ (moments[:, 1] + moments[:, 0] ** 2)
        return mean, np.sqrt(np.maximum(square - mean**2, 0.0))

    def contours(self, frequency_hz: FloatArray, levels_db_sl: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return contours, low and high ends of their 95 % bands, (levels, frequencies) each.

        A contour nowhere lies below the one of a lower level.
        """
        hertz, level = np.meshgrid(frequency_hz, levels_db_sl)
        mean, sd = (each.reshape(hertz.shape) for each in self.levels(hertz.ravel(), level.ravel()))
        rising = _LEAST_RISE_DB * (1.0 + np.arange(levels_db_sl.size))[:, None]
        mean = np.maximum(np.maximum.accumulate(mean - rising, axis=0) + rising, rising)
        return mean, mean - _NORMAL_95 * sd, mean + _NORMAL_95 * sd

    def _parameter(self, place: int, known: bool = True) -> Measured:
        means = np.array([each.place[place] for each in self.fits])
        within = np.array([each.covariance[place, place] for each in self.fits]) if known else 0.0
        mean = float(self.shares @ means)
        sd = float(np.sqrt(max(float(self.shares @ (within + (means - mean) ** 2)), 0.0)))
        return Measured(mean, mean - _NORMAL_95 * sd, mean + _NORMAL_95 * sd)


def estimate(
    matches: Matches, setting: ContourSetting, functions: Sequence[IntensityFunction] | None = None
) -> StrengthEstimate:
    """Return the results of matches under the functions, by default all. Raises BadInput for fewer than 20 matches."""
    count = matches.frequency_hz.size
    if functions is None:
        functions = (
            FUNCTIONS if setting.curve is None else (*FUNCTIONS, equal_velocity(setting.curve, setting.reference_hz))
        )
    if count < _LEAST_MATCHES:
        raise BadInput(f"{count} matches", f"{_LEAST_MATCHES} or more")
    fits = list[Fit]()
    for function in functions:
        place = None
        for noise_db in _NOISES_DB:
            fits.append(fit(function, setting, matches, noise_db, place))
            place = fits[-1].place
    evidence = np.array([each.log_evidence for each in fits])
    share = np.exp(evidence - evidence.max())
    return StrengthEstimate(setting, count, tuple(fits), share / share.sum())


@dataclass(frozen=True)
class Equality:
    """Point of subjective equality: above_db, how far the comparison lies above the standard; biases and JND, dB."""

    above_db: Measured
    order_db: Measured
    standard_db: Measured
    jnd_db: Measured
    matches: int


def equality(matches: Matches, setting: ContourSetting) -> Equality:
    """Return the point of subjective equality of matches of one pair of tones. Raises BadInput as `estimate` does."""
    result = estimate(matches, setting, (POINT,))
    above = result._parameter(0)
    return Equality(above, result.order_db, result.standard_db, result.jnd_db, result.matches)
