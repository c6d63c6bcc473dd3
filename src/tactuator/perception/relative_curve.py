"""A person's threshold against frequency, relative to a display's own curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.errors import BadInput


@dataclass(frozen=True, eq=False)
class RelativeCurve:
    """Level level_db_sl at ascending frequency_hz, shape (n,), n >= 1: linear in log frequency between, held beyond.

    Two points with the same level are a flat loss; one is enough for that. Raises BadInput for frequencies that are not
    positive and strictly ascending, or numbers that are not finite.
    """

    frequency_hz: NDArray[np.float64]
    level_db_sl: NDArray[np.float64]
    name: str = "truth"

    def __post_init__(self) -> None:
        frequency, level = self.frequency_hz, self.level_db_sl
        if frequency.ndim != 1 or frequency.shape != level.shape or frequency.size < 1:
            raise BadInput(f"curve {self.name!r}: {frequency.size} frequencies, {level.size} levels", "as many")
        if not (np.all(np.isfinite(frequency)) and np.all(np.isfinite(level))):
            raise BadInput(f"curve {self.name!r}: a number is not finite", "finite frequencies and levels")
        if frequency[0] <= 0.0 or np.any(np.diff(frequency) <= 0.0):
            raise BadInput(f"curve {self.name!r}: frequencies are not in order", "positive, strictly ascending")

    def level_db_sl_at(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Return the level in dB SL at `frequency_hz`, of any shape."""
        asked = np.log(np.asarray(frequency_hz, dtype=np.float64))
        return np.asarray(np.interp(asked, np.log(self.frequency_hz), self.level_db_sl))
