"""Frequencies that are played for those that are asked: within 2 %, inside the band, off mains, or refused.

What the sensor shows at a multiple of mains is not what the finger feels, so that a test frequency keeps 2 Hz away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.signals.multisine import Bins, place_lines
from tactuator.signals.spectra import off_mains

Band = tuple[float, float]

TOLERANCE = 0.02
"""Greatest relative distance between a frequency that is asked and the one that is played for it."""
_KEEP_OFF_HZ = 2.0
_DENSEST = 201
POINT_COUNT = 30


def over_the_band(band_hz: Band, mains_hz: float | None) -> FloatArray:
    """Return 30 frequencies over the band of our own choosing, hertz, moved off mains to the side inside the band."""
    chosen = np.geomspace(*band_hz, POINT_COUNT)
    moved = off_mains(chosen, mains_hz or None)
    return np.where(moved > band_hz[1], 2.0 * chosen - moved, np.maximum(moved, band_hz[0]))


def tones(frequency_hz: ArrayLike, mains_hz: float | None, band_hz: Band) -> FloatArray:
    """Return the frequencies to play, ascending, each once, hertz: those asked, or the nearest 2 Hz off mains.

    Raises BadInput, naming the first, for a frequency outside band_hz, or one for which nothing within 2 % is inside
    the band and off mains.
    """
    asked = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    return np.unique([_tone(float(hertz), mains_hz, band_hz) for hertz in asked])


def _tone(hertz: float, mains_hz: float | None, band_hz: Band) -> float:
    _require_inside(hertz, band_hz)
    if not mains_hz:
        return hertz
    line = mains_hz * max(round(hertz / mains_hz), 1.0)
    if abs(hertz - line) >= _KEEP_OFF_HZ:
        return hertz
    sides = sorted((line - _KEEP_OFF_HZ, line + _KEEP_OFF_HZ), key=lambda side: (abs(side - hertz), -side))
    for side in sides:
        if band_hz[0] <= side <= band_hz[1] and abs(side - hertz) <= TOLERANCE * hertz:
            return side
    raise BadInput(
        f"{hertz:g} Hz lies beside {line:g} Hz of mains, and nothing within 2 % of it is {_KEEP_OFF_HZ:g} Hz off and "
        f"inside the band",
        f"{' or '.join(f'{side:g} Hz' for side in sorted(sides))}, or no mains",
    )


def _require_inside(hertz: float, band_hz: Band) -> None:
    if not band_hz[0] <= hertz <= band_hz[1]:
        raise BadInput(f"{hertz:g} Hz", f"{band_hz[0]:g} to {band_hz[1]:g} Hz, the band")


def multisine_lines(
    frequency_hz: ArrayLike,
    rate_hz: float,
    longest_s: float,
    mains_hz: float | None,
    band_hz: Band,
    exactly: bool = True,
) -> tuple[int, Bins]:
    """Return (period in samples, odd lines of it): the shortest period whose lines are all within 2 % of `frequency_hz`
    (m,), each line once, inside band_hz and off mains.

    Not `exactly`, for a sweep whose frequencies nobody asked for: the shortest period whose nearest lines all lie
    inside band_hz, or the longest that fits, with those of its lines that do. Raises BadInput, naming a frequency that
    cannot be played, where two periods of none fit into longest_s, or no line is inside the band.
    """
    asked = np.sort(np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64)))
    for hertz in asked if exactly else ():
        _require_inside(float(hertz), band_hz)
    missed = f"two periods of {asked[0]:g} Hz within {longest_s:g} s"
    longest: tuple[int, Bins] | None = None
    for times in range(1, _DENSEST + 1, 2):
        period = round(times * rate_hz / asked[0])
        if 2.0 * period / rate_hz > longest_s:
            break
        try:
            bins = place_lines(asked, rate_hz, period, mains_hz=mains_hz)
        except BadInput as error:  # more frequencies than such a period has lines
            missed = str(error) if exactly else missed
            continue
        played = bins * rate_hz / period
        inside = (played >= band_hz[0] * (1 - 1e-9)) & (played <= band_hz[1] * (1 + 1e-9))
        off = np.abs(played / asked - 1.0) if exactly else np.zeros(played.shape)
        bad = np.flatnonzero((off > TOLERANCE) | ~inside)
        if bad.size == 0:
            return period, bins
        if exactly:
            worst = int(bad[np.argmax(off[bad])])
            missed = f"{asked[worst]:g} Hz would be played as {played[worst]:g} Hz"
        elif np.any(inside):
            longest = (period, bins[inside])
    if longest is not None:
        return longest
    instead = ", frequencies further apart or off mains, or the stepped sine" if exactly else ""
    raise BadInput(missed, f"a longer time{instead}", where=("multisine",))
