"""A board as a rig: whatever runs the core's firmware, behind any transport."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.digital.controller import Controller
from tactuator.digital.image import build_image
from tactuator.digital.safety import safety_bytes
from tactuator.digital.simulation import block_samples
from tactuator.errors import BadInput
from tactuator.files.controller import controller_hash
from tactuator.plant.display import Display
from tactuator.rig.board_finger import BoardFinger
from tactuator.rig.commissioning import SOFT_START_S, safety_table
from tactuator.rig.frames import Request
from tactuator.rig.link import IMAGE, SAFETY, STREAM, WIRED, LinkClient, Mode, RigFault, Status, TraceRows
from tactuator.rig.trace import Trace

REFERENCE_MAX = 1000.0
_LEAD_S = 0.05
_SETTLE_TRIES = 2000
_AHEAD = 2048

Floats = NDArray[np.float64]


class BoardRig:
    """`display` on a board that runs the firmware.

    A board without a safety table gets this display's; one that has a table keeps it, whatever is loaded.
    On a board whose display is simulated time stands still between blocks, so that two blocks are one block cut in
    two, and its finger ports can be touched. On a real one the loop holds r = 0 between them.
    """

    def __init__(
        self,
        client: LinkClient,
        display: Display,
        number_format: str = "float32",
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._client, self._display, self._format, self._sleep = client, display, number_format, sleep
        status = client.status()
        if status.channels < len(display.channels):
            raise BadInput(
                f"the board has {status.channels} channels; the display has {len(display.channels)}; allowed: no more"
            )
        self._holds = status.allows_hold
        self._run, self._at, self._drives, self._loaded = status.run, 0, False, False
        self._fingers: tuple[BoardFinger, ...] = ()
        if status.safety_crc == 0:
            self.off()
            self.commission()

    # -- what a rig is ------------------------------------------------------------------------------------------------

    @property
    def display(self) -> Display:
        """The display on the board."""
        return self._display

    @property
    def rate_hz(self) -> float:
        """Sampling rate, hertz."""
        return self._display.rate_hz

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of every array's columns."""
        return tuple(channel.name for channel in self._display.channels)

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig."""
        if tuple(channel.name for channel in controller.channels) != self.channels:
            got = ", ".join(channel.name for channel in controller.channels)
            raise BadInput(f"controller is for channels {got}; allowed: {', '.join(self.channels)}")
        self.load_image(build_image(controller, self._format, controller_hash(controller)))

    def load_image(self, image: bytes) -> None:
        """Load an image as it is; the board itself refuses what is amiss (BadInput, with the reason)."""
        self.off()
        self._client.upload(IMAGE, image)
        self._loaded = True

    def play(self, reference: ArrayLike) -> Trace:
        """Reference (n, channels), threshold units, through the loaded controller; state carries on.

        Raises BadInput for a reference that is not finite or beyond 60 dB SL, and RigFault if the guard ends the run.
        """
        if not self._loaded:
            raise BadInput("no controller is loaded; allowed: load one before playing a reference")
        rows = block_samples(reference, len(self.channels), "reference", np.float32)
        if not np.all(np.abs(rows) <= REFERENCE_MAX):
            self.rest()
            raise BadInput(
                "the reference is not finite or beyond 60 dB SL; allowed: finite, at most 1000 threshold units"
            )
        command, position, flags = self._block(rows, drives=False)
        asked = np.array(reference, dtype=np.float64).reshape(command.shape)
        return Trace(self.rate_hz, self.channels, asked, command, position, flags)

    def drive(self, command_v: ArrayLike) -> Trace:
        """Command (n, channels), volts, to the motors without controller; the guard watches."""
        rows = block_samples(command_v, len(self.channels), "command", np.float32)
        if not np.all(np.isfinite(rows)):
            self.rest()
            raise BadInput("the command is not finite; allowed: volts")
        command, position, flags = self._block(rows, drives=True)
        return Trace(self.rate_hz, self.channels, np.zeros(command.shape), command, position, flags)

    def rest(self) -> None:
        """Reference faded out, then the command; the board is ARMED or in FAULT afterwards."""
        if self._client.status().mode is Mode.RUNNING:
            self._client.ask(Request.STOP)
        self._wait(lambda status: status.mode is not Mode.RUNNING and status.at_rest)

    def finger(self, channel: str) -> BoardFinger:
        """The finger port of a channel; BadInput if there is none of that name, or the display is real."""
        if not self._fingers:
            raise BadInput("this display is real: a finger goes onto it by hand; allowed: a simulated display")
        if channel not in self.channels:
            raise BadInput(f"channel {channel!r} is not there; allowed: {', '.join(self.channels)}")
        return self._fingers[self.channels.index(channel)]

    # -- what a board is besides --------------------------------------------------------------------------------------

    @property
    def client(self) -> LinkClient:
        """The link, for requests of one's own."""
        return self._client

    def status(self) -> Status:
        """What the board says of itself."""
        return self._client.status()

    def commission(self) -> None:
        """Write the safety table of the display, whatever table was there; the board must be in OFF."""
        self._client.upload(SAFETY, safety_bytes(safety_table(self._display)))

    def wire(self, content: bytes, loads: tuple[tuple[str | None, ...], ...]) -> None:
        """Put a simulated display in the place of the converters (boards that have none)."""
        self._client.upload(WIRED, content)
        self._fingers = tuple(BoardFinger(self._client, index, names) for index, names in enumerate(loads))

    def off(self) -> None:
        """To OFF, whatever the board does; a fault is cleared."""
        self.rest()
        if self._client.status().mode is Mode.FAULT:
            self._client.must(Request.CLEAR)
        self._client.must(Request.OFF)

    def close(self) -> None:
        """Output to rest as far as the board can be reached, and the transport closed."""
        try:
            self.rest()
        except BadInput:
            pass
        finally:
            self._client.close()

    def __enter__(self) -> BoardRig:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- blocks -------------------------------------------------------------------------------------------------------

    def _wait(self, reached: Callable[[Status], bool]) -> Status:
        for _ in range(_SETTLE_TRIES):
            status = self._client.status()
            if reached(status):
                return status
            if not self._holds:
                self._sleep(0.002)
        raise BadInput("the board does not come to rest; allowed: a board whose timer runs")

    def _begin(self, drives: bool) -> None:
        """A run of the kind that is wanted, past its soft start."""
        status = self._client.status()
        if status.mode is Mode.FAULT:
            raise RigFault(status.fault, status.fault_channel)
        if status.mode is Mode.RUNNING and status.run == self._run and self._drives == drives:
            return
        self.rest()
        self._client.must(Request.ARM)
        self._run, self._drives = max(self._run, status.run) + 1, drives
        self._client.start(self._run, STREAM, drives, self._holds)
        soft = round(SOFT_START_S * self.rate_hz) + 2
        if self._holds:
            self._pump(np.zeros((soft, len(self.channels)), dtype=np.float32), 0, felt=False)
            self._at = soft
        else:
            self._wait(lambda now: now.tick > soft)

    def _block(self, rows: NDArray[np.float32], drives: bool) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        self._begin(drives)
        if not self._holds:
            self._at = self._client.status().tick + round(_LEAD_S * self.rate_hz)
        parts = self._pump(rows, self._at)
        self._at += rows.shape[0]
        codes, positions = (np.concatenate([getattr(part, name) for part in parts]) for name in _CODES)
        flags = np.concatenate([part.flags for part in parts]) != 0
        steps, polarity, offsets = self._converters()
        return polarity * (codes * steps) + offsets, (positions * steps).astype(np.float32).astype(np.float64), flags

    def _converters(self) -> tuple[Floats, Floats, Floats]:
        converters = [channel.converter for channel in self._display.channels]
        steps = np.array([converter.step_v for converter in converters])
        polarity = np.array([float(converter.polarity) for converter in converters])
        return steps, polarity, np.array([converter.offset_v for converter in converters])

    def _pump(self, rows: NDArray[np.float32], first: int, felt: bool = True) -> list[TraceRows]:
        """Rows to the board and the trace of them back, a ring's worth at a time."""
        count, channels = rows.shape
        forces = self._forces(count) if felt else None
        sent = got = 0
        parts: list[TraceRows] = []
        while got < count:
            if sent < count and sent - got < _AHEAD:
                force = None if forces is None else forces[sent:]
                end, _ = self._client.stream(self._run, first + sent, rows[sent:], force)
                sent = min(count, max(sent, end - first))
            part = self._client.trace(self._run, first + got, count - got, channels, felt and bool(self._fingers))
            if part.command_code.shape[0]:
                parts.append(part)
                got += part.command_code.shape[0]
                self._feel(part)
            else:
                self._check_fault()
        return parts

    def _check_fault(self) -> None:
        status = self._client.status()
        if status.mode is Mode.FAULT:
            self.rest()
            raise RigFault(status.fault, status.fault_channel)
        if not self._holds:
            self._sleep(0.002)

    def _forces(self, count: int) -> NDArray[np.float32] | None:
        forces = [finger.take_force(count) for finger in self._fingers]
        if all(force is None for force in forces):
            return None
        whole = [np.zeros(count) if force is None else force for force in forces]
        return np.stack(whole, axis=1).astype(np.float32)

    def _feel(self, part: TraceRows) -> None:
        if part.felt_mm is not None:
            for finger, displacement in zip(self._fingers, part.felt_mm.T, strict=True):
                finger.feel(displacement.astype(np.float64))


_CODES = ("command_code", "position_code")
