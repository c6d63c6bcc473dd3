"""What a stream's check makes of a board that is too fast for its host, hears nothing, or has ended its run."""

import itertools

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.board.link import LinkClient, Mode
from tactuator.rig.board_check.streaming_check import NotJudged, check_streaming
from tactuator.rig.transport import InProcess
from tactuator.runtime._core import lib
from tactuator.runtime.safety_table import Fault
from tests.rig.guard.guarded import designed


class SlowLink(InProcess):
    """A board in free run, of which `ticks` pass with every request once there were 40: too many for its rows."""

    ticks = 400

    def __init__(self, board, counting):
        super().__init__()
        self.sent = self.received = self._requests = 0

    def send(self, content):
        super().send(content)
        self._requests += self.board.mode == Mode.RUNNING
        if self._requests > 40:
            self.run(self.ticks)


class DeadLink(SlowLink):
    ticks = 900


UART = "tactuator.rig.board_check.streaming_check.EmulatorUart"


def test_streaming_check__runs_dry_beside_a_host_that_had_its_processor__does_not_hold(monkeypatch):
    monkeypatch.setattr(UART, SlowLink)
    found = check_streaming("slow", designed(), 2.0, waited=lambda: 0.0)
    assert found.dry > 0
    assert not found.holds


def test_streaming_check__hears_nothing_of_a_host_that_had_its_processor__does_not_hold(monkeypatch):
    monkeypatch.setattr(UART, DeadLink)
    found = check_streaming("slow", designed(), 2.0, waited=lambda: 0.0)
    assert found.fault == Fault.SILENCE.words
    assert not found.holds


@pytest.mark.parametrize(("waited_share", "instruction_ns"), [(0.5, 8), (0.0, 32)])
def test_streaming_check__hears_nothing_of_a_host_behind__is_not_judged(monkeypatch, waited_share, instruction_ns):
    """The emulator's UART takes time of this machine for a byte, while a slow processor's time goes on."""
    monkeypatch.setattr(UART, DeadLink)
    now_s = itertools.count()
    with pytest.raises(NotJudged, match=r"heard nothing for 0\.2 s"):
        check_streaming(
            "slow", designed(), 2.0, instruction_ns,
            clock=lambda: float(next(now_s)), waited=lambda: waited_share * next(now_s),
        )  # fmt: skip


class LateLink(SlowLink):
    """A board of which an interrupt began half a period after its time."""

    ticks = 1

    def send(self, content):
        super().send(content)
        if self._requests > 40:
            lib.tact_simulated_board_period(self.simulated, self.board, 128)


@pytest.mark.parametrize("instruction_ns", [8, 32])
def test_streaming_check__late_beside_a_host_that_had_its_processor__does_not_hold(monkeypatch, instruction_ns):
    monkeypatch.setattr(UART, LateLink)
    found = check_streaming("slow", designed(), 2.0, instruction_ns, waited=lambda: 0.0)
    assert found.late > 0
    assert found.fault == Fault.LATE.words
    assert not found.holds


@pytest.mark.parametrize(("instruction_ns", "is_judged"), [(8, False), (32, True)])
def test_streaming_check__late_beside_a_host_without_processor__is_judged_of_a_slow_board_alone(
    monkeypatch, instruction_ns, is_judged
):
    """The emulator's line has no speed: what a busy host sends late comes at once, and keeps the timer waiting."""
    monkeypatch.setattr(UART, LateLink)
    now_s = itertools.count()
    given = {"clock": lambda: float(next(now_s)), "waited": lambda: 0.5 * next(now_s)}
    if is_judged:
        assert check_streaming("slow", designed(), 2.0, instruction_ns, **given).late > 0
    else:
        with pytest.raises(NotJudged, match="an interrupt came late"):
            check_streaming("slow", designed(), 2.0, instruction_ns, **given)


@pytest.mark.parametrize("waited_share", [0.06, 1.0, np.nan])
def test_streaming_check__runs_dry_beside_a_host_without_processor__is_not_judged(monkeypatch, waited_share):
    monkeypatch.setattr(UART, SlowLink)
    now_s = itertools.count()
    with pytest.raises(NotJudged, match=r"not judged: \d+ ticks had no row"):
        check_streaming(
            "slow", designed(), 2.0, clock=lambda: float(next(now_s)), waited=lambda: waited_share * next(now_s)
        )


class PromptLink(SlowLink):
    ticks = 0


@pytest.mark.parametrize(("waited_share", "error"), [(0.5, NotJudged), (0.0, BadInput)])
def test_streaming_check__board_has_ended_its_run__is_not_judged_beside_a_host_without_processor(
    monkeypatch, waited_share, error
):
    monkeypatch.setattr(UART, PromptLink)
    now_s, calls, takes = itertools.count(), itertools.count(), LinkClient.stream

    def ends(client, *asked):
        if next(calls) > 20:
            raise BadInput("the board refused to stream: other run; it is OFF")
        return takes(client, *asked)

    monkeypatch.setattr(LinkClient, "stream", ends)
    with pytest.raises(error, match=r"the board (has ended its run|refused to stream: other run)"):
        check_streaming(
            "slow", designed(), 2.0, clock=lambda: float(next(now_s)), waited=lambda: waited_share * next(now_s)
        )
