"""What a source asks of a display, before the display's limits; and what of a clip the display does not give.

A loss is given in slices of 10 ms, over all channels, where something above threshold is asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.plain import brief, picked

SLICE_S = 0.01
_HEARD_DB = 0.05
"""Reductions of less are none."""


@dataclass(frozen=True, eq=False)
class Loss:
    """What a display does not give of a clip.

    time_s, asked_db_sl, delivered_db_sl: of each slice, on the channel that lacks most, (n,), NaN where nothing above
    threshold is asked. shortfall_db_sl: the greatest difference. clipped_s: time in which the display's limits take
    something back. frequency_shift_jnd: the greatest shift of a frequency into the display's band, in just noticeable
    differences. emphasis_rise_db: what the taps rise above the tones about them, asked and delivered, on average; None
    without taps.
    """

    time_s: FloatArray = field(repr=False)
    asked_db_sl: FloatArray = field(repr=False)
    delivered_db_sl: FloatArray = field(repr=False)
    shortfall_db_sl: float
    clipped_s: float
    frequency_shift_jnd: float
    emphasis_rise_db: tuple[float, float] | None

    __repr__ = brief

    def document(self) -> dict[str, Any]:
        """Return the figures, without the courses of time."""
        return picked(self, "shortfall_db_sl", "clipped_s", "frequency_shift_jnd", "emphasis_rise_db")


@dataclass(frozen=True, eq=False)
class Signal:
    """What a source asks for. blocks: (n, channels), threshold units, `frames` rows in all, to be taken once.

    about: what is known of the source, plain JSON. notes: what was done to it, one line each. loss: of a clip or an
    alignment, returns what is lost where the display delivers (n, channels).
    """

    frames: int
    blocks: Iterator[FloatArray]
    about: Mapping[str, Any]
    notes: tuple[str, ...] = ()
    loss: Callable[[FloatArray], Loss] | None = None

    __repr__ = brief


def loss_of(
    asked: FloatArray,
    delivered: FloatArray,
    rate_hz: float,
    shift_jnd: float,
    tones: FloatArray | None = None,
    taps: tuple[slice, ...] = (),
) -> Loss:
    """Return what is lost between what was asked for and what the display delivers, (n, channels), threshold units.

    tones: of a clip with taps, what is asked without these, (n,). taps: where each tap is.
    """
    step = max(1, round(SLICE_S * rate_hz))
    starts = np.arange(0, len(asked), step)
    want, got = (np.maximum.reduceat(np.abs(wave), starts).T for wave in (asked, delivered))
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted, given = 20.0 * np.log10(want), 20.0 * np.log10(got)
    lost = np.where(wanted >= 0.0, np.maximum(wanted - np.maximum(given, 0.0), 0.0), 0.0)
    worst, columns = np.argmax(lost, axis=0), np.arange(starts.size)
    felt = wanted[worst, columns] >= 0.0
    return Loss(
        time_s=starts / rate_hz,
        asked_db_sl=np.where(felt, wanted[worst, columns], np.nan),
        delivered_db_sl=np.where(felt, given[worst, columns], np.nan),
        shortfall_db_sl=float(lost.max(initial=0.0)),
        clipped_s=float(np.any(lost > _HEARD_DB, axis=0).sum() * step / rate_hz),
        frequency_shift_jnd=shift_jnd,
        emphasis_rise_db=None if tones is None or not taps else _rise(asked, delivered, tones, taps),
    )


def _rise(asked: FloatArray, delivered: FloatArray, tones: FloatArray, taps: tuple[slice, ...]) -> tuple[float, float]:
    """Return by how much the taps' peaks rise above the tones beneath them, or above threshold, asked and delivered."""
    levels = []
    for tap in taps:
        beneath = max(1.0, float(np.abs(tones[tap]).max(initial=0.0)))
        peaks = [max(1.0, float(np.abs(wave[tap]).max(axis=0).min())) for wave in (asked, delivered)]
        levels.append([20.0 * np.log10(peak / beneath) for peak in peaks])
    first, second = np.mean(levels, axis=0)
    return float(first), float(second)
