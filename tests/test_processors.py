"""Helper processes, which end with their starter; BLAS of one thread, for as long as anybody computes."""

import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from tactuator.processors import begin_helper, single_threaded

STARTER = """
import sys, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from tactuator.processors import begin_helper

if __name__ == "__main__":
    begun = begin_helper if sys.argv[2] == "begun" else None
    pool = ProcessPoolExecutor(2, get_context(sys.argv[1]), initializer=begun)
    for _ in range(2):
        pool.submit(time.sleep, 3600.0)
    pool.submit(abs, 1)
    while len(pool._processes) < 2:
        time.sleep(0.01)
    print(*pool._processes, flush=True)
    time.sleep(3600.0)
"""


def still_there(folder: Path, method: str, begun: str) -> int:
    """How many helpers are there five seconds after their starter was killed; they are ended then."""
    program = folder / "starter.py"
    program.write_text(STARTER)
    command = [sys.executable, str(program), method, begun]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as starter:
        assert starter.stdout is not None
        helpers = [psutil.Process(int(number)) for number in starter.stdout.readline().split()]
        starter.kill()
    assert len(helpers) == 2
    _, alive = psutil.wait_procs(helpers, timeout=5.0 if begun == "begun" else 1.0)
    for helper in alive:
        helper.kill()
    return len(alive)


@pytest.mark.parametrize(
    ("method", "begun", "count"), [("spawn", "begun", 0), ("forkserver", "begun", 0), ("spawn", "not", 2)]
)
def test_helpers__their_starter_killed__end_and_would_not_by_themselves(tmp_path, method, begun, count) -> None:
    assert still_there(tmp_path, method, begun) == count


def test_pools__of_this_package__begin_their_helpers_so() -> None:
    source = Path(begin_helper.__code__.co_filename).parent
    pools = [path for path in source.rglob("*.py") if "ProcessPoolExecutor(" in path.read_text()]
    assert len(pools) >= 2
    assert all("initializer=begin_helper" in path.read_text() for path in pools)


def threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_single_threaded__first_ends_while_second_works__stays_until_the_second_ends() -> None:
    with threadpool_limits(limits=2):
        first, second = single_threaded(), single_threaded()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert threads() == {1}
        second.__exit__(None, None, None)
        assert threads() == {2}
