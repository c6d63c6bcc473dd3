"""Orders to the process that holds the rig, and what it tells of the rig."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from tactuator.arrays import FloatArray
from tactuator.console.held_rig.generator import GeneratorWave
from tactuator.model.controller import Controller
from tactuator.rig.rig import Trace

Mode = Literal["idle", "live", "measuring", "presenting", "fault", "gone"]


@dataclass(frozen=True)
class LoadOrder:
    """Order to make a controller the one that runs."""

    controller: Controller


@dataclass(frozen=True)
class LiveOrder:
    """Order to play the generator and to tell every sample, until something else is ordered."""


@dataclass(frozen=True)
class RestOrder:
    """Order to end what goes on, and to bring the rig to rest. number: where it is not 0, the end is told with it."""

    number: int = 0


@dataclass(frozen=True)
class GenerateOrder:
    """Order to play that from now on (None: silence)."""

    wave: GeneratorWave | None


@dataclass(frozen=True)
class TouchOrder:
    """Order to put a load of the display file on a channel's simulated finger port; None takes it off."""

    channel: str
    load: str | None


@dataclass(frozen=True)
class PressOrder:
    """Order to press on a channel's simulated finger port with a force, volts of command, from now on."""

    channel: str
    force_v: float


@dataclass(frozen=True)
class MeasureOrder:
    """Order to measure the response at those frequencies (Hz), as `measure` does."""

    controller: Controller
    channels: tuple[str, ...]
    frequency_hz: tuple[float, ...]
    level_db_sl: float
    load: str
    confidence_db: float
    longest_s: float
    mains_hz: float
    band_hz: tuple[float, float]


@dataclass(frozen=True, eq=False)
class PresentOrder:
    """Order to play blocks of reference (n, channels), threshold units, as one stream, for an experiment."""

    number: int
    blocks: tuple[FloatArray, ...]


@dataclass(frozen=True)
class ReopenOrder:
    """Order to open the rig anew after it has gone."""


@dataclass(frozen=True)
class QuitOrder:
    """Order to bring the rig to rest, let go of it, and end."""


Order = (
    LoadOrder | LiveOrder | RestOrder | GenerateOrder | TouchOrder | PressOrder | MeasureOrder | PresentOrder
    | ReopenOrder | QuitOrder
)  # fmt: skip


@dataclass(frozen=True)
class Standing:
    """State of the rig, told by its process whenever something of it has changed.

    guard: of a board, its mode and fault as words; empty where there is none. loaded: hash of the controller. fed:
    rows of reference that the rig has asked for; told: rows of trace that it has given back. refused: it has gone
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
    told: int = 0
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


Told = Standing | Piece | Points | Presented | Refused
