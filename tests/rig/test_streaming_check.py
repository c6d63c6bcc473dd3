"""What a stream's check makes of a board too fast for its host, deaf, late, or at the end of its run."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from tactuator.rig.board.link import Mode
from tactuator.rig.streaming_check import HostWatch, NotJudged, check_streaming, waited_s
from tactuator.rig.transport import InProcess
from tactuator.runtime._core import lib
from tactuator.runtime.safety_table import Fault
from tests.rig.guard.guarded import designed


def link(ticks, lateness=None):
    """A board in free run, of which `ticks` pass with every request once there were 40; `lateness` of one interrupt."""

    class Link(InProcess):
        def __init__(self, board, counting):
            super().__init__()
            self.sent = self.received = self._requests = 0

        def send(self, content):
            super().send(content)
            self._requests += self.board.mode == Mode.RUNNING
            if self._requests > 40:
                self.run(ticks)
                if lateness is not None:
                    lib.tact_simulated_board_period(self.simulated, self.board, lateness)

    return Link


SLOW, DEAD, LATE = link(400), link(900), link(1, 128)
"""Too fast for its rows, silent for too long, late by half a period."""


def checked(monkeypatch, uart, waited_share, instruction_ns=8):
    """The check beside a host that had no processor for a share of the time."""
    monkeypatch.setattr("tactuator.rig.streaming_check.EmulatorUart", uart)
    now_s = itertools.count()
    given = {"clock": lambda: float(next(now_s)), "waited": lambda: waited_share * next(now_s)}
    return check_streaming("slow", designed(), 2.0, instruction_ns, **given)


@pytest.mark.parametrize(
    ("uart", "share", "instruction_ns", "fault"),
    [
        (SLOW, 0.0, 8, "none"),
        (DEAD, 0.0, 8, Fault.SILENCE.words),
        (LATE, 0.0, 8, Fault.LATE.words),
        (LATE, 0.5, 32, Fault.LATE.words),  # of a slow board it is judged, however busy the host
    ],
)
def test_streaming_check__fails_by_itself__does_not_hold(monkeypatch, uart, share, instruction_ns, fault):
    found = checked(monkeypatch, uart, share, instruction_ns)
    assert found.fault == fault
    assert (found.dry > 0) == (uart is SLOW)
    assert (found.late > 0) == (uart is LATE)
    assert not found.holds


@pytest.mark.parametrize(
    ("uart", "share", "instruction_ns", "words"),
    [
        *((SLOW, share, 8, r"not judged: \d+ ticks had no row") for share in (0.06, np.nan)),
        (DEAD, 0.0, 32, r"heard nothing for 0\.2 s"),  # the emulator's UART takes time of this machine for a byte
        (LATE, 0.5, 8, "an interrupt came late"),  # the emulator's line has no speed: late bytes come at once
    ],
)
def test_streaming_check__beside_a_host_behind__is_not_judged(monkeypatch, uart, share, instruction_ns, words):
    with pytest.raises(NotJudged, match=words):
        checked(monkeypatch, uart, share, instruction_ns)


@pytest.mark.parametrize(("window", "share", "starved"), [(200, 0.04, False), (301, 9.08 / 12.0, True)])
def test_is_starved__waiting_before_the_window__does_not_count(window: int, share: float, starved: bool) -> None:
    now = [0.0, 0.0]
    watch = HostWatch(window, lambda: now[0], lambda: now[1])
    for rows, now[0], now[1] in ((100, 10.0, 9.0), (200, 11.0, 9.0), (300, 12.0, 9.08)):
        watch.mark(rows)
    assert (watch.waited_share(), watch.is_starved()) == (pytest.approx(share), starved)


def test_waited_s__system_that_does_not_count__is_not_a_number(tmp_path: Path) -> None:
    assert math.isnan(waited_s(tmp_path / "missing"))
    (tmp_path / "empty").write_text("")
    assert math.isnan(waited_s(tmp_path / "empty"))
