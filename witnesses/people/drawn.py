"""Generator of people: threshold curves, slopes, lapses, and what wears on them. Nothing of the program is in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GUESS, TARGET = 1.0 / 3.0, 0.5 ** (1.0 / 3.0)
WAVES = 48


@dataclass(frozen=True)
class People:
    """Several people. offset_db, slope, lapse: (people,). wave_db, per_decade, phase: cosines over log10 frequency,
    (people, WAVES). early_db: how much higher thresholds are at the first trial, forgotten in 15 trials. late_db,
    late_lapse: what is added to threshold and lapse rate by the last trial. guessing: nothing is felt."""

    offset_db: Array
    slope: Array
    lapse: Array
    wave_db: Array
    per_decade: Array
    phase: Array
    early_db: float = 0.0
    late_db: float = 0.0
    late_lapse: float = 0.0
    guessing: bool = False

    def threshold_db(self, who: NDArray[np.intp], hertz: Array) -> Array:
        """Return thresholds, dB re the display's curve, of persons at frequencies, (n,) each."""
        along = self.per_decade[who] * np.log10(hertz)[:, None] + self.phase[who]
        return np.asarray(self.offset_db[who] + (self.wave_db[who] * np.cos(2.0 * np.pi * along)).sum(axis=1))

    def right(
        self, who: NDArray[np.intp], hertz: Array, level_db: Array, done: Array, rng: np.random.Generator
    ) -> NDArray[np.bool_]:
        """Return whether trials are answered rightly, (n,). done: share of the run's trials before each."""
        if self.guessing:
            return np.asarray(rng.random(who.size) < GUESS)
        trial = 150.0 * done
        lapse = np.minimum(self.lapse[who] + self.late_lapse * done, 0.19)
        above = level_db - self.threshold_db(who, hertz) - self.early_db * np.exp(-trial / 15.0) - self.late_db * done
        half = -np.log(1.0 - (TARGET - GUESS) / (1.0 - GUESS - lapse))
        seen = 1.0 - np.exp(-half * 10.0 ** (self.slope[who] * np.clip(above, -200.0, 80.0) / 20.0))
        return np.asarray(rng.random(who.size) < GUESS + (1.0 - GUESS - lapse) * seen)


def _drawn(count: int, rng: np.random.Generator, wave_db: float, decades: float, offset_db: float,
           slopes: tuple[float, float], lapses: tuple[float, float], **wear: float | bool) -> People:  # fmt: skip
    """Draw people whose curves are Gaussian waves of that deviation and length of correlation (random cosines)."""
    size = (count, WAVES)
    amplitude = np.full(size, wave_db * np.sqrt(2.0 / WAVES))
    per_decade = rng.standard_normal(size) / (2.0 * np.pi * decades)
    offset, slope = offset_db * rng.standard_normal(count), rng.uniform(*slopes, count)
    return People(offset, slope, rng.uniform(*lapses, count), amplitude, per_decade, rng.random(size), **wear)  # type: ignore[arg-type]


def _rough(count: int, rng: np.random.Generator, **wear: float | bool) -> People:
    return _drawn(count, rng, 3.0, 0.25, 3.0, (1.5, 4.0), (0.0, 0.04), **wear)


POPULATIONS: dict[str, Callable[[int, np.random.Generator], People]] = {
    "normal": lambda count, rng: _drawn(count, rng, 2.0, 0.5, 3.0, (2.0, 3.0), (0.0, 0.02)),
    "rough": _rough,
    "slow": lambda count, rng: _rough(count, rng, early_db=4.0),
    "tired": lambda count, rng: _rough(count, rng, late_db=1.5, late_lapse=0.03),
    "drifting": lambda count, rng: _rough(count, rng, late_db=6.0),
    "lapsing": lambda count, rng: _drawn(count, rng, 3.0, 0.25, 3.0, (1.5, 4.0), (0.15, 0.15)),
    "guessing": lambda count, rng: _rough(count, rng, guessing=True),
}
