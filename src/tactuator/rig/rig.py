"""What a rig is, in three parts: it plays (`Plays`), keeps time (`KeepsTime`), and has finger ports (`HasFingers`), by
which alone a program touches a display, presses and feels it; and the trace of what was played.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import wraps
from types import TracebackType
from typing import Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, unknown
from tactuator.model.controller import Controller
from tactuator.model.description import Channel, Display
from tactuator.plain import brief
from tactuator.runtime.simulation import block_samples, take_command, take_reference

COMFORT_TOLERANCE = 1.001
"""Float32 rounding of a reference at the limit."""
Feeler = Callable[[NDArray[np.float64]], None]


class Finger:
    """The finger port of one channel: touched by a load, pressed by a force, and felt.

    Every rig whose display is simulated has one for each channel. loads: that may touch, by name, None for none of
    them; put: puts one of them on. load: the one that touches.
    """

    def __init__(self, loads: Sequence[str | None], put: Callable[[str | None], None]) -> None:
        self._loads, self._put = loads, put
        self.load: str | None = None
        self._feelers: list[Feeler] = []
        self._pressed_v: FloatArray = np.zeros(0)

    def __repr__(self) -> str:
        loads = ", ".join(name for name in self._loads if name) or "no load"
        return f"<Finger that {loads} can touch; attached: {len(self._feelers)}>"

    def touch(self, load: str | None) -> None:
        """Put a load of the display file on, by name; None takes it off. Position and velocity go on.

        Raises BadInput for a name not described.
        """
        if load not in self._loads:
            raise unknown("load", load, [name or "none" for name in self._loads])
        self._put(load)
        self.load = load

    def press(self, force_v: ArrayLike) -> None:
        """Press with a force over the coming samples, shape (n,), in volts of command that push as hard.

        It is added to what is still to come of earlier presses.
        """
        force = np.atleast_1d(np.asarray(force_v))
        if force.dtype.kind not in "fiub":
            raise BadInput(f"force holds {force.dtype}", "(n,), finite volts of command")
        force = force.astype(np.float64)
        if force.ndim != 1 or not np.all(np.isfinite(force)):
            raise BadInput(f"force has shape {force.shape}", "(n,), finite volts of command")
        pressed = np.zeros(max(force.size, self._pressed_v.size))
        pressed[: self._pressed_v.size] = self._pressed_v
        pressed[: force.size] += force
        self._pressed_v = pressed

    def attach(self, feeler: Feeler) -> None:
        """Call `feeler(displacement_mm)`, shape (n,), with every stretch that was played: an observer, a dial gauge."""
        self._feelers.append(feeler)

    def detach(self, feeler: Feeler) -> None:
        """Take a feeler off again. Raises BadInput if it is not attached."""
        if feeler not in self._feelers:
            raise BadInput("that feeler is not attached to this finger port", "one that is")
        self._feelers.remove(feeler)


def take_forces(fingers: Sequence[Finger], count: int) -> FloatArray | None:
    """Take the forces of the coming `count` samples, (count, fingers); None where nothing presses."""
    if not any(finger._pressed_v.size for finger in fingers):
        return None
    forces = np.zeros((count, len(fingers)))
    for column, finger in zip(forces.T, fingers, strict=True):
        now, finger._pressed_v = finger._pressed_v[:count], finger._pressed_v[count:]
        column[: now.size] = now
    return forces


def anybody_feels(fingers: Sequence[Finger]) -> bool:
    """Return whether a feeler is attached anywhere."""
    return any(finger._feelers for finger in fingers)


def let_feel(fingers: Sequence[Finger], displacement_mm: FloatArray) -> None:
    """Hand the displacement, (n, fingers), to every feeler, as separate arrays."""
    for index, finger in enumerate(fingers):
        for feeler in finger._feelers:
            feeler(displacement_mm[:, index].copy())


_ARRAYS = ("reference", "command_v", "position_v", "saturated")


@dataclass(frozen=True, eq=False)
class Trace:
    """Record of n samples of every channel, as the processor knows them; arrays of shape (n, channels).

    Row k is the instant k / rate_hz of the block: position_v (volts of y) is what the A/D reads then, command_v (volts
    at the motor) what the D/A begins to put out then and holds for one period; it was computed delay_samples earlier.
    reference: threshold units; zero where the motors were driven directly. saturated: a converter's or the command's
    limit was reached, or the sensor read beyond travel_mm.
    """

    rate_hz: float
    channels: tuple[str, ...]
    reference: FloatArray
    command_v: FloatArray
    position_v: FloatArray
    saturated: NDArray[np.bool_]

    __repr__ = brief

    def __post_init__(self) -> None:
        shape = (self.reference.shape[0], len(self.channels))
        for name in _ARRAYS:
            if getattr(self, name).shape != shape:
                raise BadInput(f"trace: {name} has shape {getattr(self, name).shape}", f"{shape}")

    def __len__(self) -> int:
        return int(self.reference.shape[0])

    @property
    def duration_s(self) -> float:
        """Return the length of the trace, seconds."""
        return len(self) / self.rate_hz

    @property
    def time_s(self) -> FloatArray:
        """Return the time of each sample in seconds from the block's first instant, shape (n,)."""
        return np.arange(len(self)) / self.rate_hz

    def __getitem__(self, rows: slice) -> Trace:
        return Trace(self.rate_hz, self.channels, *(getattr(self, name)[rows] for name in _ARRAYS))

    def equals(self, other: Trace) -> bool:
        """Return whether every array is the other's, bit for bit."""
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in _ARRAYS)

    def channel(self, name: str) -> int:
        """Return the column of a channel. Raises BadInput for an unknown name."""
        if name not in self.channels:
            raise unknown("channel", name, self.channels, where=("trace",))
        return self.channels.index(name)


def recut_traces(traces: Iterable[Trace], lengths: Iterable[int]) -> Iterator[Trace]:
    """Yield consecutive traces, cut into pieces of these lengths (1 or more); the rest is left out."""
    source = iter(traces)
    kept: list[Trace] = []
    for length in lengths:
        while sum(map(len, kept)) < length:
            following = next(source, None)
            if following is None:
                return
            kept.append(following)
        rate_hz, channels = kept[0].rate_hz, kept[0].channels
        yield join_traces(take_rows(kept, length), rate_hz, channels)


Cut = TypeVar("Cut", Trace, NDArray[np.float32])


def take_rows(blocks: list[Cut], count: int) -> list[Cut]:
    """Take the first `count` rows off blocks, or all that there are, and return them in pieces."""
    taken: list[Cut] = []
    while blocks and count > 0:
        block = blocks.pop(0)
        taken.append(block[:count])
        if len(block) > count:
            blocks.insert(0, block[count:])
        count -= len(taken[-1])
    return taken


def join_traces(traces: Iterable[Trace], rate_hz: float, channels: tuple[str, ...]) -> Trace:
    """Return traces that follow one another as one; without traces, one without samples."""
    parts = list(traces)
    if not parts:
        nothing = np.zeros((0, len(channels)))
        return Trace(rate_hz, channels, nothing, nothing, nothing, np.zeros(nothing.shape, dtype=np.bool_))
    return Trace(rate_hz, channels, *(np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS))


def _taking_blocks(stream: Callable[..., Iterator[Trace]]) -> Callable[..., Iterator[Trace]]:
    """Return a `stream` that refuses what has no blocks when it is called, not when its first trace is asked for."""

    @wraps(stream)
    def taking(self: Plays, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        if isinstance(blocks, str) or not np.iterable(blocks):
            allowed = f"a list or a generator of references, (n, {len(self.channels)}) each"
            raise BadInput(f"{blocks!r:.60}", allowed, key="blocks")
        return stream(self, blocks)

    return taking


class Plays(ABC):
    """What plays a reference through a controller, or a command, on channels at a rate.

    Its state carries on from block to block. Where time waits for the next block (simulated displays), two blocks are
    one long block cut in two; on a real board the reference is zero between them, and what must not be cut is streamed.

    rate_hz: `4000.0`. channels: their names in the order of every array's columns, `("index", "thumb", "middle")`.
    without_sensor: names of those that have no sensor, `("thumb",)`.
    """

    rate_hz: float
    channels: tuple[str, ...]
    without_sensor: tuple[str, ...] = ()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "stream" in vars(cls):
            setattr(cls, "stream", _taking_blocks(cls.stream))  # noqa: B010  (mypy takes no assignment to a method)

    @abstractmethod
    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig."""

    @abstractmethod
    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units, through the controller. Raises BadInput without one.

        Returns the trace of its n samples: `Trace(4000.0, ("index",), reference, command_v, position_v, saturated)`.
        """

    @abstractmethod
    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Play blocks of reference (n, channels), threshold units, one after another without a gap; yield the trace of
        every sample, in pieces as they come: of two blocks of 400, pieces of 128, 0, 272 and 400 perhaps.

        A block is asked for when it is needed, which is some time before it is played (none where time waits for it).
        A piece may be empty: where time goes on, one comes whenever the rig has reported its time (`rows_played`).
        Ask for the traces as fast as they come. Left before its end, the stream goes on to the end of what was fed;
        `rest` ends it at once. Raises as `play` does, and DeviceFault if the stream ran dry: there is no silent gap.
        """

    @abstractmethod
    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors with a command (n, channels), volts: no controller, no computing delay.

        Returns the trace of its n samples, whose reference is zero.
        """

    @abstractmethod
    def rest(self) -> None:
        """Bring the output to rest."""

    def close(self) -> None:  # noqa: B027
        """Bring the output to rest and let go of the device; nothing else may be called afterwards.

        A rig that holds no device has nothing to do.
        """

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class KeepsTime:
    """What has a clock: attributes that a rig sets while it plays.

    began_at: tick (sample of its run) of the first row of the last block or stream by the rig's own clock, `8000`; None
    before the first, and if the rig does not report it. rows_played: of that stream, as far as the rig has reported,
    `400`; on a board whose time continues that is more than the rows of which the trace has been read. waits: whether
    time stops between blocks. speed: of presentation, 1 being real time; None for a rig with its own time. lead_s: by
    which a stream is fed ahead of what is played, and a block is asked for before it is played.
    """

    began_at: int | None = None
    rows_played: int = 0
    waits: bool = False
    speed: float | None = None
    lead_s: float = 0.0


class HasFingers:
    """What has a finger port for each channel where the display is simulated, and none where it is real."""

    channels: tuple[str, ...]
    _fingers: tuple[Finger, ...] = ()

    @property
    def has_finger_ports(self) -> bool:
        """Return True where the display is simulated; False where a finger goes onto it by hand."""
        return bool(self._fingers)

    def finger(self, channel: str) -> Finger:
        """Return the finger port of a channel: `<Finger that finger can touch; attached: 0>`.

        Raises BadInput for an unknown name, or a real display.
        """
        if not self._fingers:
            raise BadInput("this display is real: a finger goes onto it by hand", "a simulated display")
        return self._fingers[column_of(channel, self.channels)]


def column_of(channel: str, channels: Sequence[str]) -> int:
    """Return the column of a channel. Raises BadInput for an unknown name."""
    if channel not in channels:
        raise unknown("channel", channel, channels)
    return channels.index(channel)


class Rig(Plays, KeepsTime, HasFingers):
    """Something that runs a controller on the channels of one display. Rigs inherit from it.

    display: the one that the rig was made for. reshapes, feeds_forward: whether it plays what [strength] makes of a
    reference, and adds what [touch] learns of a finger to the command; a rig that does not refuses such a controller.
    travel_v: what a sensor of displacement reads at travel_mm, infinite for another sensor, (channels,).
    """

    reshapes = feeds_forward = False

    def __init__(self, display: Display) -> None:
        self.display, self.rate_hz = display, display.rate_hz
        self.channels = tuple(channel.name for channel in display.channels)
        self._loaded = False
        moved = [each.travel_mm if each.quantity == "displacement" else np.inf for each in display.channels]
        self.travel_v = np.array(moved) * [each.sensor_gain_v_per_mm for each in display.channels]

    def __repr__(self) -> str:
        runs = "a controller runs" if self._loaded else "no controller yet"
        return f"<{type(self).__name__} {self.display.name}: {', '.join(self.channels)} at {self.rate_hz:g} Hz, {runs}>"

    # -- what every rig asks before it plays --------------------------------------------------------------------------

    def require_runs(self, controller: Controller) -> None:
        """Raise BadInput for a controller that is for another display, or does what this rig leaves out."""
        if not isinstance(controller, Controller):
            raise BadInput(f"{controller!r:.60}", "a controller (`tt.read_controller` reads a file)", key="controller")
        controller.require_runs(self.display)
        for part in controller.channels:
            for needs, does, words, key in (
                (part.strength, self.reshapes, "its reference is reshaped by its strength", "[strength] blended"),
                (part.feed_forward, self.feeds_forward, "what a finger takes is fed forward", "[touch] adaptive"),
            ):
                if needs is not None and not does:
                    reason = f"channel {part.name!r}: {words}, which this rig does not do"
                    raise BadInput(reason, f"a rig that does, or a design without {key}")

    def _require_controller(self) -> None:
        if not self._loaded:
            raise BadInput("no controller is loaded: load one before playing a reference")

    def _reference(self, reference: ArrayLike) -> FloatArray:
        """Return a checked copy of a reference, (n, channels); what is beyond its range brings the output to rest."""
        return self._checked(take_reference, reference, "reference")

    def _command(self, command_v: ArrayLike) -> FloatArray:
        return self._checked(take_command, command_v, "command")

    def _checked(self, take: Callable[[FloatArray], FloatArray], samples: ArrayLike, name: str) -> FloatArray:
        rows = block_samples(samples, len(self.channels), name)
        try:
            return take(rows)
        except BadInput:
            self.rest()
            raise


def with_felt(rig: Rig, traces: Iterable[Trace]) -> Iterator[tuple[Trace, FloatArray]]:
    """Yield traces as a rig plays them, each with the displacement at its finger ports, mm, (n, channels)."""
    ports = [rig.finger(name) for name in rig.channels]
    felt: list[list[FloatArray]] = [[np.zeros(0)] for _ in ports]
    gauges = [pieces.append for pieces in felt]
    for port, gauge in zip(ports, gauges, strict=True):
        port.attach(gauge)
    try:
        for trace in traces:
            rows = np.stack([np.concatenate(pieces) for pieces in felt], axis=1)
            for pieces, later in zip(felt, rows[len(trace) :].T, strict=True):
                pieces[:] = [later]
            yield trace, rows[: len(trace)]
    finally:
        for port, gauge in zip(ports, gauges, strict=True):
            port.detach(gauge)


def require_sensors(rig: Plays, names: Iterable[str]) -> None:
    """Raise BadInput, naming the first, where one of the channels has no sensor."""
    for name in names:
        if name in rig.without_sensor:
            raise BadInput(
                f"channel {name!r} has no sensor, and there is nothing to measure with",
                "an input of the card ([sound] input), or `play`, which needs none",
            )


def require_finger_ports(rig: Rig, name: str) -> None:
    """Raise BadInput where no simulated subject can sit at the rig of that name, since its display is real."""
    if not rig.has_finger_ports:
        raise BadInput(f"simulated subjects at {name}", "at a rig whose display is simulated")
    for channel in rig.channels:
        rig.finger(channel)


def usual_load(channels: Sequence[Channel]) -> str:
    """Return the default load: "finger" where every channel has it, else the first load
    that every channel has, "none" where no channel has any. Raises BadInput where the channels have none in common.
    """
    names = [[load.name for load in channel.loads] for channel in channels]
    common = [name for name in names[0] if all(name in others for others in names)]
    if not any(names):
        return "none"
    if not common:
        raise BadInput("no load is on every channel", "`load` with the name of one")
    return "finger" if "finger" in common else common[0]


def touch_all(rig: Rig, channels: Sequence[Channel], load: str) -> tuple[str, ...]:
    """Put a load on every channel and return the names of the channels on which a person has to put it.

    load: the name of a load of the display file, or "none". Raises BadInput for a load that a channel does not have.
    """
    if load == "none":
        return ()
    for channel in channels:
        channel.load(load)
    if not rig.has_finger_ports:
        return tuple(channel.name for channel in channels)
    for channel in channels:
        rig.finger(channel.name).touch(load)
    return ()
