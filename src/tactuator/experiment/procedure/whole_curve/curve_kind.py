"""One kind of threshold curve that a person may have: a Gaussian process over log frequency.

Relative to the display's own curve (0 dB SL) a curve is a mean, an offset, a tilt in dB per decade about the band's
middle, and up to four deviations: a smooth wave (squared exponential), a rough one (Matern 3/2), a walk with sudden
steps (exponential kernel) and one feature at a place: a notch, or an edge beyond which the loss is another. All
amplitudes are standard deviations of normal variables (Rasmussen & Williams 2006, chapter 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

_EDGE_DECADES = 0.02
"""Width of an edge's logistic: narrower than the spacing of any grid of points in use."""


@dataclass(frozen=True)
class CurveKind:
    """A kind of curve and its share of the people.

    share: prior probability. mean_db, offset_db, tilt_db_per_decade: of the line. wave_db, rough_db, walk_db:
    amplitudes of the deviations, with their lengths in decades. feature_db: amplitude of a notch at feature_hz of width
    feature_decades (standard deviation of a Gaussian), or of an edge there. A term of zero is absent. Raises BadInput
    for a negative amplitude or a length that is not positive.
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
    feature: Literal["none", "notch", "edge"] = "none"
    feature_db: float = 0.0
    feature_hz: float = 10.0
    feature_decades: float = 0.15

    def __post_init__(self) -> None:
        amplitudes = (self.offset_db, self.tilt_db_per_decade, self.wave_db, self.rough_db, self.walk_db)
        if min(*amplitudes, self.feature_db, self.share) < 0.0:
            raise BadInput(f"curves of kind {self.name!r}: a standard deviation or share is negative", "0 or more")
        lengths = (self.wave_decades, self.rough_decades, self.walk_decades, self.feature_decades, self.feature_hz)
        if min(lengths) <= 0.0:
            raise BadInput(f"curves of kind {self.name!r}: a length or frequency is not positive", "above 0")

    def covariance(self, first_hz: ArrayLike, second_hz: ArrayLike, middle_hz: float) -> FloatArray:
        """Return the prior covariance, dB^2, shape (first, second). middle_hz: the frequency about which the tilt
        turns.
        """
        a = np.log10(np.asarray(first_hz, dtype=np.float64))[:, None]
        b = np.log10(np.asarray(second_hz, dtype=np.float64))[None, :]
        middle, apart = np.log10(middle_hz), np.abs(a - b)
        found = self.offset_db**2 + self.tilt_db_per_decade**2 * (a - middle) * (b - middle)
        found = found + self.wave_db**2 * np.exp(-0.5 * (apart / self.wave_decades) ** 2)
        rough = np.sqrt(3.0) * apart / self.rough_decades
        found = found + self.rough_db**2 * (1.0 + rough) * np.exp(-rough)
        found = found + self.walk_db**2 * np.exp(-apart / self.walk_decades)
        return np.asarray(found + self.feature_db**2 * self._feature(a) * self._feature(b))

    def _feature(self, decades: FloatArray) -> FloatArray:
        beyond = decades - np.log10(self.feature_hz)
        if self.feature == "notch":
            return np.asarray(np.exp(-0.5 * (beyond / self.feature_decades) ** 2))
        if self.feature == "edge":
            return np.asarray(0.5 * (1.0 + np.tanh(0.5 * beyond / _EDGE_DECADES)))
        return np.zeros_like(beyond)

    def draw(self, frequency_hz: ArrayLike, middle_hz: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw the curves of `count` people, dB relative to the display's curve, shape (count, frequencies)."""
        covariance = self.covariance(frequency_hz, frequency_hz, middle_hz)
        root = np.linalg.cholesky(covariance + 1e-8 * np.eye(len(covariance)))
        return np.asarray(self.mean_db + rng.standard_normal((count, len(covariance))) @ root.T)

    def between(self, points_hz: FloatArray, others_hz: ArrayLike, middle_hz: float) -> tuple[FloatArray, FloatArray]:
        """Return the conditional mean at others as weights of the points, (others, points), and its variance,
        (others,).
        """
        own = self.covariance(points_hz, points_hz, middle_hz) + 1e-6 * np.eye(points_hz.size)
        across = self.covariance(points_hz, others_hz, middle_hz)
        weights: FloatArray = np.asarray(np.linalg.solve(own, across).T, dtype=np.float64)
        others = np.asarray(others_hz, dtype=np.float64)
        alone = np.array([self.covariance([one], [one], middle_hz)[0, 0] for one in others])
        return weights, np.asarray(np.maximum(alone - np.einsum("og,go->o", weights, across), 0.0))
