"""Calls of the process that holds the rig, in turn, and what it tells of the rig."""

from __future__ import annotations

import queue
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field

from tactuator.console.fields import PageSetting
from tactuator.console.generator import GeneratorWave, Hertz
from tactuator.errors import BadInput
from tactuator.measure.options import MeasurementOptions
from tactuator.rig.rig import Trace

Mode = Literal["idle", "live", "measuring", "presenting", "fault", "gone"]
Call = tuple[str, tuple[Any, ...]]
"""Name of a method of RigWorker, and its arguments."""
QUIT: Call = ("quit", ())
WAITING_MAX = 1000
"""Calls that may wait, while a measurement goes on for instance; a page makes less than a hundred a second."""


@dataclass(frozen=True)
class MeasureSettings(MeasurementOptions, PageSetting):
    """Settings of a measurement of the response, as `measure` has them; no frequencies (Hz): those of the command."""

    frequency_hz: Annotated[tuple[Hertz, ...], Field(max_length=200)] = ()


@dataclass(frozen=True)
class RigStatus:
    """Status of the rig, sent by its process whenever something of it has changed.

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
class Points:
    """A measurement so far: the document of its responses, what of it is over, and the response file (CSV)."""

    document: dict[str, Any]
    done: int
    total: int
    csv: str
    over: bool = False


@dataclass(frozen=True, eq=False)
class Presented:
    """A piece of what an experiment plays by the call of that number, or its end (over).

    began_at, rows_played: of a rig that tells its time, else None. halted: it was stopped; fault: why the rig did;
    missed: and the same may be asked for again.
    """

    number: int
    trace: Trace | None = None
    began_at: int | None = None
    rows_played: int | None = None
    over: bool = False
    halted: bool = False
    fault: str = ""
    missed: bool = False


class WaitingCalls:
    """Calls in turn, put in by other threads than the one that obeys them."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Call] = queue.SimpleQueue()

    def put(self, call: Call) -> str:
        """Let a call wait its turn, and return a message about it; empty as a rule.

        Where too many wait, another is refused. A call that ends something takes the place of those before it instead,
        and one that an experiment waits for is taken in any case.
        """
        warning = ""
        if self._queue.qsize() >= WAITING_MAX and not _is_awaited(call):
            if call not in (("rest", ()), ("generate", (None,))):
                return str(BadInput(f"{WAITING_MAX} orders wait for the rig", "another once they are done"))
            warning = f"{self._forget()} orders that waited for the rig are dropped, because something is to end"
        self._queue.put(call)
        return warning

    def get(self) -> Call:
        """Return the next call, as soon as there is one."""
        return self._queue.get()

    def get_nowait(self) -> Call | None:
        """Return the next call, or None where none waits."""
        try:
            return self._queue.get_nowait()
        except queue.Empty:
            return None

    def _forget(self) -> int:
        """Drop what waits, but for what an experiment waits for; return how many calls that were."""
        waited = list(iter(self.get_nowait, None))
        kept = [call for call in waited if _is_awaited(call)]
        for call in kept:
            self._queue.put(call)
        return len(waited) - len(kept)


def _is_awaited(call: Call) -> bool:
    """Return whether an experiment waits for the call's end (a rest with a number), or the process ends with it."""
    name, arguments = call
    return name in ("present", "quit") or (name == "rest" and arguments != ())
