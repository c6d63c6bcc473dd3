"""Helper processes, which end with their starter; BLAS of one thread, for as long as anybody computes."""

import subprocess
import sys
from pathlib import Path

import psutil
from threadpoolctl import threadpool_info, threadpool_limits

from tactuator.processors import single_threaded

STARTER = """
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from tactuator.processors import begin_helper

if __name__ == "__main__":
    pool = ProcessPoolExecutor(1, get_context("spawn"), initializer=begin_helper)
    pool.submit(time.sleep, 3600.0)
    while len(pool._processes) < 1:
        time.sleep(0.01)
    print(*pool._processes, flush=True)
    time.sleep(3600.0)
"""


def test_helper__its_starter_killed__ends(tmp_path: Path) -> None:
    (tmp_path / "starter.py").write_text(STARTER)
    command = [sys.executable, str(tmp_path / "starter.py")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as starter:
        assert starter.stdout is not None
        helper = psutil.Process(int(starter.stdout.readline()))
        starter.kill()
    helper.wait(timeout=600.0)  # of the hour that it would sleep


def threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_single_threaded__first_ends_while_second_works__stays() -> None:
    with threadpool_limits(limits=2):
        first, second = single_threaded(), single_threaded()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert threads() == {1}
        second.__exit__(None, None, None)
        assert threads() == {2}
