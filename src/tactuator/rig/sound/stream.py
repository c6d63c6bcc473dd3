"""A stream of PortAudio on a card: rings of samples to and from the card's thread, and runs on them.

A run is fed ahead, read as it comes, and broken off where it has a gap or the card falls silent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput, DeviceFault, TimingMissed
from tactuator.rig.sound.cards import PORTAUDIO, Card, leave_library, quiet, sounddevice
from tactuator.runtime._core import ffi, lib

Rows = NDArray[np.float32]
_NEVER = 2**64 - 1
"""The core's frame number for what has not happened."""
_DYING_S = 5e-3
"""Time constant by which a stopped output dies away: within 20 ms it is 35 dB lower, without a click."""
POLL_S = 0.01
"""Pause between two looks at the rings."""
SILENT_S = 1.0
"""A card that does not call back for so long is gone."""
STARTING_S, STEADY = 5.0, 5
"""Until it has called back so often it has longer: PulseAudio calls once, and then not for 1.7 s."""


class SoundGap(TimingMissed):
    """A run on a sound card had a gap: rows came too late, were lost, or the card reported one."""


class CardGone(DeviceFault):
    """The card does not call back any more: unplugged, or its server has ended."""


class CardRows:
    """The rings of one stream of a card with `outputs` and `inputs`, each of `capacity` rows."""

    def __init__(self, outputs: int, inputs: int, capacity: int, rate_hz: float) -> None:
        self.outputs, self.capacity, self._inputs, self._rate_hz = outputs, capacity, inputs, rate_hz
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
        content = np.ascontiguousarray(rows, dtype=np.float32)
        return int(lib.tact_audio_feed(self._rows, ffi.from_buffer("float[]", content), len(content)))

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
    def begun(self) -> int:
        """Return the frame of the card's clock at which the last run began."""
        return int(self._rows.begun)

    @property
    def played(self) -> int:
        """Return the number of rows put out in this run."""
        return self._look()[0]

    @property
    def frames(self) -> int:
        """Return the frames of the card's clock since the stream was opened."""
        return self._look()[2]

    @property
    def gaps(self) -> int:
        """Return the number of gaps that the card reported in this run."""
        return int(self._rows.gaps)

    def check(self, allow_gaps: bool = False) -> None:
        """Raise SoundGap where rows were late or lost, or, unless that is allowed, the card reported gaps."""
        for at, words in (
            (self._rows.dry_at, "the program was too slow to feed the sound card"),
            (self._rows.lost_at, "the program was too slow to read the sound card"),
            (_NEVER if allow_gaps else self._rows.gap_at, "the sound card reported a gap"),
        ):
            if at != _NEVER:
                raise SoundGap(
                    f"{words} {at / self._rate_hz:.3f} s after the beginning, and what was recorded is not used",
                    "a run without gaps (larger buffers of the card, a larger lead_s in [sound], less load)",
                )

    def _look(self) -> tuple[int, int, int]:
        counts: Any = ffi.new("uint64_t[3]")
        lib.tact_audio_look(self._rows, counts, counts + 1, counts + 2)
        return int(counts[0]), int(counts[1]), int(counts[2])


class CardRun:
    """Runs on `rows`, one at a time. lead: rows by which one is fed ahead."""

    def __init__(self, rows: CardRows, lead: int, sleep: Callable[[float], None]) -> None:
        self._rows, self.lead, self._sleep = rows, lead, sleep
        self._seen, self._silent_s, self._steps = -1, 0.0, 0
        self.alive = True

    def play(self, blocks: Iterable[Rows], beyond: int, allow_gaps: bool) -> Iterator[Rows]:
        """Put out blocks (n, outputs) one after another and yield what is taken in, (n, inputs), from the first row put
        out until `beyond` rows after the last.

        Raises SoundGap and CardGone; however it ends, what is put out dies away.
        """
        self.settle()
        source = iter(blocks)
        fed = got = 0
        more, begun = True, False
        waiting: Rows | None = None
        try:
            while more or got < fed + beyond:
                while more and fed - self._rows.played < self.lead:
                    if waiting is None or not len(waiting):
                        waiting = next(source, None)
                    if waiting is None:
                        more = False
                        self._rows.end()
                        break
                    taken = self._rows.feed(waiting)
                    fed, waiting = fed + taken, waiting[taken:]
                    if not taken and len(waiting):
                        break
                if not fed:
                    return
                if not begun:
                    self._rows.begin()
                    begun = True
                part = self._rows.read(self.lead)
                self._rows.check(allow_gaps)
                got += len(part)
                if len(part):
                    yield part
                if len(part) < self.lead // 2:
                    self._wait()
        finally:
            self._rows.stop()

    def settle(self) -> None:
        """Wait until the run before has died away. Raises CardGone."""
        while not self._rows.forget():
            self._wait()

    def _wait(self) -> None:
        """Wait a little. Raises CardGone if the card's clock has stopped."""
        self._sleep(POLL_S)
        frames = self._rows.frames
        if frames != self._seen:
            self._seen, self._silent_s, self._steps = frames, 0.0, self._steps + 1
            return
        self._silent_s += POLL_S
        patience_s = SILENT_S if self._steps > STEADY else STARTING_S
        if self._silent_s > patience_s:
            self.alive = False
            raise CardGone(
                f"the sound card has stopped: not a sample for {patience_s:g} s", "a card that stays connected"
            )


class Port(Protocol):
    """The other side of the rows: something that calls back, as a card does."""

    def close(self, alive: bool) -> None:
        """Let go of the card. alive: it still calls back; False: it does not, and is left as it is."""
        ...


class CardPort:
    """A duplex stream between `out` and `taken_from` (None: outputs only) that exchanges `rows`.

    Raises BadInput where the card lacks channels or the rate, and DeviceFault where it does not open or answer.
    """

    def __init__(
        self, out: Card, taken_from: Card | None, outputs: int, inputs: int, rate_hz: float, rows: CardRows
    ) -> None:
        library = sounddevice()
        wanted = [(out, out.outputs, outputs, "outputs")]
        wanted += [] if taken_from is None else [(taken_from, taken_from.inputs, inputs, "inputs")]
        for card, there, least, what in wanted:
            if there < least:
                raise BadInput(f"sound card {card.full_name!r} has {there} {what}", f"{least} or more")
        ours, callback = library._ffi, ffi.addressof(lib, "tact_audio_callback")
        common: dict[str, Any] = {
            "samplerate": rate_hz,
            "blocksize": 0,
            "dtype": "float32",
            "latency": "high",
            "extra_settings": None,
            "callback": ours.cast("PaStreamCallback*", int(ffi.cast("uintptr_t", callback))),
            "finished_callback": None,
            "clip_off": True,
            "dither_off": True,
            "never_drop_input": None,
            "prime_output_buffers_using_stream_callback": None,
            "userdata": ours.cast("void*", rows.address),
            "wrap_callback": None,
        }
        kind = "output" if taken_from is None else "duplex"
        device: Any = out.index if taken_from is None else (taken_from.index, out.index)
        channels: Any = outputs if taken_from is None else (inputs, outputs)

        def started() -> tuple[Any, CardRows]:
            stream = library._StreamBase(kind, device=device, channels=channels, **common)
            try:
                stream.start()
            except library.PortAudioError:
                _end(stream)
                raise
            return stream, rows  # the rows have to live for as long as the card may call back

        try:
            with quiet():
                self._stream, self._rows = PORTAUDIO.answer(
                    started, f"opening sound card {out.full_name!r}", lambda started: _end(started[0])
                )
        except library.PortAudioError as error:
            raise refusal(error, out, rate_hz) from None

    def close(self, alive: bool) -> None:
        """Let go of the card. Raises DeviceFault where it does not answer."""
        if not alive:
            leave_library()
            return
        with quiet():
            PORTAUDIO.answer(lambda: _end(self._stream), "letting go of the sound card")


def _end(stream: Any) -> None:
    stream.abort(ignore_errors=True)
    stream.close(ignore_errors=True)


def refusal(error: Exception, card: Card, rate_hz: float) -> BadInput | DeviceFault:
    """Return what PortAudio's error says of the card: a rate that it has not, or that it cannot be opened."""
    words = str(error.args[0]) if error.args else str(error)
    words = words.removeprefix("Error opening _StreamBase: ")  # a private class
    if "sample rate" in words.lower():
        return BadInput(f"sound card {card.full_name!r} does not run at {rate_hz:g} Hz", f"{card.rate_hz:g} Hz")
    return DeviceFault(f"sound card {card.full_name!r} cannot be opened ({words})", "one that nobody else holds")
