"""Processor time of works that are done in turn, so that whatever else the machine does disturbs all of them."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

Work = Callable[[], Any]


def in_turn(works: Mapping[str, Work], turns: int = 3) -> dict[str, float]:
    """Return the least processor seconds of each work over the turns: A, B, A, B, and so on."""
    spent: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(turns):
        for name, work in works.items():
            begun = time.process_time()
            work()
            spent[name].append(time.process_time() - begun)
    return {name: min(each) for name, each in spent.items()}


_MEASURED = """
import os, subprocess, sys, time
begun = time.perf_counter()
with subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
elapsed = time.perf_counter() - begun
print(process.returncode, used.ru_utime + used.ru_stime, elapsed, used.ru_maxrss / 1024.0)
"""


def of_program(command: Sequence[str], ends: Sequence[int] = (0, 1)) -> tuple[float, float, float]:
    """Return processor seconds, elapsed seconds and peak memory (MB) of a program. Raises where it ends with no status
    of `ends`.

    A small process starts it: a program's peak begins with the memory of whoever started it.
    """
    told = subprocess.run([sys.executable, "-c", _MEASURED, *command], capture_output=True, text=True, check=True)
    status, cpu_s, elapsed_s, peak_mb = (float(part) for part in told.stdout.split())
    if status not in ends:
        raise RuntimeError(f"{' '.join(command)} ended with {status:g}")
    return cpu_s, elapsed_s, peak_mb
