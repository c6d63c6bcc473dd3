"""Check of a board's interrupt: what it computes, tick by tick, against the same core on this machine, bit for bit."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput, DeviceFault
from tactuator.model.controller import Controller
from tactuator.rig.board.commissioning import safety_table
from tactuator.rig.board.link import Request, RigFault, understood
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.board.stream import BoardTone
from tactuator.rig.open import in_process_rig
from tactuator.rig.rig import Trace
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import Fault, safety_bytes

STRETCH_TICKS = 10_000
"""Ticks of one request: a fraction of a second on a board at 168 MHz."""
_PATIENCE = 3.0
_ANSWER = struct.Struct("<4I")
_PLAYED_ROWS = 1200


@dataclass(frozen=True)
class PeriodCheck:
    """Result of a check: `ticks` of drawn events, on all `channels` of a board.

    bit_exact: codes, modes, faults, fades and traces of every tick are this machine's. first_difference: where they
    are not (empty: nowhere). running_ticks, starts, faults: how many ticks a command was on, how many runs began, and
    which faults occurred. played: ticks that the board's own timer and link brought back,
    compared with this machine's besides; 0 where the display is real.
    """

    board: str
    bit_exact: bool
    first_difference: str
    ticks: int
    channels: int
    running_ticks: int
    starts: int
    faults: tuple[str, ...]
    played: int


@dataclass
class _Tally:
    running: int = 0
    starts: int = 0
    faults: int = 0
    played: int = 0


def check_period(target: BoardRig, controller: Controller, ticks: int, locates: bool = True) -> PeriodCheck:
    """Compare `ticks` of the target's interrupt with this machine's, and what it plays where it can.

    The target runs the firmware with the safety table of the controller's display.
    locates: a difference is told by its tick, not by its stretch alone; to find it takes longer than all the rest.
    Raises BadInput for fewer ticks than one, and for a board that holds another display's table.
    """
    if ticks < 1:
        raise BadInput(f"ticks is {ticks}", "1 or more")
    (table_crc,) = struct.unpack("<I", safety_bytes(safety_table(controller.display))[-4:])
    if target.status().safety_crc != table_crc:
        raise BadInput(
            "the board holds the safety table of another display", "the display that it was commissioned with"
        )
    tally = _Tally()
    with in_process_rig(controller.display) as host:
        image = build_image(controller)
        for rig in (target, host):
            rig.load_image(image)
        difference = _compare(target, host, ticks, tally, locates) or _compare_play(target, host, tally)
    faults = tuple(fault.words for fault in Fault if tally.faults >> fault & 1)
    return PeriodCheck(
        target.status().name, not difference, difference, ticks, len(controller.channels), tally.running,
        tally.starts, faults, tally.played,
    )  # fmt: skip


def _ask(rig: BoardRig, seed: int, ticks: int) -> tuple[int, int, int, int]:
    """Return digest, ticks with a command, starts, and faults as bits of a stretch from its beginning.

    Raises DeviceFault for a board that begins anew instead: a program that breaks down is reset by its watchdog.
    """
    begun = rig.client.begun
    try:
        answer = rig.client.must(Request.PERIOD_CHECK, struct.pack("<II", seed, ticks), patience=_PATIENCE)
    except BadInput:
        if rig.client.begun == begun:
            raise
        raise DeviceFault(f"the board began anew at seed {seed} of the check; its program broke down there") from None
    with understood(Request.PERIOD_CHECK):
        digest, running, starts, faults = _ANSWER.unpack(answer)
    return digest, running, starts, faults


def _compare(target: BoardRig, host: BoardRig, ticks: int, tally: _Tally, locates: bool) -> str:
    for seed, at in enumerate(range(0, ticks, STRETCH_TICKS), start=1):  # one stretch after another
        count = min(STRETCH_TICKS, ticks - at)
        ours = _ask(host, seed, count)
        if _ask(target, seed, count) != ours:
            tick = f", tick {_first_difference(target, host, seed, count)} of a stretch" if locates else ""
            return f"seed {seed}{tick}"
        tally.running += ours[1]
        tally.starts += ours[2]
        tally.faults |= ours[3]
    return ""


def _first_difference(target: BoardRig, host: BoardRig, seed: int, ticks: int) -> int:
    """Find the first tick of a stretch that differs, by bisection: a digest that differs once differs from then on."""
    same, differs = 0, ticks
    while differs - same > 1:
        middle = (same + differs) // 2
        if _ask(target, seed, middle) == _ask(host, seed, middle):
            same = middle
        else:
            differs = middle
    return same


def _compare_play(target: BoardRig, host: BoardRig, tally: _Tally) -> str:
    """Compare what boards with a simulated display play through their timers and links; "" where it is the same."""
    if not target.status().allows_hold:
        return ""
    for name, act in _ACTS.items():
        for rig in (target, host):
            rig.off()
            rig.simulate(1)
        theirs, ours = act(target), act(host)
        same = len(theirs[0]) == len(ours[0]) and all(map(Trace.equals, theirs[0], ours[0]))
        if theirs[1:] != ours[1:] or not same:
            return f"played: {name}"
        tally.played += sum(len(trace) for trace in ours[0])
    return ""


Played = tuple[list[Trace], str, int]


def _rows(rig: BoardRig, level: float) -> NDArray[np.float64]:
    rng = np.random.default_rng(7)
    return level * np.cumsum(rng.uniform(-1.0, 1.0, (_PLAYED_ROWS, len(rig.channels))), axis=0) / 30.0


def _play(rig: BoardRig) -> Played:
    return [rig.play(_rows(rig, 100.0))], "", 0


def _play_touched(rig: BoardRig) -> Played:
    finger = rig.finger(rig.channels[0])
    loads = [load.name for load in rig.display.channels[0].loads]
    traces = []
    for load in [*loads[:1], None]:
        finger.touch(load)
        traces.append(rig.play(_rows(rig, 60.0)))
    return traces, "", 0


def _play_tones(rig: BoardRig) -> Played:
    tones = {name: [BoardTone(40.0 + 30.0 * i, 80.0, 0.0, 0.2)] for i, name in enumerate(rig.channels)}
    return [rig.play_tones(tones, 0.25)], "", 0


def _play_broken(rig: BoardRig) -> Played:
    """Play until a sensor fails in mid-run; return the fault and its channel, once the output has come to rest."""
    channel = rig.channels[-1]
    traces: list[Trace] = []
    try:
        traces.append(rig.play(_rows(rig, 60.0)))
        rig.break_sensor(channel, "open")
        rig.play(_rows(rig, 60.0))
    except RigFault as error:
        return traces, error.fault.words, error.channel
    except DeviceFault as error:
        return traces, str(error), 0
    finally:
        rig.break_sensor(channel, "sound")
        rig.off()
        rig.client.acknowledge()
    return traces, "", 0


_ACTS: dict[str, Callable[[BoardRig], Played]] = {
    "noise": _play,
    "noise under a finger": _play_touched,
    "tones of its own": _play_tones,
    "sensor that fails": _play_broken,
}
