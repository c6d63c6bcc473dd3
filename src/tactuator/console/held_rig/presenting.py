"""Stimuli of an experiment at the rig that this process holds: played, and told trace by trace."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from tactuator.console.held_rig.orders import Presented, PresentOrder
from tactuator.console.held_rig.watched import RigHalted, WatchedRig
from tactuator.errors import TactuatorError, TimingMissed
from tactuator.rig.rig import Rig, Trace


def presented(
    rig: Rig, order: PresentOrder, halted: Callable[[], bool], tell: Callable[[Presented], None]
) -> Iterator[Trace]:
    """Play the blocks of an order as one stream, tell each trace with the rig's own count of rows, and yield it.

    The end is told in every case, with the reason where it was not the last row: that the rig was halted, or its fault,
    which is then raised.
    """

    def say(
        trace: Trace | None, over: bool = False, halted: bool = False, fault: str = "", missed: bool = False
    ) -> None:
        played = None if rig.began_at is None else rig.rows_played
        tell(Presented(order.number, trace, rig.began_at, played, over, halted, fault, missed))

    try:
        for trace in WatchedRig(rig, halted).stream(order.blocks):
            say(trace)
            yield trace
    except RigHalted:
        rig.rest()
        say(None, over=True, halted=True)
    except TactuatorError as error:
        say(None, over=True, fault=str(error), missed=isinstance(error, TimingMissed))
        raise
    except Exception as error:
        say(None, over=True, fault=f"{type(error).__name__}: {error}")
        raise
    else:
        say(None, over=True)
