"""Streaming at 48 kHz through wires: what comes back is what was put out, bit by bit, or a gap was told.

`python -m tests.rig.sound.test_streaming SECONDS PROVOKED CHANNELS` prints JSON lines.
"""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tactuator.model.controller import Controller, Limits
from tests.rig.sound.simulated_card import simulated_card
from tests.rig.sound.through_portaudio import RATE_HZ, delay_of, opened
from tests.rig.sound.turned_card import flat_controller

BLOCK, COUNT, FULL_V = 2400, 3, 2.0
SECTIONS = 8
NEAR_S = 2.0
"""Rows about a gap that was told are not compared: the server plays silence, or a period anew, before and after it."""
REPORT_S, STOPPED_S = 60.0, 0.4


def controller(display) -> Controller:
    """Eight sections a channel, as many as an equaliser has: a gain of 0.01 V for a threshold unit."""
    sections = np.tile([1.0, -0.5, 0.1, 1.0, -0.5, 0.1], (SECTIONS, 1))
    sections[0, :3] *= 0.01
    return flat_controller(display, prefilter_sos=sections, limits=Limits(2.0, 2.0))


class Echo:
    """What was put out, held against what comes back `late` rows after it."""

    def __init__(self, late: int, count: int = COUNT) -> None:
        self.asked = np.zeros((late, count))
        self.rows = self.differing = self.untold = 0
        self.gap_row = -(10**9)
        self.waiting: list[tuple[int, int]] = []

    def take(self, asked: np.ndarray, heard: np.ndarray, told: bool) -> None:
        wanted = ((asked / FULL_V).astype(np.float32) * FULL_V).astype(np.float64)
        self.asked = np.concatenate([self.asked, wanted])
        due, self.asked = self.asked[: len(heard)], self.asked[len(heard) :]
        differ = int(np.sum(np.any(due != heard, axis=1)))
        self.rows += len(heard)
        self.differing += differ
        if told:
            self.gap_row = self.rows
        if differ:
            self.waiting.append((self.rows, differ))
        near = round(NEAR_S * RATE_HZ)
        while self.waiting:
            row, count = self.waiting[0]
            told_near = abs(row - self.gap_row) <= near
            if not told_near and row + near >= self.rows:
                break  # it may still be told
            self.untold += count * (not told_near)
            self.waiting.pop(0)

    def end(self) -> None:
        self.untold += sum(count for row, count in self.waiting if abs(row - self.gap_row) > NEAR_S * RATE_HZ)


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def noise(rows: int, count: int) -> Iterator[np.ndarray]:
    rng = np.random.default_rng(7)
    for _ in range(rows // BLOCK):
        yield rng.uniform(-100.0, 100.0, (BLOCK, count))


def streaming(seconds: float, provoked: int, count: int = COUNT, period: int = 4096) -> Iterator[dict[str, object]]:
    """Yield a table a minute, and one at the end."""
    rows = round(seconds * RATE_HZ)
    stops = [seconds * (k + 0.5) / provoked for k in range(provoked)]
    done = told = 0
    with simulated_card([None] * count, period=period) as card, opened(count, lead_s=1.0) as rig:
        rig.load(controller(rig.display))
        rig.allow_gaps = True
        first = rig.drive(np.random.default_rng(1).uniform(-1.0, 1.0, (48000, count)))
        late = delay_of(first.command_v[:, 0], first.position_v[:, 0])
        echo, next_report, gaps = Echo(late, count), 0.0, 0
        began, used = time.monotonic(), time.process_time()
        try:
            for trace in rig.stream(noise(rows, count)):
                now = echo.rows / RATE_HZ
                more = rig._rows.gaps - gaps
                gaps += more
                told += more > 0
                echo.take(trace.command_v, trace.position_v, more > 0)
                if stops and now > stops[0]:
                    stops.pop(0)
                    os.kill(card.client.pid, signal.SIGSTOP)
                    threading.Timer(STOPPED_S, os.kill, [card.client.pid, signal.SIGCONT]).start()
                    done += 1
                if now >= next_report:
                    next_report += REPORT_S
                    yield {"s": round(now, 1), "mb": round(resident_mb(), 1), "gaps": gaps, "provoked": done,
                           "untold": echo.untold}  # fmt: skip
        finally:
            os.kill(card.client.pid, signal.SIGCONT)
        echo.end()
        wall = time.monotonic() - began
        share = (time.process_time() - used) / wall
        yield {
            "wall_s": wall, "rows": echo.rows, "differing": echo.differing, "untold": echo.untold, "late": late,
            "provoked": done, "told": told, "gaps": gaps, "core_share": share, "mb": resident_mb(),
        }  # fmt: skip


ROOT = Path(__file__).parents[3]
LATE = 100


def echo(told_at: int | None, lost: bool) -> Echo:
    """What comes of 200 blocks, of which three rows are lost in the hundredth."""
    asked = np.concatenate(list(noise(200 * BLOCK, COUNT))) / 100.0
    wired = (asked / 2.0).astype(np.float32).astype(float) * 2.0
    heard = np.concatenate([np.zeros((LATE, COUNT)), wired])
    if lost:
        heard = np.delete(heard, slice(100 * BLOCK, 100 * BLOCK + 3), axis=0)
    made = Echo(LATE)
    for k in range(190):
        part = slice(k * BLOCK, (k + 1) * BLOCK)
        made.take(asked[part], heard[part], told_at == k)
    made.end()
    return made


def test_echo__nothing_lost__every_row_is_the_same():
    made = echo(None, lost=False)
    assert (made.differing, made.untold, made.rows) == (0, 0, 190 * BLOCK)


def test_echo__rows_lost_and_nothing_told__gone_unnoticed():
    assert echo(None, lost=True).untold > 80 * BLOCK
    assert echo(40, lost=True).untold > 80 * BLOCK


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("jackd") is None, reason="no jackd here: python3 tools/install.py slow")
def test_streaming__an_hour_of_three_channels__no_gap_unnoticed():
    asked = [sys.executable, "-m", "tests.rig.sound.test_streaming", "3600", "12"]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, timeout=4500, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    *minutes, last = [json.loads(line) for line in done.stdout.splitlines()]
    assert last["told"] == last["provoked"] == 12
    assert last["untold"] == 0
    assert last["mb"] < minutes[2]["mb"] + 20.0
    assert last["core_share"] <= 0.1


if __name__ == "__main__":
    for line in streaming(float(sys.argv[1]), int(sys.argv[2]), int((sys.argv[3:] or [COUNT])[0])):
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()
