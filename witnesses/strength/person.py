"""A person with Griffin's function: at high magnitudes what is equally strong has equal velocity, at threshold all is
equal.

The function is written from its words, from velocity and the person's own threshold; it knows nothing of contours, nor
of how a display is made to follow them. From equal sensation level it lies 8.0 dB off at 30 Hz and 5.0 dB at 250 Hz.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from tactuator.arrays import FloatArray

_GROWS_DB = 8.0
"""How soon above threshold velocity takes over."""
_STANDARD_HZ = 100.0


def _threshold() -> tuple[FloatArray, FloatArray]:
    """Return the points of the person's threshold, read from the data file by this program itself."""
    folder = Path(__file__).resolve().parents[2] / "src/tactuator/perception/data"
    lines = (folder / "digitised-bolanowski-1988-thenar.csv").read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines if line[:1].isdigit()]
    table = np.array([[float(cell) for cell in row] for row in rows])
    return table[:, 0], table[:, 1]


@dataclass
class Person:
    """Somebody who tells which of two tones is stronger, sure of it by so many dB of standard deviation.

    order_db: what the second tone seems stronger by.
    """

    rng: np.random.Generator
    sigma_db: float = 2.0
    order_db: float = 0.7

    def threshold_db(self, hertz: float) -> float:
        """Return the least displacement that is felt, dB re 1 um peak."""
        at, level = _threshold()
        return float(np.interp(np.log(hertz), np.log(at), level))

    def strength(self, hertz: float, displacement_db: float) -> float:
        """Return the strength of a tone of that peak displacement (dB re 1 um): the level above threshold of a tone of
        the standard's frequency that is as strong.
        """
        above = displacement_db - self.threshold_db(hertz)
        faster_db = 20.0 * np.log10(hertz / _STANDARD_HZ) + self.threshold_db(hertz) - self.threshold_db(_STANDARD_HZ)
        if above <= 0.0:
            return above

        def less(strength: float) -> float:
            return float(strength - faster_db * (1.0 - np.exp(-((strength / _GROWS_DB) ** 2))) - above)

        return float(scipy.optimize.brentq(less, -40.0, 120.0))

    def second_is_stronger(self, first: tuple[float, float], second: tuple[float, float]) -> bool:
        """Tell which of two tones (hertz, displacement in dB) is stronger, with noise and a bias of their order."""
        apart = self.strength(*second) - self.strength(*first) + self.order_db
        return bool(apart + self.sigma_db * np.sqrt(2.0) * self.rng.standard_normal() > 0.0)
