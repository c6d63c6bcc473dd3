"""Human detection threshold against frequency."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.signals.decibels import from_db

Provenance = Literal["measured", "digitised", "inferred", "synthetic", "simulated"]


@dataclass(frozen=True, eq=False)
class ThresholdCurve:
    """Detection threshold: level of a sinusoid's peak displacement, dB re 1 um, at ascending frequencies.

    frequency_hz, level_db_re_1um: shape (n,), n >= 3. Between the points the level is linear in log frequency; beyond
    them it is held constant, so that DC has a meaning. standard_error_db: shape (n,), where the curve was measured.
    provenance: how the numbers came about; source: one line for a figure's caption.

    Raises BadInput for fewer than three points, frequencies that are not positive and strictly ascending, or numbers
    that are not finite.
    """

    name: str
    frequency_hz: FloatArray
    level_db_re_1um: FloatArray
    provenance: Provenance
    source: str
    standard_error_db: FloatArray | None = None

    def __post_init__(self) -> None:
        for field in ("frequency_hz", "level_db_re_1um", "standard_error_db"):
            values = getattr(self, field)
            if values is not None:
                array = np.array(values, dtype=np.float64)
                array.flags.writeable = False
                object.__setattr__(self, field, array)
        self._check()

    def _check(self) -> None:
        frequency, level = self.frequency_hz, self.level_db_re_1um
        where = f"threshold curve {self.name!r}"
        if self.provenance not in get_args(Provenance):
            raise BadInput(f"{where}: provenance {self.provenance!r}", f"{', '.join(get_args(Provenance))}")
        if frequency.ndim != 1 or frequency.shape != level.shape:
            raise BadInput(f"{where}: {frequency.size} frequencies and {level.size} levels", "as many of each")
        if frequency.size < 3:
            raise BadInput(f"{where}: {frequency.size} points", "three or more")
        if not (np.all(np.isfinite(frequency)) and np.all(np.isfinite(level))):
            raise BadInput(f"{where}: a frequency or level is not a finite number")
        if np.any(frequency <= 0.0):
            raise BadInput(f"{where}: frequency {frequency.min():g} Hz", "positive")
        self._check_order()
        errors = self.standard_error_db
        if errors is not None and errors.shape != frequency.shape:
            raise BadInput(f"{where}: {errors.size} standard errors for {frequency.size} points", "one each")

    def _check_order(self) -> None:
        steps = np.diff(self.frequency_hz)
        if np.any(steps == 0.0):
            twice = self.frequency_hz[1:][steps == 0.0][0]
            raise BadInput(f"threshold curve {self.name!r}: {twice:g} Hz stands twice", "each frequency once")
        if np.any(steps < 0.0):
            late = self.frequency_hz[1:][steps < 0.0][0]
            raise BadInput(f"threshold curve {self.name!r}: {late:g} Hz is out of order", "ascending frequencies")

    def level_db_re_1um_at(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the threshold level (dB re 1 um peak) at `frequency_hz` (any shape, zero allowed)."""
        frequency = np.clip(np.asarray(frequency_hz, dtype=np.float64), *self.frequency_hz[[0, -1]])
        return np.asarray(np.interp(np.log(frequency), np.log(self.frequency_hz), self.level_db_re_1um))

    def amplitude_um(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the peak displacement at threshold, micrometres."""
        return from_db(self.level_db_re_1um_at(frequency_hz))

    def displacement_mm(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the peak displacement at threshold, millimetres."""
        return self.amplitude_um(frequency_hz) * 1e-3

    def covers(self, low_hz: float, high_hz: float) -> bool:
        """Return whether the points reach over the whole band."""
        return bool(self.frequency_hz[0] <= low_hz and high_hz <= self.frequency_hz[-1])

    @property
    def content_hash(self) -> str:
        """Return SHA-256 (hex) of the points as little-endian doubles: the same curve has the same hash anywhere."""
        digest = hashlib.sha256()
        digest.update(self.frequency_hz.astype("<f8").tobytes())
        digest.update(self.level_db_re_1um.astype("<f8").tobytes())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ThresholdCurve) and (self.name, self.content_hash) == (other.name, other.content_hash)

    def __hash__(self) -> int:
        return hash((self.name, self.content_hash))
