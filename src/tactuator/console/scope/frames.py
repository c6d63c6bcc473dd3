"""Frames of the scope: what a page's width can show of the samples, as bytes."""

from __future__ import annotations

import struct

import numpy as np

from tactuator.console.scope.messages import Look
from tactuator.console.scope.samples import SIGNALS, ScopeSamples
from tactuator.console.scope.trigger import Trigger, newest_crossing

HEADER = struct.Struct("<4I4d4I")
"""Number, columns, series, values a column (1 or 2); first row, step, end of the samples, row of the trigger (NaN:
none); frames left out, rows lost, rows in which a limit was reached, 1 where a single shot is done.
"""
_SEARCH_S = 2.0


class View:
    """A page's picture: its setting, and where a trigger or a hold has put it."""

    def __init__(self, samples: ScopeSamples, rate_hz: float, channels: tuple[str, ...]) -> None:
        self._samples, self._rate, self._channels = samples, rate_hz, channels
        self.look: Look | None = None
        self._crossing: int | None = None
        self._armed_at = 0
        self.done = False

    def set(self, look: Look) -> None:
        """Take another setting; a single shot waits for what comes from now on."""
        self.look = look
        self._crossing, self._armed_at, self.done = None, self._samples.end, False

    def frame(self, number: int, dropped: int) -> bytes | None:
        """Return the next frame, or None where there is nothing to be shown."""
        look, samples = self.look, self._samples
        if look is None or look.mode == "off" or samples.end == 0:
            return None
        span = max(2, round(look.span_s * self._rate))
        stop = self._stop(look, span)
        if stop is None:
            return None
        window = samples.window(max(0, stop - span), stop, look.columns)
        values = (window.low,) if window.step == 1 else (window.low, window.high)
        content = np.stack(values, axis=-1).transpose(1, 0, 2)  # series, columns, least and greatest
        counts = (number, content.shape[1], content.shape[0], content.shape[2])
        crossing = float("nan") if self._crossing is None else float(self._crossing)
        rows = (float(window.first), float(window.step), float(samples.end), crossing)
        told = (dropped, samples.lost, samples.saturated, int(self.done))
        return HEADER.pack(*counts, *rows, *told) + np.ascontiguousarray(content, dtype="<f4").tobytes()

    def _stop(self, look: Look, span: int) -> int | None:
        """Return the row at which the picture ends."""
        newest = self._samples.end
        if look.mode == "hold":
            self.done = True
            return look.end
        if look.mode == "roll" or look.channel not in self._channels:
            return newest
        if not self.done:
            self._look_for(look, span)
        if self._crossing is None:
            return newest if look.mode == "auto" else None
        return self._crossing + self._after(look, span)

    def _look_for(self, look: Look, span: int) -> None:
        series = SIGNALS.index(look.signal) * len(self._channels) + self._channels.index(look.channel)
        trigger = Trigger(series, look.level, look.edge)
        last = self._samples.end - self._after(look, span)
        start = max(self._armed_at if look.mode == "single" else 0, last - max(span, round(_SEARCH_S * self._rate)))
        found = newest_crossing(self._samples, trigger, start, last)
        if found is not None or look.mode == "auto":
            self._crossing = found
        self.done = look.mode == "single" and found is not None

    def _after(self, look: Look, span: int) -> int:
        return round((1.0 - look.share) * span)
