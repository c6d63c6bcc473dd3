"""Equal-strength contours: how far above threshold tones of each frequency lie that are felt equally strong.

The strength of a tone is named by the level, dB SL, of an equally strong tone at the reference frequency, and is called
its strength level, as the phon names a loudness by the level of a tone of 1 kHz.
"""

from __future__ import annotations

import hashlib
from dataclasses import field
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray, freeze_arrays, frequencies
from tactuator.errors import BadInput, within
from tactuator.parameters import Numbers, Positive, table
from tactuator.perception.curve import Contact, Provenance
from tactuator.plain import brief

REFERENCE_HZ = 100.0
"""Frequency of the tones whose level names a strength, where a file names no other."""


@table("contours", eq=False)
class Contours:
    """Equal-strength contours of one person or group.

    frequency_hz: (n,), ascending. level_db_sl: (m,), the strength levels, ascending and above 0. db_sl: (m, n), the
    sensation level that each contour has at each frequency, which rises with the strength everywhere; at reference_hz
    it is the strength level itself. low_db_sl, high_db_sl: (m, n), the 95 % band, or None.
    provenance, source: as those of a threshold curve. contact: where it was felt.

    Between the points the level is smooth in log frequency and in strength level (piecewise cubic, monotone in the
    strength). What a tone is at threshold, all are: the contour of 0 dB is 0 dB SL at every frequency. Below 0 and
    above the highest contour, and beyond the frequencies, the distance from the strength level is held.

    Raises BadInput for shapes that do not fit, numbers that are not finite, points that do not rise with the strength,
    a reference frequency beyond the points, or contours that are not at their own level there (within 0.5 dB).
    """

    name: str
    frequency_hz: Numbers
    level_db_sl: Numbers
    db_sl: Numbers
    low_db_sl: Numbers | None = None
    high_db_sl: Numbers | None = None
    reference_hz: Positive = REFERENCE_HZ
    provenance: Provenance = "not stated"
    source: str = ""
    contact: Contact = field(default_factory=Contact)

    __repr__ = brief

    def __post_init__(self) -> None:
        freeze_arrays(self, "frequency_hz", "level_db_sl", "db_sl", "low_db_sl", "high_db_sl")
        with within(repr(self.name)):
            self._check_shapes()
            self._check_levels()

    def _check_shapes(self) -> None:
        frequency, level = self.frequency_hz, self.level_db_sl
        if frequency.ndim != 1 or frequency.size < 2 or level.ndim != 1 or level.size < 1:
            raise BadInput(f"{frequency.size} frequencies and {level.size} contours", "2 or more, and 1 or more")
        for key in ("db_sl", "low_db_sl", "high_db_sl"):
            values = getattr(self, key)
            if values is not None and values.shape != (level.size, frequency.size):
                shape = " x ".join(map(str, values.shape))
                raise BadInput(f"{key} is {shape}", f"{level.size} x {frequency.size}, a row for each contour")
        tables = (frequency, level, self.db_sl, self.low_db_sl, self.high_db_sl)
        if not all(np.all(np.isfinite(values)) for values in tables if values is not None):
            raise BadInput("a frequency or level is not a finite number", "finite numbers")

    def _check_levels(self) -> None:
        frequency, level = self.frequency_hz, self.level_db_sl
        for what, values in (("frequencies", frequency), ("strength levels", level)):
            if values[0] <= 0.0 or np.any(np.diff(values) <= 0.0):
                raise BadInput(f"{what} {', '.join(f'{value:g}' for value in values)}", "ascending, above 0")
        below = np.diff(self.db_sl, axis=0, prepend=0.0) <= 0.0
        if np.any(below):
            row, place = np.argwhere(below)[0]
            got = f"{self.db_sl[row, place]:g} dB SL at {frequency[place]:g} Hz on the contour of {level[row]:g} dB SL"
            raise BadInput(got, "more than on the contour below it, above 0")
        if not frequency[0] <= self.reference_hz <= frequency[-1]:
            allowed = f"within {frequency[0]:g} to {frequency[-1]:g} Hz"
            raise BadInput(f"{self.reference_hz:g} Hz", allowed, key="reference_hz")
        off = self.level_db_sl_at(level, self.reference_hz) - level
        if np.max(np.abs(off)) > _OFF_DB:
            got = f"{off[np.argmax(np.abs(off))]:+.2f} dB from the strength level at {self.reference_hz:g} Hz"
            raise BadInput(got, f"within {_OFF_DB:g} dB: the strength level is the level there")

    def level_db_sl_at(self, strength_db_sl: ArrayLike, frequency_hz: ArrayLike) -> FloatArray:
        """Return the sensation level (dB SL) at `frequency_hz` of a tone of that strength; arguments broadcast."""
        strength, frequency = np.broadcast_arrays(
            np.asarray(strength_db_sl, dtype=np.float64), frequencies(frequency_hz)
        )
        level, asked = strength.ravel(), np.log(np.clip(frequency.ravel(), *self.frequency_hz[[0, -1]]))
        knots = np.concatenate((np.zeros((1, asked.size)), np.cumsum(self._steps(asked), axis=0)))
        inside = np.clip(level, 0.0, self._strengths[-1])
        row, _ = _place(self._strengths, inside)
        terms = scipy.interpolate.PchipInterpolator(self._strengths, knots).c[:, row, np.arange(level.size)]
        value = np.polyval(terms, inside - self._strengths[row]) + (level - inside)
        return np.asarray(value).reshape(strength.shape)

    def band_db_sl_at(self, strength_db_sl: ArrayLike, frequency_hz: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the low and the high end of the 95 % band; NaN where the contours have none. Arguments broadcast."""
        centre = self.level_db_sl_at(strength_db_sl, frequency_hz)
        ends = []
        for edge in (self.low_db_sl, self.high_db_sl):
            if edge is None:
                ends.append(np.full_like(centre, np.nan))
                continue
            bare = np.concatenate((np.zeros((1, self.frequency_hz.size)), edge - self.db_sl))
            at = np.clip(frequencies(frequency_hz), *self.frequency_hz[[0, -1]])
            point = np.clip(np.asarray(strength_db_sl, dtype=np.float64), 0.0, self._strengths[-1])
            row, share = _place(self._strengths, point)
            column, part = _place(np.log(self.frequency_hz), np.log(at))
            upper = bare[row, column] * (1.0 - part) + bare[row, column + 1] * part
            lower = bare[row + 1, column] * (1.0 - part) + bare[row + 1, column + 1] * part
            ends.append(np.asarray(centre + upper * (1.0 - share) + lower * share))
        return ends[0], ends[1]

    @property
    def content_hash(self) -> str:
        """Return SHA-256 (hex) of the points as little-endian doubles, the reference frequency first."""
        digest = hashlib.sha256(np.array([self.reference_hz]).astype("<f8").tobytes())
        for values in (self.frequency_hz, self.level_db_sl, self.db_sl):
            digest.update(values.astype("<f8").tobytes())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Contours) and (self.name, self.content_hash) == (other.name, other.content_hash)

    def __hash__(self) -> int:
        return hash((self.name, self.content_hash))

    @cached_property
    def _strengths(self) -> FloatArray:
        return np.concatenate(([0.0], self.level_db_sl))

    @cached_property
    def _steps(self) -> Any:
        """Return the steps from contour to contour, (m, points), as a function of log frequency: a cubic that is
        monotone where the points are (Fritsch & Butland 1984, SIAM J. Sci. Stat. Comput. 5:300), and so stays above 0.
        """
        steps = np.diff(self.db_sl, axis=0, prepend=0.0)
        return scipy.interpolate.PchipInterpolator(np.log(self.frequency_hz), steps, axis=1)


_OFF_DB = 0.5
"""Difference from the level that names a strength beyond which a file contradicts itself."""


def _place(x: FloatArray, at: FloatArray) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.intp]], FloatArray]:
    """Return the interval of x that each value lies in, and where in it (0 to 1 within x)."""
    row = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    return row, np.asarray((at - x[row]) / (x[row + 1] - x[row]))
