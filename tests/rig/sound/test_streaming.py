"""The streaming of the soak: that its echo would tell a gap of which nobody told."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.rig.sound.streaming import BLOCK, COUNT, Echo, noise

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
def test_streaming__an_hour_of_three_channels__no_gap_unnoticed_flat_memory_a_tenth_of_a_core():
    asked = [sys.executable, "-m", "tests.rig.sound.streaming", "3600", "12"]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, timeout=4500, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    *minutes, last = [json.loads(line) for line in done.stdout.splitlines()]
    assert last["told"] == last["provoked"] == 12
    assert last["untold"] == 0
    assert last["mb"] < minutes[2]["mb"] + 20.0
    assert last["core_share"] <= 0.1
