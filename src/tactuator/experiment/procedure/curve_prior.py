"""Prior of a person's threshold curve: several kinds of curve, which the trials then weigh by their evidence.

Relative to the display's own curve (0 dB SL) a curve of one kind is a Gaussian process over log frequency: a mean, an
offset, a tilt in dB per decade about the band's middle, and up to four deviations: a smooth wave (squared exponential),
a rough one (Matern 3/2), a walk with sudden steps (exponential kernel) and one feature at a place: a notch, or an edge
beyond which the loss is another. All amplitudes are standard deviations of normal variables (Rasmussen & Williams 2006,
chapter 4); that of a notch, which is a loss, has a mean.

Normal people differ little from the display's curve, some of them smoothly and some also from one frequency to the
next. Without this roughness a smooth curve passes through thresholds that scatter about it. Answers pooled over them
rise more slowly than those at any one of them and reach the target share, which lies above the middle of the rise, at
too high a level: a scatter of 2 dB was read 0.5 dB too high. The rough kind runs beside the smooth one because the
same roughness in every curve costs smooth people accuracy, and the evidence separates the two.

A broad loss raises or tilts all of it; a local one is a notch, an
edge or several steps. A loss of one channel is bounded by the other: where the Pacinian channel is lost, the threshold
rises with frequency above the knee at which the two meet, until it meets the loss; where the others are lost, it rises
towards lower frequencies. One kind wide enough for all of them needs many more trials for normal people; a narrow one
gives people with a loss a curve that is too good, inside a band that is too narrow. So all run side by side.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Playable
from tactuator.parameters import Band, NotNegative, Number, Positive, Share, Whole, table
from tactuator.signals.spectra import off_mains

_EDGE_DECADES = 0.02
"""Width of an edge's logistic: narrower than the spacing of any grid of points in use."""
_KNEE_HZ, _CHANNELS_PART_DB = 40.0, 40.0
"""Where the two channels meet, and by how much they part in a decade: bolanowski-1988 falls by 15 dB from 40 to 100 Hz,
and is flat from 25 to 35 Hz, where another channel answers."""


@dataclass(frozen=True)
class CurveKind:
    """A kind of curve and its share of the people.

    share: prior probability. mean_db, offset_db, tilt_db_per_decade: of the line. wave_db, rough_db, walk_db:
    amplitudes of the deviations, with their lengths in decades. feature_db: amplitude of a notch at feature_hz of width
    feature_decades (standard deviation of a Gaussian), or of an edge there, or of the loss of one channel (pacinian,
    other), whose size is feature_mean_db. feature_mean_db: mean of that amplitude. A term of zero is absent. Raises
    BadInput for a negative amplitude or a length that is not positive.
    """

    name: str
    share: float = 1.0
    mean_db: float = 0.0
    offset_db: float = 4.0
    tilt_db_per_decade: float = 2.5
    wave_db: float = 2.0
    wave_decades: float = 0.35
    rough_db: float = 0.0
    rough_decades: float = 0.3
    walk_db: float = 0.0
    walk_decades: float = 1.0
    feature: Literal["none", "notch", "edge", "pacinian", "other"] = "none"
    feature_db: float = 0.0
    feature_hz: float = 10.0
    feature_decades: float = 0.15
    feature_mean_db: float = 0.0

    def __post_init__(self) -> None:
        amplitudes = (self.offset_db, self.tilt_db_per_decade, self.wave_db, self.rough_db, self.walk_db)
        if min(*amplitudes, self.feature_db, self.share) < 0.0:
            raise BadInput(f"curves of kind {self.name!r}: a standard deviation or share is negative", "0 or more")
        lengths = (self.wave_decades, self.rough_decades, self.walk_decades, self.feature_decades, self.feature_hz)
        if min(lengths) <= 0.0:
            raise BadInput(f"curves of kind {self.name!r}: a length or frequency is not positive", "above 0")

    @property
    def is_local(self) -> bool:
        """Return whether it is one of the many that differ in the place of their feature alone."""
        return self.feature in ("notch", "edge")

    def mean(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the mean curve at the frequencies, dB SL."""
        return self.mean_db + self.feature_mean_db * self.shape(frequency_hz)

    def shape(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the feature of amplitude 1 at the frequencies."""
        return self._feature(np.log10(np.asarray(frequency_hz, dtype=np.float64)))

    def covariance(self, first_hz: ArrayLike, second_hz: ArrayLike, middle_hz: float) -> FloatArray:
        """Return the prior covariance, dB^2, shape (first, second). middle_hz: about which the tilt turns."""
        a = np.log10(np.asarray(first_hz, dtype=np.float64))[:, None]
        b = np.log10(np.asarray(second_hz, dtype=np.float64))[None, :]
        middle, apart = np.log10(middle_hz), np.abs(a - b)
        covariance = self.offset_db**2 + self.tilt_db_per_decade**2 * (a - middle) * (b - middle)
        covariance = covariance + self.wave_db**2 * np.exp(-0.5 * (apart / self.wave_decades) ** 2)
        rough = np.sqrt(3.0) * apart / self.rough_decades
        covariance = covariance + self.rough_db**2 * (1.0 + rough) * np.exp(-rough)
        covariance = covariance + self.walk_db**2 * np.exp(-apart / self.walk_decades)
        return np.asarray(covariance + self.feature_db**2 * self._feature(a) * self._feature(b))

    def _feature(self, decades: FloatArray) -> FloatArray:
        beyond = decades - np.log10(self.feature_hz)
        if self.feature == "notch":
            return np.asarray(np.exp(-0.5 * (beyond / self.feature_decades) ** 2))
        if self.feature == "edge":
            return np.asarray(0.5 * (1.0 + np.tanh(0.5 * beyond / _EDGE_DECADES)))
        if self.feature in ("pacinian", "other"):
            apart = _CHANNELS_PART_DB * (beyond if self.feature == "pacinian" else -beyond)
            return np.asarray(np.clip(apart / max(self.feature_mean_db, 1.0), 0.0, 1.0))
        return np.zeros_like(beyond)

    def draw(self, frequency_hz: ArrayLike, middle_hz: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw the curves of `count` people, dB relative to the display's curve, shape (count, frequencies)."""
        covariance = self.covariance(frequency_hz, frequency_hz, middle_hz)
        root = np.linalg.cholesky(covariance + 1e-8 * np.eye(len(covariance)))
        return np.asarray(self.mean(frequency_hz) + rng.standard_normal((count, len(covariance))) @ root.T)

    def between(self, points_hz: FloatArray, others_hz: ArrayLike, middle_hz: float) -> tuple[FloatArray, FloatArray]:
        """Return the conditional mean at others as weights of the points, (others, points), and its variance."""
        among = self.covariance(points_hz, points_hz, middle_hz) + 1e-6 * np.eye(points_hz.size)
        across = self.covariance(points_hz, others_hz, middle_hz)
        weights: FloatArray = np.asarray(np.linalg.solve(among, across).T, dtype=np.float64)
        others = np.asarray(others_hz, dtype=np.float64)
        alone = np.array([self.covariance([hertz], [hertz], middle_hz)[0, 0] for hertz in others])
        return weights, np.asarray(np.maximum(alone - np.einsum("og,go->o", weights, across), 0.0))


_ROUGH_DECADES = 0.05
"""Length of roughness: neighbours on the grid of points share next to nothing of it."""
_NOTCH_DECADES = (0.05, 0.09, 0.16, 0.3)
"""Widths of notches: neighbours are closer than the trials of a run can resolve."""
_LOST_SHARES = (0.4, 0.7, 1.0)
"""Sizes of a lost channel, as shares of the largest."""


@table("[procedure.prior]")
class CurveShares:
    """Keys of [procedure.prior]: shares of the kinds of curve, up to a common factor, and their deviations in dB.

    A share of 0 leaves a kind out.
    """

    normal_share: Annotated[Share, Field(description="people with a normal curve")] = 0.42
    normal_offset_db: Annotated[Positive, Field(description="offset of normal curves")] = 4.0
    normal_tilt_db_per_decade: Annotated[Positive, Field(description="tilt of normal curves")] = 2.5
    normal_wave_db: Annotated[Positive, Field(description="smooth wave of normal curves")] = 2.0
    rough_share: Annotated[Share, Field(description="people with a normal curve that is rough")] = 0.25
    rough_db: Annotated[Positive, Field(description="roughness from one frequency to the next")] = 3.0
    broad_share: Annotated[Share, Field(description="people with a loss over the whole band")] = 0.12
    broad_mean_db: Annotated[Number, Field(description="mean of such a loss")] = 8.0
    broad_offset_db: Annotated[Positive, Field(description="spread of such a loss")] = 15.0
    channel_share: Annotated[Share, Field(description="people who lost one channel, Pacinian or not")] = 0.25
    channel_db: Annotated[Positive, Field(description="largest loss of one channel")] = 32.0
    uneven_share: Annotated[Share, Field(description="people whose curve varies from third to third")] = 0.12
    uneven_db: Annotated[Positive, Field(description="variation from one third of a decade to the next")] = 7.0
    steps_share: Annotated[Share, Field(description="people whose curve steps")] = 0.08
    steps_db: Annotated[Positive, Field(description="steps of such a curve")] = 10.0
    notch_share: Annotated[Share, Field(description="people with one notch in a normal curve")] = 0.12
    notch_db: Annotated[Positive, Field(description="depth of the notch")] = 12.0
    edge_share: Annotated[Share, Field(description="people with one edge in a normal curve")] = 0.06
    edge_db: Annotated[Positive, Field(description="height of the edge")] = 15.0


@table("whole curve")
class CurvePrior(CurveShares):
    """The prior of a curve at a display, and the frequencies at which trials may be put.

    points: number of frequencies, even in log frequency over band_hz and kept clearance_hz away from multiples of
    mains_hz (0: no mains), where hum is felt with the stimulus. Raises BadInput for settings that cannot be.
    """

    _: KW_ONLY
    band_hz: Band = Playable.band_hz
    points: Annotated[Whole, Field(ge=3)] = 28
    mains_hz: NotNegative = Playable.mains_hz
    clearance_hz: NotNegative = Playable.clearance_hz

    def __post_init__(self) -> None:
        if 2.0 * self.clearance_hz >= self.mains_hz > 0.0:
            raise BadInput(
                f"{self.clearance_hz:g} Hz off multiples of {self.mains_hz:g} Hz",
                "less than half of the mains frequency",
            )
        if not self.kinds:
            raise BadInput("every share is 0", "at least one kind of curve with a share")

    @property
    def middle_hz(self) -> float:
        """Return the frequency about which tilts turn."""
        return float(np.sqrt(self.band_hz[0] * self.band_hz[1]))

    @cached_property
    def frequency_hz(self) -> FloatArray:
        """Return the frequencies at which trials may be put, shape (points,)."""
        return off_mains(np.geomspace(*self.band_hz, self.points), self.mains_hz, self.clearance_hz, self.band_hz)

    @cached_property
    def kinds(self) -> tuple[CurveKind, ...]:
        """Return every kind of curve with a share above 0; the shares sum to 1."""
        kinds = [*self._normal(), *self._lossy(), *self._local()]
        total = sum(kind.share for kind in kinds)
        return tuple(replace(kind, share=kind.share / total) for kind in kinds if kind.share > 0.0)

    def _normal(self) -> list[CurveKind]:
        share, offset, tilt = self.normal_share, self.normal_offset_db, self.normal_tilt_db_per_decade
        wave = self.normal_wave_db
        return [
            CurveKind("normal", 0.25 * share, 0.0, offset, 0.6 * tilt, 0.4 * wave, 0.5),
            CurveKind("normal", 0.35 * share, 0.0, offset, tilt, wave),
            CurveKind("normal", 0.40 * share, 0.0, offset, tilt, 1.7 * wave, 0.25),
            CurveKind("rough", self.rough_share, 0.0, offset, 0.8 * tilt, 1.3 * wave, 0.3,
                      self.rough_db, _ROUGH_DECADES),
        ]  # fmt: skip

    def _lossy(self) -> list[CurveKind]:
        offset, wave, part = self.normal_offset_db, 1.5 * self.normal_wave_db, self.channel_share / len(_LOST_SHARES)
        channels: tuple[tuple[Literal["pacinian", "other"], float], ...] = (("pacinian", 0.7), ("other", 0.3))
        lost = [
            CurveKind("channel", share * part, 0.0, offset, 2.0, wave, 0.25, feature=channel,
                      feature_db=0.25 * size * self.channel_db, feature_mean_db=size * self.channel_db,
                      feature_hz=_KNEE_HZ)
            for channel, share in channels for size in _LOST_SHARES
        ]  # fmt: skip
        return [
            CurveKind("broad", self.broad_share, self.broad_mean_db, self.broad_offset_db, 4.0, wave, 0.3),
            CurveKind("uneven", self.uneven_share, 4.0, 10.0, 4.0, 0.0, rough_db=self.uneven_db),
            CurveKind("steps", self.steps_share, 6.0, 8.0, 4.0, 0.0, rough_db=1.0, walk_db=self.steps_db),
            *lost,
        ]

    def _local(self) -> list[CurveKind]:
        """Return notches of every width at every point and between, and an edge in every gap."""
        gaps = np.sqrt(self.frequency_hz[1:] * self.frequency_hz[:-1])
        places = np.sort(np.concatenate([self.frequency_hz, gaps]))
        edges = gaps[1:-1] if gaps.size > 2 else np.array([self.middle_hz])
        notch, edge = self.notch_share / (places.size * len(_NOTCH_DECADES)), self.edge_share / edges.size
        tilt, wave = 0.8 * self.normal_tilt_db_per_decade, 1.2 * self.normal_wave_db
        base = (0.0, self.normal_offset_db, tilt, wave, 0.3)
        return [
            *(
                CurveKind("notch", notch, *base, feature="notch", feature_db=0.5 * self.notch_db,
                          feature_mean_db=self.notch_db, feature_hz=hertz, feature_decades=decades)
                for hertz in places.tolist() for decades in _NOTCH_DECADES
            ),
            *(
                CurveKind("edge", edge, *base, feature="edge", feature_db=self.edge_db, feature_hz=hertz)
                for hertz in edges.tolist()
            ),
        ]  # fmt: skip


_TAIL = 0.025
_HALVINGS = 24
_WIDENED = 1.3
"""Factor by which bands are wider than the belief has them: it makes them hold for people whose slopes and lapse rates
lie between the few of the belief, as witnesses.curve.populations draws them."""


@dataclass(frozen=True)
class CurveReading:
    """A curve in dB SL: mean, standard deviation and 95 % band, each (runs, frequencies), or (frequencies,)."""

    mean: FloatArray
    sd: FloatArray
    low: FloatArray
    high: FloatArray


def mixed(share: FloatArray, level: FloatArray, sd: FloatArray) -> CurveReading:
    """Return the reading of a mixture of normal marginals.

    share: (runs, components), of sum 1. level, sd: (runs, components, frequencies).
    """
    mean = np.einsum("rk,rkf->rf", share, level)
    spread = np.sqrt(np.einsum("rk,rkf->rf", share, sd**2 + (level - mean[:, None]) ** 2))
    used = np.flatnonzero((share > 0.0).any(axis=0))
    part = share[:, used], level[:, used], sd[:, used]
    low, high = (_quantile(*part, mean, spread, tail) for tail in (_TAIL, 1.0 - _TAIL))
    low, high = (mean + _WIDENED * (edge - mean) for edge in (low, high))
    return CurveReading(mean, _WIDENED * spread, low, high)


def _quantile(
    share: FloatArray, level: FloatArray, sd: FloatArray, mean: FloatArray, spread: FloatArray, tail: float
) -> FloatArray:
    """Return a quantile of the mixture by halving, (runs, frequencies)."""
    reach = 1.0 / np.sqrt(min(tail, 1.0 - tail))  # Chebyshev: no quantile lies further from the mean
    low, high = mean - reach * spread, mean + reach * spread
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = np.einsum("rk,rkf->rf", share, scipy.special.ndtr((middle[:, None] - level) / sd)) < tail
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))
