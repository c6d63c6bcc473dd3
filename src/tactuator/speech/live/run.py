"""A live stream on a rig, from rest to rest however it ends."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from itertools import chain

import numpy as np

from tactuator.errors import TimingMissed
from tactuator.rig.rig import Rig, Trace
from tactuator.rig.sound.rig import SoundRig
from tactuator.speech.live.source import Source
from tactuator.speech.live.stream import LiveStream

LEAD_S = 0.005
"""By which a rig is fed ahead at first, as far as it can be so little; twice as far after each time that it ran dry."""
QUIET_S = 0.06
"""For which the loop stays closed at the end: a motor that is let go while it moves can be felt."""
MOST_MISSES, SOUND_S = 5, 1.0
"""A rig that misses its time so often, each less than a second after it began, is given up."""


@contextmanager
def fed_shortly(rig: Rig) -> Iterator[None]:
    """Feed a rig as little ahead as it allows. A sound card's gaps are counted, and felt as the gaps that they are."""
    lead_s, rig.lead_s = rig.lead_s, min(rig.lead_s, LEAD_S)
    allowed = isinstance(rig, SoundRig) and rig.allow_gaps
    if isinstance(rig, SoundRig):
        rig.allow_gaps = True
    try:
        yield
    finally:
        rig.lead_s = lead_s
        if isinstance(rig, SoundRig):
            rig.allow_gaps = allowed


@contextmanager
def prompt() -> Iterator[None]:
    """Let this thread run before any that is not at real-time priority, where the system permits it (Linux, `ulimit
    -r`): a busy machine then does not hold it up. For threads that mostly wait.
    """
    usual = hasattr(os, "sched_setscheduler") and os.sched_getscheduler(0) == os.SCHED_OTHER
    try:
        if usual:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        usual = False
    try:
        yield
    finally:
        if usual:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def run_live(stream: LiveStream, rig: Rig, source: Source, report: Callable[[Trace], None]) -> None:
    """Play a live stream on a loaded rig until it ends; `report` is called with the trace, in pieces as they come.

    A rig that misses its time is at rest for a moment, and goes on: a drop-out. Raises DeviceFault as `Rig.stream`
    does, TimingMissed after MOST_MISSES, and the source's fault, if that is why it ended. The rig comes to rest before
    the source is closed: a microphone takes its time.
    """
    misses, since_s = 0, 0.0
    quiet = np.zeros((round(QUIET_S * rig.rate_hz), len(rig.channels)))
    gc.collect()
    gc.freeze()  # a search for garbage, 70 ms among all that is loaded, then goes over what is new
    with closing(source), nullcontext() if rig.waits else prompt():
        try:
            while True:
                try:
                    for trace in rig.stream(chain(stream.blocks(), [quiet])):
                        report(trace)
                    break
                except TimingMissed:
                    now_s = stream.state.seconds
                    misses, since_s = (misses + 1 if now_s - since_s < SOUND_S else 1), now_s
                    if misses >= MOST_MISSES:
                        raise
                    rig.rest()
                    rig.lead_s *= 2.0
                    stream.lost()
        finally:
            gc.unfreeze()
            rig.rest()
        if (fault := stream.fault or getattr(source, "fault", None)) is not None:
            raise fault
