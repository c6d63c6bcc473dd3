"""Intensity functions: each says which level at any frequency is as strong as a level at the reference frequency.

All levels are sensation levels (dB SL) of the person's own threshold curve. A function is a shape with few parameters,
and a smooth deviation from it, a Gaussian process over log frequency and level: small where the function claims to be
right, wide where nothing is claimed (`free`). The evidence of a person's matches then says which function they speak
for.

The functions: equal sensation level (Verrillo 1970, one exponent up to 350 Hz); an exponent for each channel (Stevens
1968: near 30 Hz about twice that near 250 Hz); the sum of channels, the stronger and half the weaker (Hollins & Roy
1996); equal velocity from some level on (Griffin 2012), which needs the threshold curve; and none of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.perception.curve import ThresholdCurve

_MIDDLE_DB_SL, _SPAN_DB = 30.0, 20.0
"""Level of a deviation, and the level difference that defines its growth."""
_GRID_POINTS = 48
_KEPT = 0.999
"""Share of a deviation's variance that its features keep."""


@dataclass(frozen=True)
class Deviation:
    """Prior of a smooth deviation in dB over log frequency, nothing at the reference.

    tilt_db: standard deviation of its tilt per decade. wave_db: of its waves, wave_decades long. growth, bend: both
    amplitudes again, as shares, for what grows with the level (per 20 dB, about 30 dB SL) and with its square.
    """

    tilt_db: float
    wave_db: float
    wave_decades: float
    growth: float
    bend: float

    def covariance(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return the covariance at log10 of frequencies re the reference, (first, second), dB^2."""

        def plain(a: FloatArray, b: FloatArray) -> FloatArray:
            apart = (a[:, None] - b[None, :]) / self.wave_decades
            return np.asarray(self.tilt_db**2 * a[:, None] * b + self.wave_db**2 * np.exp(-0.5 * apart**2))

        zero = np.zeros(1)
        return plain(first, second) - plain(first, zero) @ plain(zero, second) / plain(zero, zero)


@dataclass(frozen=True)
class Features:
    """Features of a deviation over a band: its value is their sum with standard normal weights."""

    deviation: Deviation
    reference_hz: float
    band_hz: tuple[float, float]

    @cached_property
    def _map(self) -> tuple[FloatArray, FloatArray]:
        """Return the grid (log10 re the reference) and the map from covariances with it to features."""
        grid = np.log10(np.geomspace(*self.band_hz, _GRID_POINTS) / self.reference_hz)
        value, vector = np.linalg.eigh(self.deviation.covariance(grid, grid))
        kept = np.argsort(value)[::-1]
        kept = kept[: 1 + int(np.searchsorted(np.cumsum(value[kept]) / value.sum(), _KEPT))]
        return grid, vector[:, kept] / np.sqrt(value[kept])

    @property
    def count(self) -> int:
        """Return the number of features."""
        return 3 * int(self._map[1].shape[1])

    def at(self, frequency_hz: FloatArray, level_db_sl: FloatArray) -> FloatArray:
        """Return the features at frequencies and reference levels (n,), shape (n, count)."""
        grid, project = self._map
        over = self.deviation.covariance(np.log10(frequency_hz / self.reference_hz), grid) @ project
        up = ((level_db_sl - _MIDDLE_DB_SL) / _SPAN_DB)[:, None]
        return np.concatenate([over, self.deviation.growth * up * over, self.deviation.bend * up**2 * over], axis=1)


Shape = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Function of parameters (k,), log10 of frequency re the reference (n,), and reference level (n,): the level in dB SL
that is as strong, (n,)."""


@dataclass(frozen=True)
class IntensityFunction:
    """An intensity function; mean, sd: normal prior of its parameters, (k,). level: its shape. deviation: from it."""

    name: str
    mean: tuple[float, ...]
    sd: tuple[float, ...]
    level: Shape = field(repr=False)
    deviation: Deviation


def _same(parameters: FloatArray, over: FloatArray, level: FloatArray) -> FloatArray:
    return level


def _exponents(parameters: FloatArray, over: FloatArray, level: FloatArray) -> FloatArray:
    """Return the level where strength in dB is p(f) x level, and p falls from one channel's value to the other's."""
    log_ratio, crossing, log_width = parameters
    width = np.exp(log_width)

    def log_p(at: ArrayLike) -> FloatArray:
        return np.asarray(log_ratio / (1.0 + np.exp(np.clip((np.asarray(at) - crossing) / width, -50.0, 50.0))))

    return np.asarray(level * np.exp(log_p(0.0) - log_p(over)))


_GATE_DB = 2.0


def _sum(parameters: FloatArray, over: FloatArray, level: FloatArray) -> FloatArray:
    """Return the level where the stronger channel and half the weaker are together as strong.

    The weaker channel's threshold lies |slope (x - crossing)| above the other's, and it counts above its threshold.
    """
    log_p, crossing, slope = parameters
    p = np.exp(log_p)

    def gain(at: ArrayLike, sensed: FloatArray) -> FloatArray:
        apart = np.abs(slope * (np.asarray(at) - crossing))
        gate = 1.0 / (1.0 + np.exp(np.clip((apart - sensed) / _GATE_DB, -50.0, 50.0)))
        return np.asarray(20.0 / p * np.log10(1.0 + 0.5 * gate * 10.0 ** (-p * apart / 20.0)))

    whole = level + gain(0.0, level)
    near = whole - gain(over, level)
    return np.asarray(whole - gain(over, near))


_SMALL = Deviation(tilt_db=0.7, wave_db=0.8, wave_decades=0.28, growth=0.7, bend=0.3)
FUNCTIONS: tuple[IntensityFunction, ...] = (
    IntensityFunction("sensation-level", (), (), _same, _SMALL),
    IntensityFunction(
        "exponents", (0.6, -0.2, np.log(0.09)), (0.35, 0.2, 0.8), _exponents, replace(_SMALL, wave_db=1.1)
    ),
    IntensityFunction("sum-of-channels", (np.log(0.7), -0.3, 35.0), (0.35, 0.2, 10.0), _sum, _SMALL),
    IntensityFunction(
        "free", (), (), _same, Deviation(tilt_db=8.0, wave_db=4.5, wave_decades=0.28, growth=0.6, bend=0.25)
    ),
)
"""The functions that matches are held against, with `equal_velocity` where the threshold curve is known; `free` is none
of the others, and the one that trials are placed by."""
FREE = FUNCTIONS[-1]


_AT_THRESHOLD_DB = 0.01


def _above(parameters: FloatArray, over: FloatArray, level: FloatArray) -> FloatArray:
    return np.asarray(level + parameters[0])


@lru_cache(maxsize=32)
def equal_velocity(curve: ThresholdCurve, reference_hz: float) -> IntensityFunction:
    """Return the function by which tones of equal velocity are equally strong, the more so the further above threshold.

    Nobody knows how velocity takes over. Its parameters: the share of the way there that is ever gone, the log of the
    level (dB SL) where most of it is, the log of how abruptly, whose level decides: 0 the reference's, 1 the tone's.
    """
    at_reference = curve.level_db_re_1um_at(reference_hz)

    def level_of(parameters: FloatArray, over: FloatArray, level: FloatArray) -> FloatArray:
        share, log_onset, log_abrupt, whose = parameters
        faster_db = 20.0 * over + curve.level_db_re_1um_at(reference_hz * 10.0**over) - at_reference

        def gone(at: FloatArray) -> FloatArray:
            far = np.exp(np.exp(log_abrupt) * (np.log(np.maximum(at, _AT_THRESHOLD_DB)) - log_onset))
            return np.asarray(share * faster_db * -np.expm1(-far))

        return np.asarray(level - gone(level - whose * gone(level)))

    return IntensityFunction("equal-velocity", (1.0, np.log(5.0), 0.4, 0.5), (0.25, 1.0, 0.5, 0.35), level_of, _SMALL)


POINT = IntensityFunction("point", (0.0,), (15.0,), _above, Deviation(0.0, 1e-6, 1.0, 0.0, 0.0))
"""One pair of tones: the comparison lies anywhere above the standard."""


@lru_cache(maxsize=32)
def features(function: IntensityFunction, reference_hz: float, band_hz: tuple[float, float]) -> Features:
    """Return the features of a function's deviation over a band, computed once."""
    return Features(function.deviation, reference_hz, band_hz)
