"""Presents the intervals of a trial on a rig as one stretch, reads back what the sensor saw and when, and informs other
recorders in the room by Lab Streaming Layer (the extra `lsl`).

Two streams carry the same events with the same time stamps: one names them, the other has their numbers. They are
described as XDF, the format of LSL's recorders, expects. A trial is sent when it is over, with the times of its onsets.
"""

from __future__ import annotations

import math
import os
import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from itertools import pairwise
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.trial import IntervalRecord, Marks
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
_UNWATCHED_PIECE_S = 5.0
"""Length of the pieces in which a reference is given to the rig; a stop takes effect within one."""


class Halted(Exception):
    """Raised if the trial was stopped while it played; the rig is at rest."""


@dataclass(frozen=True)
class PlayedInterval:
    """An interval as it was played.

    trace: what the sensor saw. onset_s, duration_s: by the rig's clock, from the trial's first sample. cue_delay_s: how
    far the rig was past the onset when the watch was notified.
    """

    trace: Trace
    onset_s: float
    duration_s: float
    cue_delay_s: float

    def record(
        self,
        stimulus: str,
        commanded_db_sl: float | None = None,
        measured_db_sl: float | None = None,
        column: int | slice = slice(None),
    ) -> IntervalRecord:
        """Return its record; column: of the channel whose saturation counts, by default that of any."""
        saturated, times = bool(self.trace.saturated[:, column].any()), (self.onset_s, self.duration_s)
        return IntervalRecord(stimulus, commanded_db_sl, measured_db_sl, saturated, *times, self.cue_delay_s)


@dataclass(frozen=True)
class Presentation:
    """A trial as it was played.

    rig_tick: tick of its first sample by the rig's clock, None if the rig reports none. lasted_s: time from the first
    sample to the last.
    """

    intervals: tuple[PlayedInterval, ...]
    rig_tick: int | None
    lasted_s: float


@dataclass
class Presenter:
    """Player of trials on a rig with its controller loaded.

    watch: called as an interval begins and ends. halted: called after every piece; the trial ends at once where it
    returns True. marks: taps that announce intervals.
    """

    rig: Rig
    watch: Watch = field(default=lambda interval, begins: None)
    halted: Callable[[], bool] = field(default=lambda: False)
    marks: Marks | None = None

    def present(
        self, references: Sequence[FloatArray], lead_s: float, gap_s: float, tail_s: float = 0.0
    ) -> Presentation:
        """Play every reference (n, channels) after silence of lead_s, with gap_s between and tail_s after the last.

        All of it is one stretch of the rig's time, no gap longer or shorter by a sample. Raises Halted where the trial
        was stopped, BadInput where a reference has other channels than the rig, and as the rig's `stream` does.
        """
        stretch, onsets = self._stretch(references, lead_s, gap_s, tail_s)
        edges = [(onset, interval, True) for interval, onset in enumerate(onsets)]
        edges += [(onset + len(references[index]), index, False) for index, onset in enumerate(onsets)]
        lates = [0.0] * len(references)
        edges.sort(key=lambda edge: (edge[0], edge[2]))
        trace = join_traces(self._played(stretch, edges, lates), self.rig.rate_hz, self.rig.channels)
        rate_hz = self.rig.rate_hz
        intervals = tuple(
            PlayedInterval(trace[onset : onset + len(reference)], onset / rate_hz, len(reference) / rate_hz, late)
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
            silence_s = lead_s if interval == 0 else gap_s
            if self.marks is None:
                parts.append(self._silence(silence_s))
            else:
                parts.append(self.marks.before(interval, silence_s, self.rig.rate_hz, self.rig.channels))
            onsets.append(sum(map(len, parts)))
            parts.append(reference)
        parts.append(self._silence(tail_s))
        if self.marks is not None:
            parts.append(self.marks.end(self.rig.rate_hz, self.rig.channels))
        return np.concatenate(parts), onsets

    def _silence(self, duration_s: float) -> FloatArray:
        return np.zeros((round(duration_s * self.rig.rate_hz), len(self.rig.channels)))

    def _played(
        self, stretch: FloatArray, edges: Sequence[tuple[int, int, bool]], lates: list[float]
    ) -> Iterator[Trace]:
        """Yield the trace in pieces, and notify the watch of each edge as the rig reaches it.

        A rig that reports its time is ahead of its trace, which comes in blocks, so its count of rows is used.
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
        """Yield the stretch in pieces, cut at every onset and end, where a rig whose time waits stops exactly."""
        # a bare simulation runs ahead of any watch, a second in a millisecond: nobody is there to see a late visual cue
        piece_s = _UNWATCHED_PIECE_S if isinstance(self.rig, SimulatedRig) else _PIECE_S
        step = max(1, round(piece_s * self.rig.rate_hz))
        places = sorted({*range(0, len(stretch), step), *cuts, len(stretch)})
        for start, stop in pairwise(places):
            yield stretch[start:stop]


UNITS: Mapping[str, str] = {
    "run": "",
    "trial": "",
    "interval": "",
    "presentation": "",
    "frequency_hz": "Hz",
    "commanded_db_sl": "dB SL",
    "measured_db_sl": "dB SL",
    "rig_s": "s",
    "correct": "",
}
"""Channels of the numbers with their units; run, trial and interval are those of the store."""

THIS_MACHINE = """
[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
AddressesOverride = {127.0.0.1}
ListenAddress = 127.0.0.1
Interfaces = lo
TTLOverride = 0
[lab]
KnownPeers = {127.0.0.1}
[log]
level = -2
"""
"""Settings of LSL that look for recorders, and are found, on this machine alone."""

_LAST_SENT_S = 0.2


class Outlet:
    """Two streams of a rig; nobody need listen. name: of the rig, for people. display: its display's.

    A simulated rig without a pace has its own time in the stamps, which then begin at the present. Raises BadInput
    where pylsl is missing.
    """

    def __init__(self, rig: Rig, name: str, display: str) -> None:
        try:
            self._lsl: Any = import_module("pylsl")
        except (ImportError, RuntimeError):  # the latter where it has not its library
            raise BadInput("pylsl is missing: install it with `pip install 'tactuator[lsl]'`") from None
        if "LSLAPICFG" not in os.environ:
            self._lsl.util.set_config_content(THIS_MACHINE)
        self._rate_hz, self._speed = rig.rate_hz, rig.speed or 1.0
        self._has_rigs_time = rig.has_finger_ports and rig.speed is None
        self._zero_s: float | None = None
        self._reported_s: dict[int, float] = {}
        self._over_s = 0.0
        self._events = self._stream("markers", "Markers", "string", {"event": ""}, name, display)
        self._numbers = self._stream("levels", "Levels", "double64", UNITS, name, display)

    def _stream(self, suffix: str, kind: str, form: str, channels: Mapping[str, str], name: str, display: str) -> Any:
        source = f"tactuator {name} on {socket.gethostname()}: {suffix}"  # by which a recorder knows it after a restart
        info = self._lsl.StreamInfo(f"tactuator-{suffix}", kind, len(channels), 0.0, form, source)
        about = info.desc()
        listed = about.append_child("channels")
        for label, unit in channels.items():
            channel = listed.append_child("channel")
            for key, value in (("label", label), ("unit", unit), ("type", kind.removesuffix("s"))):
                channel.append_child_value(key, value)
        made_by = about.append_child("acquisition")
        for key, value in (("manufacturer", "tactuator"), ("model", display), ("rig", name)):
            made_by.append_child_value(key, value)
        about.append_child("synchronization").append_child_value("can_drop_samples", "false")
        return self._lsl.StreamOutlet(info)

    def wait_for_recorder(self) -> None:
        """Wait until both streams have a listener; what is sent earlier is lost."""
        for stream in (self._events, self._numbers):
            while not stream.wait_for_consumers(1.0):
                pass

    def watching(self, watch: Watch) -> Watch:
        """Return the watch of a trial, by whose calls the rig's time is known in LSL's."""

        def reported(interval: int, begins: bool) -> None:
            if begins:
                self._reported_s[interval] = self._lsl.local_clock()
            watch(interval, begins)

        return reported

    def played(self, run: int, played: PlayedTrial) -> None:
        """Send the onsets of a trial of that run, just played under `watching`."""
        begun_s, tick = self._begun_s(played), played.rig_tick
        self._over_s = begun_s + played.lasted_s / self._speed
        for place, interval in enumerate(played.intervals):
            onset_s = interval.onset_s or 0.0
            numbers = (
                *(run, played.trial.number, place, played.presentations, played.frequency_hz),
                *(interval.commanded_db_sl, interval.measured_db_sl),
                *(None if tick is None else tick / self._rate_hz + onset_s, None),
            )
            self._push(f"onset/{interval.stimulus}", numbers, begun_s + onset_s / self._speed)

    def answered(self, run: int, played: PlayedTrial, response: str, ago_s: float) -> None:
        """Send the answer to a trial, given so long ago."""
        stamp_s = self._over_s if self._has_rigs_time else self._lsl.local_clock() - ago_s
        numbers = (run, played.trial.number, None, played.presentations, played.frequency_hz, None, None, None)
        self._push(f"answer/{response}", (*numbers, played.trial.judge(response)), stamp_s)

    def _begun_s(self, played: PlayedTrial) -> float:
        """Return when the trial's first sample was played, by LSL's clock: as the promptest report of an onset has it.

        A report can come late, never early.
        """
        if self._has_rigs_time:
            tick_s = (played.rig_tick or 0) / self._rate_hz
            if self._zero_s is None:
                self._zero_s = self._lsl.local_clock() - tick_s
            return self._zero_s + tick_s
        at_s = [(interval.onset_s or 0.0) + (interval.cue_delay_s or 0.0) for interval in played.intervals]
        return min(self._reported_s[place] - after_s / self._speed for place, after_s in enumerate(at_s))

    def _push(self, event: str, numbers: tuple[float | None, ...], stamp_s: float) -> None:
        self._events.push_sample([event], stamp_s)
        self._numbers.push_sample([math.nan if number is None else float(number) for number in numbers], stamp_s)

    def close(self) -> None:
        """End the streams, once what was pushed last is sent."""
        if self._events.have_consumers() or self._numbers.have_consumers():
            time.sleep(_LAST_SENT_S)
        del self._events, self._numbers
