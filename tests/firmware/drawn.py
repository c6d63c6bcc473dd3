"""Drawn cases for boards: displays, safety tables and controllers, and what happens to them, over the ordinary link.

Two boards that are asked the same answer the same, bit for bit, or differ. A case begins with tables and a display of
its own: what was before does not matter.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from functools import cache
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import DeviceFault
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Converter, Display
from tactuator.rig.board.commissioning import safety_table
from tactuator.rig.board.link import (
    IMAGE,
    SAFETY,
    SILENT,
    SIMULATED_DISPLAY,
    STIMULUS,
    STREAM,
    LinkClient,
    Mode,
    Request,
    RequestOutcome,
    Status,
)
from tactuator.rig.board.rig import SENSOR_FAULTS
from tactuator.rig.board.stream import BoardTone, stimulus_payloads
from tactuator.rig.transport import InProcess
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import ChannelSafety, Fault, SafetyTable, Standstill, safety_bytes
from tactuator.runtime.tables import simulated_board_bytes

PIECES, PIECE_ROWS, REST_LOOKS = 12, 160, 100
Rows = NDArray[np.float32]
Answer = tuple[str, object]


# -- tables ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """What two boards are given, and what happens then: all by `seed`."""

    seed: int
    safety: SafetyTable
    image: bytes
    display: bytes


def drawn(seed: int, controller: Controller) -> Case:
    """Half of the tables have the limits as designed, half of the images the controller: what is usual goes on."""
    rng = np.random.default_rng(seed)
    display, table = controller.display, _designed_table(controller.display)
    if rng.integers(2):
        display = replace(
            display,
            delay_samples=int(rng.integers(1, 9)),
            channels=tuple(replace(each, converter=_converter(rng, each.converter)) for each in display.channels),
        )
        pairs = zip(table.channels, display.channels, strict=True)
        limits = tuple(_limits(rng, safety, channel.converter) for safety, channel in pairs)
        table = replace(table, channels=limits, delay_samples=display.delay_samples, turns=int(rng.integers(1, 5)))
    table = _times(rng, table)
    controller = replace(controller, display=display)
    if rng.integers(2):
        controller = replace(controller, channels=tuple(_altered(rng, each) for each in controller.channels))
    return Case(seed, table, build_image(controller), simulated_board_bytes(display, seed))


@cache
def _designed_table(display: Display) -> SafetyTable:
    return safety_table(display)


def _converter(rng: np.random.Generator, of: Converter) -> Converter:
    kind = int(rng.integers(8))
    if kind < 5:
        return of
    bits = 16 if kind == 5 else int(rng.integers(12, 25))
    return Converter(bits, of.range_v, 1 if kind == 6 else -1, float(rng.uniform(-0.5, 0.5)))


def _limits(rng: np.random.Generator, of: ChannelSafety, converter: Converter) -> ChannelSafety:
    """Limits of the table, ones that are soon passed, and ones that are not."""

    def limit(value: float, most: float) -> float:
        kind, share = int(rng.integers(12)), float(rng.uniform())
        return {0: value * share, 1: value * share**3, 2: most}.get(kind, value)

    code_max = min(2 ** (converter.bits - 1) - 2, round(of.position_code_max * of.converter.step_v / converter.step_v))
    return replace(
        of, converter=converter, position_code_max=code_max, stop_max_v=limit(of.stop_max_v, 1e6),
        command_max_v=limit(of.command_max_v, 31.0), reference_max=limit(of.reference_max, 1e5),
        comfort_max=limit(of.comfort_max, 1e5), disagreement_v=limit(of.disagreement_v, 1e6),
        reversal_power=limit(of.reversal_power, 1e6), travel_max=limit(of.travel_max, 1e5),
        standstill=Standstill(int(rng.integers(24)), limit(of.standstill.stray_max_v, 1e6)),
        jump=replace(of.jump, least_v=limit(of.jump.least_v, 1e6)),
    )  # fmt: skip


def _times(rng: np.random.Generator, of: SafetyTable) -> SafetyTable:
    """Times of the table, and short ones. The link's silence makes each table another."""

    def ticks(value: int) -> int:
        return value if rng.integers(4) == 0 else min(value, int(rng.integers(1, 97)))

    frozen = (replace(each, frozen_ticks=ticks(each.frozen_ticks)) for each in of.channels)
    names = ("soft_start_ticks", "fade_ticks", "ramp_ticks", "quick_ticks")
    silence = int(rng.integers(1, 64)) if rng.integers(8) == 0 else 400 + int(rng.integers(1 << 16))
    return replace(
        of, **{name: ticks(getattr(of, name)) for name in names}, silence_ticks=silence,
        lock_ticks=int(rng.integers(97)), channels=tuple(frozen),
    )  # fmt: skip


def _altered(rng: np.random.Generator, of: ChannelController) -> ChannelController:
    """A controller that is stronger or weaker, of the wrong sign at times, or shorter; the same in another form."""
    kind, gain = int(rng.integers(8)), float(8.0 * (rng.uniform() - 0.25))
    if kind == 1 or of.feedback_sos is None:
        return replace(of, prefilter_sos=of.prefilter_sos * [gain, gain, gain, 1.0, 1.0, 1.0])
    sections = np.array(of.feedback_sos)
    if kind == 2:
        return replace(of, feedback_sos=None, feed_forward=None)
    if kind == 3:
        return replace(of, prefilter_sos=of.prefilter_sos[:1])
    if kind == 4:
        sections[0, :3] *= 2.0
        sections[-1, :3] *= 0.5
    if kind == 5:
        sections[0, :3] *= gain
    if kind >= 6 and of.feed_forward is not None:
        return replace(of, feed_forward=replace(of.feed_forward, delay_samples=int(rng.integers(1, 17))))
    return replace(of, feedback_sos=sections)


# -- what happens ------------------------------------------------------------------------------------------------------


def references(rng: np.random.Generator, count: int, most: NDArray[np.float64]) -> Rows:
    """Rows of one kind, of a level for each channel."""
    shape = (count, most.size)
    level = most * 0.5 ** rng.integers(-1, 12, most.size)
    bits = rng.integers(0, 1 << 32, shape, dtype=np.uint64).astype(np.uint32)
    flips = np.cumprod(np.where(rng.uniform(size=shape) < 1 / 128, -1.0, 1.0), axis=0)
    noise = rng.uniform(-1.0, 1.0, shape)
    kinds = (
        level * noise,
        level * flips,
        0.02 * level * np.cumsum(noise, axis=0),
        np.where(noise < 0.0, -0.0, 0.0) * level,
        bits.view(np.float32),  # any number at all, NaN and infinities among them
        (bits & 0x807FFFFF).view(np.float32),  # subnormal
        level * np.sign(noise),
        np.where(rng.uniform(size=shape) < 1e-3, np.nan, level),
        level * (np.arange(count)[:, None] % 200 / 100.0 - 1.0),
    )
    with np.errstate(over="ignore"):
        return kinds[int(rng.integers(len(kinds)))].astype(np.float32)


class Conversation:
    """Requests to a board, and all that it answers."""

    def __init__(self, client: LinkClient, channels: int) -> None:
        self.client, self.channels = client, channels
        self.answers: list[Answer] = []

    def ask(self, request: Request, payload: bytes = b"") -> tuple[RequestOutcome, bytes]:
        answer = self.client.ask(request, payload)
        self.answers.append((request.name, answer))
        return answer

    def look(self) -> Status:
        """Note all of the status but what it costs, and how many tones of the next ticks are made."""
        status = self.client.status()
        self.answers.append(("STATUS", replace(status, name="", heard=0, stream_end=0, cycles=0)))
        return status

    def trace(self, status: Status) -> None:
        at = max(0, status.tick - status.trace_capacity)
        while at < status.tick:
            _, rows = self.ask(Request.TRACE, struct.pack("<IIHB", status.run, at, status.tick - at, 1))
            at += max(1, struct.unpack_from("<IH", rows)[1])
        self.ask(Request.WEIGHTS)


def answers(client: LinkClient, case: Case) -> list[Answer]:
    """All answers of a board in a case: it is commissioned, a run begins, things happen, it ends; its trace is read."""
    rng = np.random.default_rng([case.seed, 1])
    board = Conversation(client, len(case.safety.channels))
    for kind, content in ((SAFETY, safety_bytes(case.safety)), (IMAGE, case.image), (SIMULATED_DISPLAY, case.display)):
        client.upload(kind, content)
    source = int(rng.choice([STREAM, STREAM, STREAM, STREAM, STREAM, STIMULUS, SILENT]))
    drives = source == STREAM and bool(rng.integers(6) == 0)
    board.ask(Request.ARM)
    if source == STIMULUS:
        _give_tones(rng, board, case)
    run = client.status().run + 1
    board.ask(Request.START, struct.pack("<IBBB", run, source, drives, source == STREAM))
    for _ in range(int(rng.integers(1, PIECES))):
        _happens(rng, board)
        if source == STREAM:
            _stream(rng, board, case, run, drives)
        if board.look().mode is Mode.FAULT:
            break
    board.ask(Request.STOP)
    _rest(board)
    board.trace(board.look())
    _back_to_off(board, acknowledges=bool(rng.integers(6)))
    return board.answers


def _give_tones(rng: np.random.Generator, board: Conversation, case: Case) -> None:
    names = [str(channel) for channel in range(board.channels)]
    most = min(999.0, 2.0 * case.safety.channels[0].reference_max)
    tones = {
        name: [
            BoardTone(float(rng.uniform(5.0, 400.0)), most * float(rng.uniform()), float(rng.uniform(0.0, 0.02)),
                      float(rng.uniform(0.01, 0.05)), 0.005)
            for _ in range(int(rng.integers(4)))
        ]
        for name in names
    }  # fmt: skip
    for payload in stimulus_payloads(tones, names, case.safety.rate_hz, 0):
        board.ask(Request.STIMULUS, payload)


def _happens(rng: np.random.Generator, board: Conversation) -> None:
    """A channel is touched or let go, its sensor begins to lie or is mended, or the host asks for what may not be."""
    kind, channel = int(rng.integers(24)), int(rng.integers(board.channels))
    if kind < 3:
        board.ask(Request.TOUCH, struct.pack("<BB", channel, kind == 0))
    elif kind == 3:
        board.ask(Request.BREAK, struct.pack("<BBf", channel, 0, 0.0))
    elif kind < 6:
        what = int(rng.integers(1, len(SENSOR_FAULTS)))
        value = {7: 1e-4, 9: 30.0, 10: 2.0, 11: 9.0}.get(what, 1.0) * float(rng.uniform(0.1, 1.4))
        board.ask(Request.BREAK, struct.pack("<BBf", channel, what, value))
    elif kind == 6:
        board.ask(Request(int(rng.choice([Request.ARM, Request.OFF, Request.CLEAR]))))


def _stream(rng: np.random.Generator, board: Conversation, case: Case, run: int, drives: bool) -> None:
    """Rows and forces, all of them played before the next request; at times some that come twice, or too far ahead."""
    count, first = int(rng.integers(1, PIECE_ROWS)), board.client.status().stream_end
    most = [each.command_max_v if drives else each.reference_max for each in case.safety.channels]
    rows = references(rng, count, np.minimum(most, 2000.0))
    forces = np.zeros_like(rows)
    if rng.integers(3) == 0:
        forces += rng.uniform(-1.0, 1.0, board.channels).astype(np.float32) ** 3 * 2.0
    first += int(rng.choice([0, 0, 0, 0, 0, 0, -2, 70]))
    content = np.concatenate([rows, forces], axis=1).astype("<f4").tobytes()
    board.ask(Request.STREAM, struct.pack("<IIHB", run, first & 0xFFFFFFFF, count, 1) + content)


def _rest(board: Conversation) -> None:
    for _ in range(REST_LOOKS):
        status = board.client.status()
        if status.at_rest:
            return
    board.client.ask(Request.STOP)
    raise DeviceFault(f"{status.mode.name}, fault {status.fault.name}: does not come to rest")


def _back_to_off(board: Conversation, acknowledges: bool) -> None:
    client = board.client
    for _ in range(REST_LOOKS):
        if client.ask(Request.CLEAR)[0] is RequestOutcome.DONE:
            break
    board.ask(Request.OFF)
    if acknowledges:
        board.ask(Request.ACKNOWLEDGE, struct.pack("<I", client.status().sensor_faults))


class Expected:
    """What this machine answers in one case after another: a board that is asked the same from its beginning differs in
    none of it."""

    def __init__(self, controller: Controller) -> None:
        self._controller, self._client = controller, LinkClient(InProcess())
        self._known: list[tuple[Case, list[Answer]]] = []

    def difference(self, target: LinkClient, cases: int) -> str:
        """The first answer of a board that is another; "" for none."""
        for number in range(cases):
            if number == len(self._known):
                case = drawn(number, self._controller)
                self._known.append((case, answers(self._client, case)))
            case, ours = self._known[number]
            both = zip_longest(answers(target, case), ours)
            found = next((at for at, (theirs, mine) in enumerate(both) if theirs != mine), None)
            if found is not None:
                return f"case {number}, answer {found}"
        return ""

    def faults(self) -> set[Fault]:
        """Those that have occurred so far."""
        told = (what for _, answers in self._known for name, what in answers if name == "STATUS")
        return {status.fault for status in told if isinstance(status, Status)}
