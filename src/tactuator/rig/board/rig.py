"""A board as a rig, whatever runs the core's firmware, behind any transport; and its finger ports."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, DeviceFault
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.rig.board.commissioning import SILENCE_S, safety_table, soft_ticks
from tactuator.rig.board.link import (
    IMAGE,
    SAFETY,
    SIMULATED_DISPLAY,
    STIMULUS,
    STREAM,
    LinkClient,
    Mode,
    Request,
    Status,
    TraceRows,
    understood,
)
from tactuator.rig.board.stream import LONGEST_S, BoardStream, BoardTone, Rows, read_run, stimulus_payloads
from tactuator.rig.rig import Finger, Rig, Trace, column_of, join_traces, take_rows
from tactuator.rig.transport import LinkDown
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import safety_bytes
from tactuator.runtime.tables import load_names, simulated_board_bytes

SENSOR_FAULTS = (
    "sound", "open", "shorted", "frozen", "reversed", "stuck", "offset", "drift", "gain", "lag", "swapped", "bit",
    "end stop",
)  # fmt: skip
"""What may happen to a simulated sensor (core/display/sensor_fault.h)."""
STREAM_LEAD_S = 0.25
"""Time by which a stream is fed ahead of what is played; a pause or a stop comes later by as much."""
_RECOVERY_S = 0.25
"""After it the guard believes a sensor again."""
_SETTLE_TRIES, _PROMPT_TRIES = 2000, 100
"""Looks until a board must be at rest, 2 ms apart, 4 s; one that waits needs no pause between the first hundred."""
_BLOCK_LEAD_S = 0.5
"""A block by itself is fed as far ahead as its stretch allows: nobody stops it."""
_WAITING_LEAD_S = 0.6 * SILENCE_S
"""A board that waits for its stream does so before the link's silence is a fault, however slow the host is."""


def _at_once(seconds: float) -> None:
    """Do not wait: the board's time is stopped."""


class BoardRig(Rig):
    """The rig of `display` on a board that runs the firmware.

    client: the link, for requests of one's own; fed_to: the tick of its run to which the board has been given rows.
    A board without a safety table gets this display's; one that has a table keeps it, whatever is loaded.
    On a board with a simulated display time stops between blocks, so two blocks are one block cut in two, and its
    finger ports can be touched. On a real one, or with `waits` False, time continues: the loop holds r = 0 between
    blocks, and what must not be interrupted is a stream.
    """

    reshapes = feeds_forward = True

    def __init__(
        self,
        client: LinkClient,
        display: Display,
        sleep: Callable[[float], None] = time.sleep,
        waits: bool = True,
        lead_s: float = STREAM_LEAD_S,
    ) -> None:
        super().__init__(display)
        self.client = client
        status = client.status()
        if status.channels < len(display.channels):
            raise BadInput(
                f"the board has {status.channels} channels; the display has {len(display.channels)}", "no more"
            )
        self.waits, self.lead_s = waits and status.allows_hold, lead_s
        self._pause, self._sleep = sleep, _at_once if self.waits else sleep
        self._run, self.fed_to, self._drives = status.run, 0, False
        self._lag, self._lead_most = status.trace_capacity // 2, status.stream_capacity * 7 // 8
        if status.safety_crc == 0:
            self.off()
            self.commission()

    # -- what a rig is ------------------------------------------------------------------------------------------------

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig."""
        self.require_runs(controller)
        self.load_image(build_image(controller))

    def load_image(self, image: bytes) -> None:
        """Load an image as it is; the board itself refuses what is amiss (BadInput, with the reason)."""
        self.off()
        self.client.upload(IMAGE, image)
        self._loaded = True

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units, through the loaded controller; state carries on.

        Raises BadInput for a reference that is not finite or beyond 60 dB SL, StreamDry if the link cannot keep up with
        a board whose time goes on, and RigFault if the guard ends the run.
        """
        self._require_controller()
        return join_traces(self._traces([self._rows(reference)], False, _BLOCK_LEAD_S), self.rate_hz, self.channels)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Stream blocks as `Rig.stream` does; a block is played STREAM_LEAD_S after it was asked for.

        Raises as `play` does.
        """
        self._require_controller()
        return self._traces((self._rows(block) for block in blocks), False, self.lead_s)

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors with a command (n, channels), volts, without controller; the guard watches."""
        rows = self._command(command_v).astype(np.float32)
        return join_traces(self._traces([rows], True, _BLOCK_LEAD_S), self.rate_hz, self.channels)

    def play_tones(self, tones: Mapping[str, Sequence[BoardTone]], duration_s: float) -> Trace:
        """Play tones that the board makes itself, by channel, and return their trace, the only thing streamed.

        A separate run, from rest to rest. Raises BadInput for tones that the board does not take, and RigFault.
        """
        self._require_controller()
        if not 0.0 <= duration_s <= LONGEST_S:
            raise BadInput(f"tones for {duration_s:g} s", f"up to {LONGEST_S:g} s")
        soft, count = soft_ticks(self.rate_hz), round(duration_s * self.rate_hz)
        payloads = stimulus_payloads(tones, self.channels, self.rate_hz, soft)
        self._arm()
        for payload in payloads:
            self.client.must(Request.STIMULUS, payload)
        self.client.start(self._run, STIMULUS, False, False)
        asked = np.zeros((count, len(self.channels)), dtype=np.float32)
        for column, name in enumerate(self.channels):
            asked[:, column] = sum(tone.wave(count, self.rate_hz) for tone in tones.get(name, ()))
        parts = read_run(self.client, self._run, soft, count, len(self.channels), self._fingers, self._sleep)
        waiting = [asked]
        try:
            return join_traces((self._trace(part, waiting, False) for part in parts), self.rate_hz, self.channels)
        finally:
            self.rest()

    def rest(self) -> None:
        """Fade the reference out, then the command; the board is ARMED or in FAULT afterwards."""
        if self.client.status().mode is Mode.RUNNING:
            self.client.ask(Request.STOP)
        self._wait(lambda status: status.mode is not Mode.RUNNING and status.at_rest)

    def break_sensor(self, channel: str, what: str, value: float = math.nan) -> None:
        """Let a channel's simulated sensor fail in one of the ways of SENSOR_FAULTS; "sound" mends it.

        value: the code about which it is "stuck", within two codes (where it is, if none is given); volts of an
        "offset"; volts a tick of a "drift"; the factor of a "gain"; ticks of a "lag"; the number of the channel that it
        is "swapped" with; the number of the "bit" that is turned over; mm of an "end stop" (not the sensor's fault).
        Raises BadInput for another fault, and where a value is missing.
        """
        if what not in SENSOR_FAULTS:
            raise BadInput(f"sensor fault {what!r}", f"{', '.join(SENSOR_FAULTS)}")
        if math.isnan(value) and what in SENSOR_FAULTS[SENSOR_FAULTS.index("offset") :]:
            raise BadInput(f"sensor fault {what!r} without a value", "a number")
        content = struct.pack("<BBf", column_of(channel, self.channels), SENSOR_FAULTS.index(what), value)
        self.client.must(Request.BREAK, content)

    # -- what a board is besides --------------------------------------------------------------------------------------

    def status(self) -> Status:
        """Return the status that the board reports."""
        return self.client.status()

    def weights(self) -> FloatArray:
        """Return the weights that each channel has learnt of its finger, (channels, 2); zeros where none are learnt."""
        answer = self.client.must(Request.WEIGHTS)
        with understood(Request.WEIGHTS):
            pairs = np.frombuffer(answer, dtype="<f4", offset=4).astype(np.float64).reshape(-1, 2)
            return np.ascontiguousarray(pairs[: len(self.channels)])

    def commission(self) -> None:
        """Write the safety table of the display, whatever table was there; the board must be in OFF."""
        self.client.upload(SAFETY, safety_bytes(safety_table(self.display)))

    def simulate(self, seed: int = 0) -> None:
        """Put the simulated display in the place of the converters (boards that have none)."""
        self.client.upload(SIMULATED_DISPLAY, simulated_board_bytes(self.display, seed))
        loads = [load_names(channel) for channel in self.display.channels]
        self._fingers = tuple(Finger(names, partial(self._touch, index, names)) for index, names in enumerate(loads))

    def _touch(self, channel: int, loads: tuple[str | None, ...], load: str | None) -> None:
        self.client.must(Request.TOUCH, struct.pack("<BB", channel, loads.index(load)))

    def off(self) -> None:
        """Bring the board to OFF; a fault is cleared once the guard has had time to believe a sensor again."""
        self.rest()
        status = self.client.status()
        if status.mode is Mode.FAULT:
            again = status.ticks + round(_RECOVERY_S * self.rate_hz)
            self._wait(lambda now: now.ticks >= again and now.locked_ticks == 0)
            self.client.must(Request.CLEAR)
        self.client.must(Request.OFF)

    def close(self) -> None:
        """Bring the output to rest as far as the board can be reached, and close the transport."""
        try:
            self.rest()
        except (BadInput, DeviceFault):
            pass
        finally:
            self.client.close()

    # -- runs ---------------------------------------------------------------------------------------------------------

    def _wait(self, reached: Callable[[Status], bool]) -> Status:
        for attempt in range(_SETTLE_TRIES):
            status = self.client.status()
            if reached(status):
                return status
            if not self.waits or attempt > _PROMPT_TRIES:
                self._pause(0.002)
        raise BadInput("the board does not come to rest", "a board whose timer runs")

    def _begin(self, drives: bool) -> None:
        status = self.client.status()
        status.require_no_fault()
        if status.mode is Mode.RUNNING and status.run == self._run and self._drives == drives:
            return
        self._arm()
        self._drives = drives
        self.client.start(self._run, STREAM, drives, self.waits)
        soft = soft_ticks(self.rate_hz)
        if self.waits:
            silence = np.zeros((soft, len(self.channels)), dtype=np.float32)
            for _ in self._streaming(_WAITING_LEAD_S, felt=False).play([silence]):
                pass
            self.fed_to = soft
        else:
            self._wait(lambda now: now.tick > soft or now.mode is Mode.FAULT)

    def _arm(self) -> None:
        self.rest()
        self.client.must(Request.ARM)
        self._run = (self.client.status().run + 1) & 0xFFFFFFFF

    def _streaming(self, lead_s: float, felt: bool = True) -> BoardStream:
        fingers = self._fingers if felt else ()
        asked_s = min(lead_s, _WAITING_LEAD_S) if self.waits else lead_s
        lead = min(round(asked_s * self.rate_hz), self._lead_most)
        return BoardStream(
            self.client, self._run, len(self.channels), lead, self._lag, self.waits, fingers, self._sleep
        )

    def _traces(self, blocks: Iterable[Rows], drives: bool, lead_s: float) -> Iterator[Trace]:
        """Send blocks to the board without a gap and yield its traces. However it ends, the output goes to rest."""
        asked: list[Rows] = []

        def fed() -> Iterator[Rows]:
            for block in blocks:
                asked.append(block)
                yield block

        try:
            self._begin(drives)
            stream = self._streaming(lead_s)
            try:
                for part in stream.play(fed(), self.fed_to, round(0.25 * lead_s * self.rate_hz)):
                    self.began_at, self.rows_played = stream.first, stream.rows_played
                    if part is None:
                        yield join_traces([], self.rate_hz, self.channels)
                    else:
                        yield self._trace(part, asked, drives)
            finally:
                self.fed_to, self.began_at, self.rows_played = stream.end, stream.first, stream.rows_played
        except LinkDown:
            raise
        except (Exception, KeyboardInterrupt):  # of the blocks' own making, too
            self.rest()
            raise

    def _trace(self, part: TraceRows, waiting: list[Rows], drives: bool) -> Trace:
        """Return the trace of the next rows of what waits for its answer."""
        asked = np.concatenate(take_rows(waiting, len(part.flags)))
        converters = [channel.converter for channel in self.display.channels]
        steps = np.array([converter.step_v for converter in converters])
        polarity = np.array([float(converter.polarity) for converter in converters])
        offsets = np.array([converter.offset_v for converter in converters])
        command = polarity * (part.command_code * steps) + offsets
        position = (part.position_code * steps).astype(np.float32).astype(np.float64)
        reference = np.zeros(command.shape) if drives else asked.astype(np.float64)
        limited = (part.flags != 0) | (np.abs(position) > self.travel_v)
        return Trace(self.rate_hz, self.channels, reference, command, position, limited)

    def _rows(self, reference: ArrayLike) -> Rows:
        return self._reference(reference).astype(np.float32)
