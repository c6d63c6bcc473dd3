"""Runs of a board: rows fed ahead of what it plays, tones that it makes itself, and the trace of both without a gap.

Layouts: core/link/link.h, core/board/stimulus.h.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, DeviceFault, TimingMissed, unknown
from tactuator.rig.board.link import LinkClient, Mode, TraceRows
from tactuator.rig.rig import Finger, anybody_feels, let_feel, take_forces
from tactuator.runtime._core import lib
from tactuator.runtime.simulation import REFERENCE_MAX

_REQUEST_ROWS = 128
"""Rows in a request to a board whose time goes on: the link should never be long without a word."""
_FIRST_ROWS = 64
"""Few, so that they are there in time; what follows has the lead of them."""
_START_ATTEMPTS = 6
"""Each leaves twice the time of the one before: the last 32 times the first."""
_READ_ROWS = 100
"""Rows for which the trace of a board whose time goes on is worth a request: 25 ms at 4 kHz."""
_POLL_S = 0.004
"""Pause between two looks at a board: 16 ticks at 4 kHz, in which its trace cannot overflow."""
_POLL_LEAD = 80
"""Rows of lead below which the pause is shorter in proportion: it should be a fifth of the lead at most."""
_IDLE_READS = 1000
"""Reads without a row, one after another, from a board that waits for its rows: it has none to wait for."""
TONES_MAX: int = lib.TACT_TONES_MAX
"""Tones of a channel at once."""
LONGEST_S = 3600.0
"""Of what a board makes itself; far below what its counts of ticks hold."""
Rows = NDArray[np.float32]


class StreamDry(TimingMissed):
    """The board had no row for `ticks` of its ticks so far, and played zeros: the host or the link is too slow."""

    def __init__(self, got: str, allowed: str, ticks: int) -> None:
        super().__init__(got, allowed)
        self.ticks = ticks


class BoardStream:
    """Feeder of one stretch's rows to a board: `lead` of them ahead of what it plays; none goes while the trace is
    `lag` behind.

    waits: the board's time stops while it has no row (boards with a simulated display); otherwise time continues, and a
    late row raises StreamDry. fingers are pressed, and feel.
    """

    def __init__(
        self,
        client: LinkClient,
        run: int,
        channels: int,
        lead: int,
        lag: int,
        waits: bool,
        fingers: Sequence[Finger] = (),
        sleep: Callable[[float], None] = lambda seconds: None,
    ) -> None:
        self._client, self._run, self._channels = client, run, channels
        self._lead, self._lag, self._once = lead, lag, lead // 2 if waits else min(_REQUEST_ROWS, lead)
        self._waits, self._fingers, self._sleep = waits, fingers, sleep
        self._rows: Rows = np.zeros((0, channels), dtype=np.float32)
        self._forces: Rows | None = None
        self._tick = self._idle = 0
        self.first = self._got = self.end = 0

    @property
    def rows_played(self) -> int:
        """Return the number of rows that the board has played, as far as it has reported; if its time stops, those of
        which the trace has been read.
        """
        reached = self._got if self._waits else min(max(self._tick, self._got), self.end)
        return max(0, reached - self.first)

    def play(self, blocks: Iterable[Rows], first: int = 0, start: int = 0) -> Iterator[TraceRows | None]:
        """Yield the trace of all rows, in pieces as it comes; the next block (n, channels) is asked for when there is
        room for it. None is yielded where the board reported its tick and gave no rows.

        first: tick of the first row, on a board that waits; on another it is `start` ticks from now. Raises RigFault
        and StreamDry.
        """
        self.first = self._got = self.end = first
        source, more = iter(blocks), True
        while more or len(self._rows) or self._got < self.end:
            while more and not len(self._rows) and self._ahead() < self._lead:
                more = self._take_block(next(source, None))
            if len(self._rows) and self._ahead() < self._lead and self._tick - self._got < self._lag:
                self._feed(start)
                if not self._waits:
                    yield None
                    if self._ahead() < self._lead // 4:
                        continue  # first what is needed first
            part = self._read()
            if part is not None or not self._waits:
                yield part

    def _ahead(self) -> int:
        return self.end - max(self._tick, self.first)

    def _take_block(self, block: Rows | None) -> bool:
        if block is None:
            return False
        forces = take_forces(self._fingers, len(block))
        self._rows, self._forces = block, None if forces is None else forces.astype(np.float32)
        return True

    def _feed(self, start: int) -> None:
        if not self._waits and self._got == self.end == self.first:
            taken = self._feed_first(start)
        else:
            taken = self._ask_to_take(self._rows[: self._once])
            if taken < min(self._once, len(self._rows)) and self._tick > self.end:
                raise StreamDry(
                    f"the stream ran dry {self.end - self.first} samples after its beginning",
                    f"a host and a link that carry {4 * self._channels} bytes a sample there and "
                    f"{8 * self._channels} back",
                    self._tick - self.end,
                )
        self._rows = self._rows[taken:]
        self._forces = None if self._forces is None else self._forces[taken:]

    def _feed_first(self, start: int) -> int:
        """Send the first rows, for a tick far enough ahead or the next one; return how many were taken."""
        for attempt in range(_START_ATTEMPTS):
            there = self._look()
            while self._tick < there < self._tick + start:
                self._sleep(_POLL_S)
                there = self._look()
            self.first = self._got = self.end = max(there, self._tick + (start << attempt))
            taken = self._ask_to_take(self._rows[:_FIRST_ROWS])
            if taken:
                return taken
        raise StreamDry("the first samples of a stream came too late", "a faster host or link", start)

    def _ask_to_take(self, rows: Rows) -> int:
        forces = None if self._forces is None else self._forces[: len(rows)]
        end, self._tick = self._client.stream(self._run, self.end, rows, forces)
        taken = max(0, min(end - self.end, len(rows)))
        self.end += taken
        return taken

    def _read(self) -> TraceRows | None:
        last = not len(self._rows) and self._tick >= self.end
        worth = 0 if self._waits or last else _READ_ROWS
        if self._tick - self._got < worth:
            self._sleep(_POLL_S * min(1.0, self._lead / _POLL_LEAD))
            self._look()
            return None
        felt = anybody_feels(self._fingers)
        part = self._client.trace(self._run, self._got, self.end - self._got, self._channels, felt)
        if not part.command_code.shape[0]:
            self._look()
            self._require_progress()
            return None
        self._idle = 0
        self._got += part.command_code.shape[0]
        self._tick = max(self._tick, self._got)
        if part.felt_mm is not None:
            let_feel(self._fingers, part.felt_mm.astype(np.float64))
        return part

    def _require_progress(self) -> None:
        """Raise DeviceFault if a waiting board has rows and does not play them."""
        self._idle += self._waits
        if self._idle > _IDLE_READS:
            raise DeviceFault(
                f"the board stopped at tick {self._tick} of its run, although it has rows up to {self.end}",
                "one that plays them",
            )

    def _look(self) -> int:
        """Read the tick of the board, and return the tick up to which it has rows."""
        status = self._client.status()
        status.require_no_fault()
        if status.mode is not Mode.RUNNING:
            raise BadInput(f"the board is {status.mode.name}: stopped by another user", "a board that nobody else uses")
        self._tick = status.tick
        return status.stream_end


@dataclass(frozen=True)
class BoardTone:
    """A sinusoid that begins at zero, with raised-cosine ramps. amplitude: threshold units, peak; start_s: after the
    soft start. Several in a row are the intervals of a trial; several at once add up."""

    frequency_hz: float
    amplitude: float
    start_s: float
    duration_s: float
    ramp_s: float = 0.05

    def __post_init__(self) -> None:
        if not (self.frequency_hz > 0.0 and abs(self.amplitude) <= REFERENCE_MAX):
            raise BadInput(
                f"tone of {self.frequency_hz:g} Hz at {self.amplitude:g} threshold units",
                f"above 0 Hz, at most {REFERENCE_MAX:g} (60 dB SL)",
            )
        if not (0.0 <= self.start_s <= LONGEST_S and 0.0 <= 2.0 * self.ramp_s <= self.duration_s <= LONGEST_S):
            raise BadInput(
                f"tone from {self.start_s:g} s for {self.duration_s:g} s with ramps of {self.ramp_s:g} s",
                f"from 0 s on, ramps of at most half of it, up to {LONGEST_S:g} s",
            )

    def wave(self, count: int, rate_hz: float) -> FloatArray:
        """Return the first `count` samples of the tone, threshold units."""
        start, length, ramp = self._ticks(rate_hz)
        at = np.arange(count) - start
        rise = np.clip(np.minimum(at, length - at) / max(ramp, 1), 0.0, 1.0) if ramp else np.ones(count)
        wave = self.amplitude * np.sin(2.0 * np.pi * self.frequency_hz / rate_hz * at) * np.sin(0.5 * np.pi * rise) ** 2
        return np.where((at >= 0) & (at < length), wave, 0.0)

    def content(self, rate_hz: float, first: int) -> bytes:
        """Return the tone as the link carries it, from tick `first` on. Raises BadInput from half the rate on."""
        if not self.frequency_hz < 0.5 * rate_hz:
            raise BadInput(f"tone of {self.frequency_hz:g} Hz", f"below {0.5 * rate_hz:g} Hz on this board")
        start, length, ramp = self._ticks(rate_hz)
        angle, rise = 2.0 * np.pi * self.frequency_hz / rate_hz, np.pi / max(ramp, 1)
        turns = (np.cos(angle), np.sin(angle), np.cos(rise), np.sin(rise))
        return struct.pack("<3I5f", first + start, length, ramp, self.amplitude, *turns)

    def _ticks(self, rate_hz: float) -> tuple[int, int, int]:
        length = round(self.duration_s * rate_hz)
        return round(self.start_s * rate_hz), length, min(round(self.ramp_s * rate_hz), length // 2)


def stimulus_payloads(
    tones: Mapping[str, Sequence[BoardTone]], channels: Sequence[str], rate_hz: float, first: int
) -> list[bytes]:
    """Return a payload for every channel, silent ones too. Raises BadInput: unknown channel, or too many tones."""
    strange = sorted(set(tones) - set(channels))
    if strange:
        raise unknown("channel", strange[0], channels)
    payloads = []
    for index, name in enumerate(channels):
        mine = tones.get(name, ())
        if len(mine) > TONES_MAX:
            raise BadInput(f"{len(mine)} tones on channel {name!r}", f"at most {TONES_MAX}")
        payloads.append(bytes([index, len(mine)]) + b"".join(tone.content(rate_hz, first) for tone in mine))
    return payloads


def read_run(
    client: LinkClient,
    run: int,
    first: int,
    count: int,
    channels: int,
    fingers: Sequence[Finger],
    sleep: Callable[[float], None],
) -> Iterator[TraceRows]:
    """Yield the trace of `count` ticks of a run that goes on by itself, in pieces; fingers feel it.

    Raises RigFault, and BadInput where the board has no trace of it any more: it was not read fast enough.
    """
    got = first
    felt = anybody_feels(fingers)
    while got < first + count:
        status = client.status()
        status.require_no_fault()
        if status.mode is not Mode.RUNNING or status.run != run:
            raise BadInput("the board plays this run no more", "one that nobody else uses")
        if status.tick <= got:
            sleep(_POLL_S)
            continue
        part = client.trace(run, got, first + count - got, channels, felt)
        if part.felt_mm is not None:
            let_feel(fingers, part.felt_mm.astype(np.float64))
        got += len(part.flags)
        yield part
