"""Orders to the process that holds the rig, those that wait for it, and what it tells of the rig."""

from __future__ import annotations

import queue
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.console.generator import GeneratorWave, Hertz
from tactuator.console.requests import Finite, Name, PageRequest
from tactuator.errors import BadInput
from tactuator.measure.options import MeasurementOptions
from tactuator.model.controller import Controller
from tactuator.rig.rig import Trace

Mode = Literal["idle", "live", "measuring", "presenting", "fault", "gone"]


@dataclass(frozen=True)
class LoadOrder:
    """Order to make a controller the one that runs."""

    controller: Controller


class LiveOrder(PageRequest):
    """Order to play the generator and to tell every sample, until something else is ordered."""


class RestOrder(PageRequest):
    """Order to end what goes on, and to bring the rig to rest."""


@dataclass(frozen=True)
class AwaitedRestOrder(RestOrder):
    """The same order, whose end is told with its number."""

    number: int


@dataclass(frozen=True)
class GenerateOrder:
    """Order to play that from now on (None: silence)."""

    wave: GeneratorWave | None


@dataclass(frozen=True)
class TouchOrder(PageRequest):
    """Order to put a load of the display file on a channel's simulated finger port; None takes it off."""

    channel: Name
    load: Name | None


@dataclass(frozen=True)
class PressOrder(PageRequest):
    """Order to press on a channel's simulated finger port with a force, volts of command, from now on."""

    channel: Name
    force_v: Annotated[Finite, Field(ge=-100.0, le=100.0)]


@dataclass(frozen=True)
class MeasureSettings(MeasurementOptions, PageRequest):
    """Settings of a measurement of the response, as `measure` has them; no frequencies (Hz): those of the command."""

    frequency_hz: Annotated[tuple[Hertz, ...], Field(max_length=200)] = ()


@dataclass(frozen=True)
class MeasureOrder:
    """Order to measure the response with those settings, frequencies in them, as `measure` does."""

    controller: Controller
    settings: MeasureSettings


@dataclass(frozen=True, eq=False)
class PresentOrder:
    """Order to play blocks of reference (n, channels), threshold units, as one stream, for an experiment."""

    number: int
    blocks: tuple[FloatArray, ...]


class ReopenOrder(PageRequest):
    """Order to open the rig anew after it has gone."""


@dataclass(frozen=True)
class QuitOrder:
    """Order to bring the rig to rest, let go of it, and end."""


Order = (
    LoadOrder | LiveOrder | RestOrder | GenerateOrder | TouchOrder | PressOrder | MeasureOrder | PresentOrder
    | ReopenOrder | QuitOrder
)  # fmt: skip


@dataclass(frozen=True)
class RigStatus:
    """Status of the rig, told by its process whenever something of it has changed.

    guard: of a board, its mode and fault as words; empty where there is none. loaded: hash of the controller. fed:
    rows of reference that the rig has asked for; given_back: rows of trace that it has returned. refused: it has gone
    because what was asked for is bad input, and not because a device failed.
    """

    mode: Mode = "idle"
    fault: str = ""
    loaded: str = ""
    wave: GeneratorWave | None = None
    touch: dict[str, str | None] = field(default_factory=dict)
    press_v: dict[str, float] = field(default_factory=dict)
    guard: dict[str, Any] = field(default_factory=dict)
    touchable: bool = False
    fed: int = 0
    given_back: int = 0
    gaps: int = 0
    refused: bool = False


@dataclass(frozen=True)
class Piece:
    """Samples of the rig from row `first` on: float32 rows (n, series), as bytes; rows in which a limit was reached."""

    first: int
    content: bytes
    saturated: int


@dataclass(frozen=True)
class Points:
    """A measurement so far: the document of its responses, what of it is over, and the response file (CSV)."""

    document: dict[str, Any]
    done: int
    total: int
    csv: str
    over: bool = False


@dataclass(frozen=True, eq=False)
class Presented:
    """A piece of what an experiment plays by the order of that number, or its end (over).

    began_at, rows_played: of a rig that tells its time, else None. halted: somebody stopped it; fault: why
    the rig did; missed: and the same may be asked for again.
    """

    number: int
    trace: Trace | None = None
    began_at: int | None = None
    rows_played: int | None = None
    over: bool = False
    halted: bool = False
    fault: str = ""
    missed: bool = False


@dataclass(frozen=True)
class Refused:
    """An order that the rig's process refused, and why."""

    text: str


News = RigStatus | Piece | Points | Presented | Refused
WAITING_MAX = 1000
"""Orders that may wait, while a measurement goes on for instance; a page makes less than a hundred a second."""
_AWAITED = PresentOrder | AwaitedRestOrder | QuitOrder
"""Orders whose end an experiment waits for, or with which the process ends."""


class WaitingOrders:
    """Orders in turn, put in by other threads than the one that obeys them."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Order] = queue.SimpleQueue()

    def put(self, order: Order) -> str:
        """Let an order wait its turn, and return what is to be told of it; empty as a rule.

        Where too many wait, another is refused. An order to end something takes the place of those before it instead,
        and one that an experiment waits for is taken in any case.
        """
        warning = ""
        if self._queue.qsize() >= WAITING_MAX and not isinstance(order, _AWAITED):
            if not (isinstance(order, RestOrder) or (isinstance(order, GenerateOrder) and order.wave is None)):
                return str(BadInput(f"{WAITING_MAX} orders wait for the rig", "another once they are done"))
            warning = f"{self._forget()} orders that waited for the rig are dropped, because something is to end"
        self._queue.put(order)
        return warning

    def get(self) -> Order:
        """Return the next order, as soon as there is one."""
        return self._queue.get()

    def get_nowait(self) -> Order | None:
        """Return the next order, or None where none waits."""
        try:
            return self._queue.get_nowait()
        except queue.Empty:
            return None

    def _forget(self) -> int:
        """Drop what waits, but for what an experiment waits for; return how many orders that were."""
        waited = []
        while (order := self.get_nowait()) is not None:
            waited.append(order)
        kept = [order for order in waited if isinstance(order, _AWAITED)]
        for order in kept:
            self._queue.put(order)
        return len(waited) - len(kept)
