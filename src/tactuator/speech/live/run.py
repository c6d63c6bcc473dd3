"""A live stream on a rig, from rest to rest however it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from tactuator.errors import TimingMissed
from tactuator.rig.rig import Rig
from tactuator.speech.live.source import Source
from tactuator.speech.live.stream import LiveState, LiveStream

LEAD_S = 0.005
"""By which a rig is fed ahead at first, as far as it can be so little; twice as far after each time that it ran dry."""
REPORT_S = 0.05
MOST_MISSES, SOUND_S = 5, 1.0
"""A rig that misses its time so often, each less than a second after it began, is given up."""


@contextmanager
def fed_shortly(rig: Rig) -> Iterator[None]:
    """Feed a rig as little ahead as it allows."""
    lead_s, rig.lead_s = rig.lead_s, min(rig.lead_s, LEAD_S)
    try:
        yield
    finally:
        rig.lead_s = lead_s


def run_live(stream: LiveStream, rig: Rig, source: Source, report: Callable[[LiveState], None]) -> None:
    """Play a live stream on a loaded rig until it ends; `report` is called every REPORT_S.

    A rig that misses its time is at rest for a moment, and goes on: a drop-out. Raises DeviceFault as `Rig.stream`
    does, TimingMissed after MOST_MISSES, and the source's fault, if that is why it ended.
    """
    misses, since_s, unsaid = 0, 0.0, 0
    try:
        with closing(source):
            while True:
                try:
                    for trace in rig.stream(stream.blocks()):
                        unsaid += len(trace)
                        if unsaid >= REPORT_S * rig.rate_hz:
                            unsaid = 0
                            report(stream.state)
                    break
                except TimingMissed:
                    now_s = stream.state.seconds
                    misses, since_s = (misses + 1 if now_s - since_s < SOUND_S else 1), now_s
                    if misses >= MOST_MISSES:
                        raise
                    rig.rest()
                    rig.lead_s *= 2.0
                    stream.lost()
            if (fault := getattr(source, "fault", None)) is not None:
                raise fault
    finally:
        rig.rest()
