"""Tones that a board makes itself: what they are, and how they are told to it (core/board/stimulus.h)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.rig.board.link import LinkClient, Mode, RigFault, TraceRows
from tactuator.rig.finger import Finger, anybody_feels, let_feel
from tactuator.rig.samples import REFERENCE_MAX

TONES_MAX = 8
_STATUS_POLL_S = 0.002


LONGEST_S = 3600.0
"""Of what a board makes itself; far below what its counts of ticks hold."""


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
        """Return the tone as the link carries it; first: tick of the run at which its time begins. Raises BadInput from
        half the rate on.
        """
        if not self.frequency_hz < 0.5 * rate_hz:
            raise BadInput(f"tone of {self.frequency_hz:g} Hz; allowed on this board: below {0.5 * rate_hz:g} Hz")
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
    """Return a payload for every channel, silent ones too. Raises BadInput for an unknown channel, or for more tones
    than it takes.
    """
    unknown = sorted(set(tones) - set(channels))
    if unknown:
        raise BadInput(f"channel {unknown[0]!r} is not there", f"{', '.join(channels)}")
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
        if status.mode is Mode.FAULT:
            raise RigFault(status.fault, status.fault_channel)
        if status.mode is not Mode.RUNNING or status.run != run:
            raise BadInput("the board plays this run no more", "one that nobody else uses")
        if status.tick <= got:
            sleep(_STATUS_POLL_S)
            continue
        part = client.trace(run, got, first + count - got, channels, felt)
        if part.felt_mm is not None:
            let_feel(fingers, part.felt_mm.astype(np.float64))
        got += len(part.flags)
        yield part
