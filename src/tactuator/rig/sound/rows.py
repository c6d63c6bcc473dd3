"""Rows of samples to and from a sound card's thread, with what broke a run: the core's rings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput, TimingMissed
from tactuator.runtime._core import ffi, lib

Rows = NDArray[np.float32]
_NEVER = 2**64 - 1
_DYING_S = 5e-3


class SoundGap(TimingMissed):
    """A run on a sound card had a gap: rows came too late, were lost, or the card told of one."""


class CardRows:
    """The rings of one stream of a card with `outputs` and `inputs`, each of `capacity` rows."""

    def __init__(self, outputs: int, inputs: int, capacity: int, rate_hz: float) -> None:
        self._outputs, self._inputs, self._rate_hz = outputs, inputs, rate_hz
        self._rows = ffi.new("tact_audio *")
        self._out = ffi.new("float[]", capacity * outputs)
        self._in = ffi.new("float[]", max(1, capacity * inputs))
        self._rows.out, self._rows.capacity = self._out, capacity
        setattr(self._rows, "in", self._in)
        self._rows.outputs, self._rows.inputs = outputs, inputs
        self._rows.decay = float(np.exp(-1.0 / (_DYING_S * rate_hz)))
        if not lib.tact_audio_reset(self._rows):
            raise BadInput(f"a stream of {outputs} outputs and {inputs} inputs", "1 to 64, and 0 to 64")

    @property
    def address(self) -> int:
        """Return the address that PortAudio hands to the callback."""
        return int(ffi.cast("uintptr_t", self._rows))

    def feed(self, rows: Rows) -> int:
        """Give rows (n, outputs) to the card; return how many there was room for."""
        own = np.ascontiguousarray(rows, dtype=np.float32)
        return int(lib.tact_audio_feed(self._rows, ffi.from_buffer("float[]", own), len(own)))

    def begin(self) -> None:
        """Begin the run with what was fed."""
        lib.tact_audio_begin(self._rows)

    def end(self) -> None:
        """Say that nothing more comes."""
        lib.tact_audio_end(self._rows)

    def stop(self) -> None:
        """Put out nothing more; what was put out last dies away within some milliseconds."""
        lib.tact_audio_stop(self._rows)

    def forget(self) -> bool:
        """Forget the stopped run; False while the card has not seen that it is stopped."""
        return bool(lib.tact_audio_forget(self._rows))

    def read(self, most: int) -> Rows:
        """Return up to `most` rows that were taken in, (n, inputs)."""
        rows = np.empty((most, max(1, self._inputs)), dtype=np.float32)
        got = int(lib.tact_audio_read(self._rows, ffi.from_buffer("float[]", rows), most))
        return rows[:got, : self._inputs]

    @property
    def capacity(self) -> int:
        """Return the number of rows for which there is room."""
        return int(self._rows.capacity)

    @property
    def outputs(self) -> int:
        """Return the number of outputs in a row."""
        return self._outputs

    @property
    def begun(self) -> int:
        """Return the frame of the card's clock at which the last run began."""
        return int(self._rows.begun)

    @property
    def played(self) -> int:
        """Return the number of rows put out in this run."""
        return self._look()[0]

    @property
    def taken(self) -> int:
        """Return the number of rows taken in in this run."""
        return self._look()[1]

    @property
    def frames(self) -> int:
        """Return the frames of the card's clock since the stream was opened."""
        return self._look()[2]

    @property
    def gaps(self) -> int:
        """Return the number of gaps in this run of which the card told."""
        return int(self._rows.gaps)

    def check(self, allow_gaps: bool = False) -> None:
        """Raise SoundGap where the run is broken: rows that came too late or were lost, and, unless it is allowed, gaps
        of which the card told.
        """
        for at, words in (
            (self._rows.dry_at, "the program was too slow to feed the sound card"),
            (self._rows.lost_at, "the program was too slow to read the sound card"),
            (_NEVER if allow_gaps else self._rows.gap_at, "the sound card told of a gap"),
        ):
            if at != _NEVER:
                raise SoundGap(
                    f"{words} {at / self._rate_hz:.3f} s after the beginning, and what was recorded is not used",
                    "a run without gaps (larger buffers of the card, a larger lead_s in [sound], less load)",
                )

    def _look(self) -> tuple[int, int, int]:
        found: Any = ffi.new("uint64_t[3]")
        lib.tact_audio_look(self._rows, found, found + 1, found + 2)
        return int(found[0]), int(found[1]), int(found[2])


def callback_address() -> int:
    """Return the address of the function that PortAudio calls in its own thread."""
    return int(ffi.cast("uintptr_t", ffi.addressof(lib, "tact_audio_callback")))
