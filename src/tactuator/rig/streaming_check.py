"""Check of a board in free run: a reference streams in over its UART while its timer goes on.

A host that had no processor meanwhile (`HostWatch`) leaves the check without a verdict.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput, DeviceFault
from tactuator.model.controller import Controller
from tactuator.rig.board.commissioning import LATENESS_MAX, soft_ticks
from tactuator.rig.board.link import LinkClient, RigFault
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.board.stream import StreamDry
from tactuator.rig.emulator import EmulatorUart
from tactuator.rig.open import in_process_rig
from tactuator.rig.rig import Trace, join_traces
from tactuator.runtime.safety_table import Fault

INSTRUCTION_NS = 8
"""125 million instructions a second: what a Cortex-M4F at 168 MHz does at 1.34 clocks an instruction."""
_LONGEST_NS = 1 << 10
_LONGEST_S = 600.0
_LEAD_S, _BLOCK_S, _ANSWER_S = 0.8, 0.05, 20.0
_RMS = 20.0
_WAITS = Path("/proc/thread-self/schedstat")
STARVED_SHARE = 0.05
"""A stream that runs dry although its host had 95 % of the time it wanted runs dry by itself."""
Rows = NDArray[np.float32]


def waited_s(counts: Path = _WAITS) -> float:
    """Return the seconds in which this thread was ready and had no processor; NaN where the system does not tell."""
    try:
        return int(counts.read_text(encoding="ascii").split()[1]) / 1e9
    except (OSError, ValueError, IndexError):
        return math.nan


class HostWatch:
    """The host's waiting for a processor over the last `window` rows of a stream.

    clock: seconds; waited: seconds without a processor so far.
    """

    def __init__(
        self, window: int, clock: Callable[[], float] = time.monotonic, waited: Callable[[], float] = waited_s
    ) -> None:
        self._window, self._clock, self._waited = window, clock, waited
        self._marks = deque([(0, clock(), waited())])

    def mark(self, rows: int) -> None:
        """Take down how long the host has waited by the time that `rows` of the stream are played."""
        self._marks.append((rows, self._clock(), self._waited()))
        while len(self._marks) > 1 and self._marks[1][0] <= rows - self._window:
            self._marks.popleft()

    def waited_share(self) -> float:
        """Return the share of the window for which the host waited, 0 to 1; NaN where unknown."""
        _, begun_s, had_waited_s = self._marks[0]
        passed_s = self._clock() - begun_s
        return (self._waited() - had_waited_s) / passed_s if passed_s > 0.0 else 0.0

    def is_starved(self) -> bool:
        """Return whether what came too late may be the machine's fault: it waited too long, or nobody knows."""
        return not self.waited_share() < STARVED_SHARE


class NotJudged(DeviceFault):
    """A check could not tell: this machine had no time for its host, or the emulator's link none for the board."""


@dataclass(frozen=True)
class StreamingCheck:
    """The outcome of `samples` rows, each of all channels, streamed to a board at `instructions_per_s`.

    late: interrupts that began more than lateness_max of a period after their time. dry: ticks without a row. dropped:
    spoilt frames. played: samples that came back; bit_exact: the command and reading of every one are this machine's,
    which was given the same row at the same tick. Bytes of the link are for each second of the board's time.
    """

    board: str
    instructions_per_s: float
    rate_hz: float
    channels: int
    samples: int
    played: int
    late: int
    lateness_max: float
    dry: int
    dropped: int
    bit_exact: bool
    fault: str
    to_board_bytes_per_s: float
    from_board_bytes_per_s: float
    board_s: float
    host_s: float

    @property
    def holds(self) -> bool:
        """Return whether every sample came back bit-exact and nothing was late, dry or dropped."""
        return self.late == self.dry == self.dropped == 0 and self.bit_exact and self.played == self.samples


def check_streaming(
    board: str,
    controller: Controller,
    duration_s: float,
    instruction_ns: int = INSTRUCTION_NS,
    seed: int = 0,
    clock: Callable[[], float] = time.monotonic,
    waited: Callable[[], float] | None = None,
) -> StreamingCheck:
    """Stream noise of 26 dB SL rms, other on each channel, for duration_s of the board's time.

    The emulator's time follows the instructions, instruction_ns each, link and all; only the display's simulation takes
    none. Raises BadInput for a clock that the emulator does not have, or where it is missing, and NotJudged where ticks
    had no row, the board heard nothing, or its timer waited for bytes that a UART of its speed would have spread out,
    while by `clock` and `waited` host or emulator had no processor.
    """
    if instruction_ns not in [1 << shift for shift in range(11)]:
        raise BadInput(f"{instruction_ns} ns an instruction", f"1, 2, 4, ... {_LONGEST_NS}")
    if not 1.0 <= duration_s * controller.rate_hz <= _LONGEST_S * controller.rate_hz:
        raise BadInput(f"duration is {duration_s:g} s", f"one sample to {_LONGEST_S:g} s")
    samples = round(duration_s * controller.rate_hz)
    shape = (samples, len(controller.channels))
    rows = (_RMS * np.random.default_rng(seed).standard_normal(shape)).astype(np.float32)
    uart = EmulatorUart(board, f"shift={instruction_ns.bit_length() - 1},sleep=off")
    client = LinkClient(uart, _ANSWER_S)
    with BoardRig(client, controller.display, waits=False, lead_s=_LEAD_S) as rig:
        rig.simulate(seed)
        rig.load(controller)
        before, begun_s = (uart.sent, uart.received), clock()
        watch = HostWatch(round(_LEAD_S * rig.rate_hz), clock, waited or partial(_waited_s, uart))
        trace, dry, fault = _streamed(rig, rows, watch, instruction_ns > INSTRUCTION_NS)
        host_s, after = clock() - begun_s, (uart.sent, uart.received)
        status = client.status()
        first = rig.fed_to - samples
        board_s = max(status.tick, 1) / rig.rate_hz
    to_board, from_board = ((late - early) / board_s for late, early in zip(after, before, strict=True))
    return StreamingCheck(
        board, 1e9 / instruction_ns, rig.rate_hz, len(rig.channels), samples, len(trace), status.late, LATENESS_MAX,
        dry, status.dropped + client.dropped, len(trace) == samples and _is_ours(trace, controller, rows, first, seed),
        fault, to_board, from_board, board_s, host_s,
    )  # fmt: skip


def _waited_s(uart: EmulatorUart) -> float:
    """Return how long this thread and those of the emulator were ready to run and had no processor."""
    theirs = (waited_s(thread / "schedstat") for thread in uart.threads())
    return waited_s() + sum(each for each in theirs if not math.isnan(each))  # a thread may have ended meanwhile


def _streamed(rig: BoardRig, rows: Rows, watch: HostWatch, is_slow: bool) -> tuple[Trace, int, str]:
    """Return what came back, how many ticks had no row, and the guard's fault. Raises NotJudged for what may come of a
    busy machine, and for the silence of an emulated link beside a processor that is_slow.
    """
    traces: list[Trace] = []
    dry, fault = 0, "none"
    try:
        for trace in rig.stream(_blocks(rows, rig.rate_hz)):
            traces.append(trace)
            watch.mark(sum(map(len, traces)))
    except StreamDry as error:
        dry = error.ticks
        if watch.is_starved():
            raise _not_judged(f"{dry} ticks had no row", watch) from error
    except RigFault as error:
        fault = error.fault.words
        if error.fault is Fault.SILENCE and (is_slow or watch.is_starved()):
            raise _not_judged("the board heard nothing for 0.2 s of its time", watch) from error
        if error.fault is Fault.LATE and not is_slow and watch.is_starved():
            raise _not_judged("an interrupt came late, and the emulator's line has no speed", watch) from error
    except BadInput as error:  # the run is over
        if watch.is_starved():
            raise _not_judged("the board has ended its run", watch) from error
        raise
    return join_traces(traces, rig.rate_hz, rig.channels), dry, fault


def _not_judged(what: str, watch: HostWatch) -> NotJudged:
    share = 100.0 * watch.waited_share()
    return NotJudged(
        f"not judged: {what}, and the host had no processor for {share:.0f} % of the time before",
        f"a machine with less else to do, and at most {INSTRUCTION_NS} ns an instruction",
    )


def _is_ours(trace: Trace, controller: Controller, rows: Rows, first: int, seed: int) -> bool:
    with in_process_rig(controller.display, seed) as rig:
        rig.load(controller)
        soft = soft_ticks(rig.rate_hz)
        rig.play(np.zeros((first - soft, rows.shape[1])))
        ours = join_traces(rig.stream(_blocks(rows, rig.rate_hz)), rig.rate_hz, rig.channels)
    return trace.equals(ours)


def _blocks(rows: Rows, rate_hz: float) -> Iterator[Rows]:
    length = round(_BLOCK_S * rate_hz)
    for start in range(0, len(rows), length):
        yield rows[start : start + length]
