"""A display without loop on a sound card, as a rig."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, DeviceFault
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.sound_card import SoundCard, Wires
from tactuator.rig.rig import DisplayRig
from tactuator.rig.samples import take_command, take_reference
from tactuator.rig.sound.open_loop import OpenLoop
from tactuator.rig.sound.port import Port
from tactuator.rig.sound.rows import CardRows, Rows, SoundGap
from tactuator.rig.sound.run import CardGone, CardRun
from tactuator.rig.trace import Trace, join_traces
from tactuator.runtime.simulation import block_samples

CLIPPED = 0.9999
"""Share of full scale from which an input counts as clipped: the top code of 16 bits is above it."""
SOFT_S = 0.02
PATIENT_S = 4.0
DRIVE_TRIES = 3

Flags = NDArray[np.bool_]
_Piece = tuple[FloatArray, FloatArray, Flags]
"""Reference, command in volts, and where it was cut, each (n, channels)."""


class SoundRig(DisplayRig):
    """The rig of `display` on the card that calls back into `rows`.

    Time goes on: between blocks nothing is put out, and what must not be cut is a stream. A row of a trace is an
    instant of the card's clock; what is taken in is put back by the display's latency_samples. A run with a gap raises
    SoundGap, and `drive` repeats it first. allow_gaps: gaps of which the card tells are counted (`gaps`), and the run
    goes on.
    """

    def __init__(
        self,
        display: Display,
        rows: CardRows,
        port: Port,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(display)
        self._rows, self._port, self._sleep = rows, port, sleep
        self._card = sound_wiring(display)
        self._run = CardRun(rows, max(1, round(self._card.lead_s * display.rate_hz)), sleep)
        self._loop: OpenLoop | None = None
        self._active: Iterator[Trace] = iter(())
        self._length = 0
        self.allow_gaps = False
        self.gaps = 0

    @property
    def without_sensor(self) -> tuple[str, ...]:
        """Return the channels that have no input of the card."""
        pairs = zip(self.channels, self._card.wires, strict=True)
        return tuple(name for name, wires in pairs if not wires.input)

    @property
    def began_at(self) -> int | None:
        """Return the frame of the card's clock at which the last block or stream began; None before the first."""
        return self._rows.begun if self._length else None

    @property
    def rows_played(self) -> int:
        """Return the number of rows of the last block or stream that the card has taken."""
        return min(self._rows.played, self._length)

    def feed_far_ahead(self) -> None:
        """Feed PATIENT_S ahead from now on, as measurements do for which nobody waits: computing between two blocks may
        then take as long. Nothing is changed where the rings are shorter.
        """
        wanted = round(PATIENT_S * self.rate_hz)
        self._run.lead = max(self._run.lead, min(wanted, self._rows.capacity // 2))

    def put_back(self, latency_samples: int) -> None:
        """Put what is taken in back by so many samples from now on, in the place of the display's own latency_samples.

        Raises BadInput for less than none.
        """
        self._card = replace(self._card, latency_samples=latency_samples)
        self._display = replace(self._display, sound=self._card)

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig, or closes a
        loop.
        """
        controller.require_runs(self._display)
        controller.require_limits_of(self._display)
        self.rest()
        self._loop = OpenLoop(controller)

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units, through the loaded controller, from rest.

        Raises BadInput for what `take_reference` refuses, beyond comfort or beyond the travel; SoundGap and CardGone.
        """
        return join_traces(self.stream([reference]), self.rate_hz, self.channels)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Stream blocks as `Rig.stream` does; a block is played lead_s after it was asked for.

        Raises as `play` does.
        """
        if self._loop is None:
            raise BadInput("no controller is loaded", "load one before playing a reference")
        return self._begin(self._played(self._loop, blocks))

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors with a command (n, channels), volts, from rest; its first 20 ms are faded in, as the trace
        tells. A run with a gap is repeated, three tries in all.

        Raises BadInput for what is not finite and where an input clips; SoundGap and CardGone.
        """
        rows = take_command(block_samples(command_v, len(self.channels), "command"))
        for left in reversed(range(DRIVE_TRIES)):
            try:
                trace = join_traces(self._begin(self._driven(rows)), self.rate_hz, self.channels)
            except SoundGap:
                self.rest()
                if not left:
                    raise
            else:
                self._refuse_clipped(trace)
                return trace
        raise AssertionError("a try ends in a trace or an error")

    def rest(self) -> None:
        """Let what is put out die away, and wait until it has."""
        close = getattr(self._active, "close", None)
        if close is not None:
            close()
        self._active = iter(())
        if self._run.alive:
            self._rows.stop()
            self._run.settle()
        if self._loop is not None:
            self._loop.reset()

    def close(self) -> None:
        """Let what is put out die away as far as the card can be reached, and let go of it. A card that fails in this
        has answered all that was asked of it, and nothing is raised.
        """
        try:
            with suppress(CardGone):
                self.rest()
        finally:
            with suppress(DeviceFault):
                self._port.close(self._run.alive)

    # -- runs ---------------------------------------------------------------------------------------------------------

    def _begin(self, pieces: Iterator[_Piece]) -> Iterator[Trace]:
        self.rest()
        self._length = 0
        self._active = self._traces(pieces)
        return self._active

    def _played(self, loop: OpenLoop, blocks: Iterable[ArrayLike]) -> Iterator[_Piece]:
        for block in blocks:
            reference = take_reference(block_samples(block, len(self.channels), "reference"))
            command, limited = loop.command(reference)
            yield reference, command, limited

    def _driven(self, command_v: FloatArray) -> Iterator[_Piece]:
        soft = max(1, round(SOFT_S * self.rate_hz))
        gain = np.minimum(1.0, np.arange(len(command_v)) / soft)
        wanted = command_v * (0.5 - 0.5 * np.cos(np.pi * gain))[:, None]
        most = np.array([channel.converter.range_v for channel in self._display.channels])
        cut = np.clip(wanted, -most, most)
        yield np.zeros(cut.shape), cut, np.asarray(cut != wanted)

    def _traces(self, pieces: Iterator[_Piece]) -> Iterator[Trace]:
        """Put out the pieces, then what still rings, and yield the trace of every row of the pieces."""
        asked = _Asked(self._card.wires, self.rate_hz, self.channels)
        late = self._card.latency_samples

        def fed() -> Iterator[Rows]:
            for reference, command, limited in pieces:
                rows, wanted = self._samples(command)
                self._length += len(rows)
                asked.add(reference, wanted, limited | (wanted != command))
                yield rows
            if self._loop is not None:
                yield self._samples(self._loop.ringing())[0]

        skipped = 0
        try:
            for part in self._run.play(fed(), late, self.allow_gaps):
                before = min(late - skipped, len(part))
                skipped += before
                trace = asked.answered(part[before:])
                if len(trace):
                    yield trace
        finally:
            self.gaps += self._rows.gaps

    def _samples(self, command_v: FloatArray) -> tuple[Rows, FloatArray]:
        """Return the card's rows for volts (n, channels), and the volts that they are, within full scale."""
        rows = np.zeros((len(command_v), self._rows.outputs), dtype=np.float32)
        volts = np.empty(command_v.shape)
        for column, wires in enumerate(self._card.wires):
            full = wires.output_full_scale_v
            share = np.clip(command_v[:, column] / full, -1.0, 1.0)
            rows[:, wires.output - 1] = share
            volts[:, column] = np.where(np.abs(share) < 1.0, command_v[:, column], full * share)
        return rows, volts

    def _refuse_clipped(self, trace: Trace) -> None:
        for column, (name, wires) in enumerate(zip(self.channels, self._card.wires, strict=True)):
            count = int(np.sum(np.abs(trace.position_v[:, column]) >= CLIPPED * wires.input_full_scale_v))
            if wires.input and count:
                raise BadInput(
                    f"channel {name!r}: input {wires.input} of the card clips ({count} samples at full scale, "
                    f"{wires.input_full_scale_v:g} V)",
                    "a lower level, or less gain before the input",
                )


class _Asked:
    """Pieces that are on their way, until their answers come back. wires: of the trace's channels."""

    def __init__(self, wires: Sequence[Wires], rate_hz: float, channels: tuple[str, ...]) -> None:
        self._wires, self._rate_hz, self._channels = wires, rate_hz, channels
        self._pieces: list[Trace] = []

    def add(self, reference: FloatArray, command_v: FloatArray, limited: Flags) -> None:
        """Keep a piece until it is answered."""
        nothing = np.zeros(reference.shape)
        self._pieces.append(Trace(self._rate_hz, self._channels, reference, command_v, nothing, limited))

    def answered(self, taken: Rows) -> Trace:
        """Return the trace of the oldest rows, as far as they have been answered by rows taken in, (n, inputs)."""
        parts: list[Trace] = []
        left = len(taken)
        while left and self._pieces:
            piece = self._pieces.pop(0)
            parts.append(piece.part(0, left))
            if len(piece) > left:
                self._pieces.insert(0, piece.part(left, len(piece)))
            left -= len(parts[-1])
        asked = join_traces(parts, self._rate_hz, self._channels)
        position_v = np.zeros(asked.reference.shape)
        saturated = asked.saturated.copy()
        for column, wires in enumerate(self._wires):
            if wires.input:
                samples = taken[: len(asked), wires.input - 1].astype(np.float64)
                saturated[:, column] |= np.abs(samples) >= CLIPPED
                position_v[:, column] = wires.input_full_scale_v * samples
        return replace(asked, position_v=position_v, saturated=saturated)


def sound_wiring(display: Display) -> SoundCard:
    """Return the display's wiring. Raises BadInput where it has none."""
    if display.sound is None:
        raise BadInput(
            f"display {display.name!r} does not say how it is wired to a sound card",
            "a table [sound] with output_full_scale_v (docs/sound.md)",
        )
    return display.sound
