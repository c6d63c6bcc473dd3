"""Presents the intervals of a trial on a rig as one stretch, and reads back what the sensor saw and when."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.trial.trial import Marks
from tactuator.rig.rig import Rig, Trace, join_traces
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.excitation import ramps


def amplitude(signal: FloatArray, frequency_hz: float, rate_hz: float, ramp_s: float) -> float:
    """Return the peak amplitude at `frequency_hz` of a tone with these ramps over the whole of signal, shape (n,).

    It comes by least squares over envelope x cos, envelope x sin and a constant: the matched filter of a ramped tone.
    It has no leakage from the tone's own negative frequency, which a plain lock-in has when only a few periods are
    there, and none from an offset.
    """
    cosine, sine = _analysis(signal.size, frequency_hz, rate_hz, ramp_s) @ signal
    return float(np.hypot(cosine, sine))


@lru_cache(maxsize=64)
def _analysis(count: int, frequency_hz: float, rate_hz: float, ramp_s: float) -> FloatArray:
    """Return the two rows of the pseudo-inverse that give the cosine and sine amplitudes, shape (2, count)."""
    envelope = ramps(count, rate_hz, ramp_s)
    phase = 2.0 * np.pi * frequency_hz * np.arange(count) / rate_hz
    basis = np.column_stack([envelope * np.cos(phase), envelope * np.sin(phase), np.ones(count)])
    return np.ascontiguousarray(np.linalg.solve(basis.T @ basis, basis.T)[:2])


Watch = Callable[[int, bool], None]
"""A function called with (interval from 0, True) as it begins and (interval, False) as it ends, by the rig's time."""

_PIECE_S = 0.02
_UNWATCHED_PIECE_S = 0.5
"""Length of the pieces in which a reference is given to the rig; a stop takes effect within one."""


class Halted(Exception):
    """Raised where somebody stopped the trial while it played; the rig is at rest."""


@dataclass(frozen=True)
class PlayedInterval:
    """An interval as it was played.

    trace: what the sensor saw. onset_s, duration_s: by the rig's clock, from the trial's first sample. lamp_late_s: how
    far the rig was past the onset when the watch was told of it.
    """

    trace: Trace
    onset_s: float
    duration_s: float
    lamp_late_s: float


@dataclass(frozen=True)
class Presentation:
    """A trial as it was played.

    rig_tick: tick of its first sample by the rig's clock, None where the rig tells none. lasted_s: time from the first
    sample to the last.
    """

    intervals: tuple[PlayedInterval, ...]
    rig_tick: int | None
    lasted_s: float


@dataclass
class Presenter:
    """Player of trials on one channel of a rig with its controller loaded.

    watch: called as an interval begins and ends. halted: called after every piece; the trial ends at once where it
    returns True. marks: taps that announce intervals. Raises BadInput where the rig has no such channel.
    """

    rig: Rig
    channel: str
    watch: Watch = field(default=lambda interval, begins: None)
    halted: Callable[[], bool] = field(default=lambda: False)
    marks: Marks | None = None

    def __post_init__(self) -> None:
        if self.channel not in self.rig.channels:
            raise BadInput(f"channel {self.channel!r} is not on the rig", f"{', '.join(self.rig.channels)}")

    @property
    def column(self) -> int:
        """Return the channel's place among those of the rig."""
        return self.rig.channels.index(self.channel)

    def on_channel(self, wave: FloatArray) -> FloatArray:
        """Return a reference of every channel, (n, channels), from the wave of one, (n,)."""
        reference = np.zeros((wave.size, len(self.rig.channels)))
        reference[:, self.column] = wave
        return reference

    def present(
        self, references: Sequence[FloatArray], lead_s: float, gap_s: float, tail_s: float = 0.0
    ) -> Presentation:
        """Play every reference (n, channels) after silence of lead_s, with gap_s between and tail_s after the last.

        All of it is one stretch of the rig's time, so that no gap is longer or shorter by a sample. Raises Halted where
        the trial was stopped, BadInput where a reference has other channels than the rig, and as the rig's `stream`
        does.
        """
        stretch, onsets = self._stretch(references, lead_s, gap_s, tail_s)
        edges = [(onset, interval, True) for interval, onset in enumerate(onsets)]
        edges += [(onset + len(references[index]), index, False) for index, onset in enumerate(onsets)]
        lates = [0.0] * len(references)
        edges.sort(key=lambda edge: (edge[0], edge[2]))
        trace = join_traces(self._played(stretch, edges, lates), self.rig.rate_hz, self.rig.channels)
        rate_hz = self.rig.rate_hz
        intervals = tuple(
            PlayedInterval(trace.part(onset, onset + len(reference)), onset / rate_hz, len(reference) / rate_hz, late)
            for reference, onset, late in zip(references, onsets, lates, strict=True)
        )
        tick = self.rig.began_at
        return Presentation(intervals, tick, len(stretch) / rate_hz)

    def _stretch(
        self, references: Sequence[FloatArray], lead_s: float, gap_s: float, tail_s: float
    ) -> tuple[FloatArray, list[int]]:
        """Return the whole trial, (n, channels), and the sample at which each reference begins."""
        parts: list[FloatArray] = []
        onsets: list[int] = []
        for interval, reference in enumerate(references):
            if reference.ndim != 2 or reference.shape[1] != len(self.rig.channels):
                raise BadInput(f"reference of shape {reference.shape}", f"(samples, {len(self.rig.channels)})")
            parts.append(self._before(interval, lead_s if interval == 0 else gap_s))
            onsets.append(sum(map(len, parts)))
            parts.append(reference)
        parts.append(self._silence(tail_s))
        if self.marks is not None:
            parts.append(self.marks.end(self.rig.rate_hz, self.rig.channels))
        return np.concatenate(parts), onsets

    def _before(self, interval: int, silence_s: float) -> FloatArray:
        if self.marks is None:
            return self._silence(silence_s)
        return self.marks.before(interval, silence_s, self.rig.rate_hz, self.rig.channels)

    def _silence(self, duration_s: float) -> FloatArray:
        return np.zeros((round(duration_s * self.rig.rate_hz), len(self.rig.channels)))

    def _played(
        self, stretch: FloatArray, edges: Sequence[tuple[int, int, bool]], lates: list[float]
    ) -> Iterator[Trace]:
        """Yield the trace in pieces, and tell the watch of each edge as the rig reaches it.

        A rig that tells its time is ahead of its trace, which comes in blocks: its own count of rows is what counts.
        """
        waiting, got, rig = list(edges), 0, self.rig
        self._notify_watch(waiting, got, lates)
        for trace in rig.stream(self._pieces(stretch, [edge[0] for edge in edges])):
            got += len(trace)
            self._notify_watch(waiting, max(got, rig.rows_played), lates)
            yield trace
            if self.halted():
                self.rig.rest()
                raise Halted

    def _notify_watch(self, waiting: list[tuple[int, int, bool]], reached: int, lates: list[float]) -> None:
        while waiting and waiting[0][0] <= reached:
            sample, interval, begins = waiting.pop(0)
            if begins:
                lates[interval] = (reached - sample) / self.rig.rate_hz
            self.watch(interval, begins)

    def _pieces(self, stretch: FloatArray, cuts: Sequence[int]) -> Iterator[FloatArray]:
        """Yield the stretch in pieces, cut at every onset and end, where a rig whose time waits then stands exactly."""
        # a bare simulation runs ahead of any watch: nobody is there to see a lamp late
        piece_s = _UNWATCHED_PIECE_S if isinstance(self.rig, SimulatedRig) else _PIECE_S
        step = max(1, round(piece_s * self.rig.rate_hz))
        places = sorted({*range(0, len(stretch), step), *cuts, len(stretch)})
        for start, stop in pairwise(places):
            yield stretch[start:stop]
