"""The host's own waiting, counted by the system, told from work and from sleep."""

import math
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tactuator.rig.board_check.streaming_check import HostWatch, waited_s


def watched(marks: list[tuple[int, float, float]], window: int) -> HostWatch:
    """A watch that has seen rows at moments, with so much waiting before each; its clocks stand at the last."""
    now = [0.0, 0.0]
    watch = HostWatch(window, lambda: now[0], lambda: now[1])
    for rows, clock_s, had_waited_s in marks:
        now[:] = clock_s, had_waited_s
        watch.mark(rows)
    return watch


def test_waited_share__waiting_before_the_window__does_not_count() -> None:
    marks = [(100, 10.0, 9.0), (200, 11.0, 9.0), (300, 12.0, 9.1)]
    assert watched(marks, window=200).waited_share() == pytest.approx(0.05)
    assert watched(marks, window=301).waited_share() == pytest.approx(9.1 / 12.0)


def test_waited_share__no_time_has_passed__is_nothing() -> None:
    assert watched([], window=10).waited_share() == 0.0


@pytest.mark.parametrize(
    ("share", "starved"), [(0.0, False), (0.04, False), (0.05, True), (1.0, True), (math.nan, True)]
)
def test_is_starved__share_of_waiting__decides(share: float, starved: bool) -> None:
    assert watched([(100, 1.0, share)], window=200).is_starved() is starved


def test_waited_s__system_that_does_not_count__is_not_a_number(tmp_path: Path) -> None:
    assert math.isnan(waited_s(tmp_path / "missing"))
    (tmp_path / "empty").write_text("")
    assert math.isnan(waited_s(tmp_path / "empty"))


@pytest.mark.skipif(math.isnan(waited_s()), reason="the system does not count how long a thread waits")
def test_waited_s__processor_shared_with_another_program__grows() -> None:
    mine = os.sched_getaffinity(0)
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as other:
        try:
            for process in (0, other.pid):
                os.sched_setaffinity(process, {min(mine)})
            before_s, begun_s = waited_s(), time.process_time()
            while time.process_time() < begun_s + 0.1:
                pass
            assert waited_s() > before_s
        finally:
            os.sched_setaffinity(0, mine)
            other.kill()
