"""Ctrl-C while the program loads, on real processes: one line and status 130 as soon as its first line has run."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tactuator.io.shipped import EXAMPLES

PROGRAM = Path(sys.executable).parent / "tactuator"
DISPLAY = EXAMPLES / "displays" / "tactuator.toml"
OURS = "tactuator/cli"
"""What the path of each module holds that is imported once the handler stands."""
INTERRUPTED = (130, "tactuator: interrupted\n")
AT_WORK = (130, "tactuator: interrupted; written: nothing\n")

LOADING = """
import os, signal, sys, weakref
class Held:
    pass
def at_once():
    os.kill(os.getpid(), signal.SIGINT)
def in_a_callback():
    held = Held()
    kept = weakref.ref(held, lambda gone: (os.kill(os.getpid(), signal.SIGINT), sum(range(9))))
    del held
def turned_by_a_library():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt as error:
        raise OSError("a library's own words") from error
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            {how}()
sys.meta_path.insert(0, Finder())
sys.argv = ["tactuator", "design", "missing.toml", "--out", "c.json"]
exec(open({program!r}).read())
"""
"""The installed program with a Ctrl-C as a module is looked for."""


@pytest.mark.parametrize(
    ("module", "how"),
    [
        ("tactuator.cli", "at_once"),
        ("typing", "in_a_callback"),
        ("typer", "in_a_callback"),
        ("tactuator.cli.commands", "at_once"),
        ("tactuator.verbs.controller", "turned_by_a_library"),
    ],
)
def test_program__ctrl_c_as_a_module_loads__one_line_and_130(module, how):
    script = LOADING.format(module=module, how=how, program=str(PROGRAM))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == INTERRUPTED


def test_program__ctrl_c_at_any_moment_of_its_start__one_line_and_130(tmp_path):
    draws = random.Random(21)
    moments = [(number + draws.random()) / 7 * 0.3 for number in range(7)]
    seen = [interrupted(tmp_path, after_s) for after_s in [*moments, 0.8]]
    for ended in seen:
        if ended not in (INTERRUPTED, AT_WORK):  # Python's own end, before a line of ours
            assert OURS not in ended[1]
            assert "tactuator:" not in ended[1]
    assert {INTERRUPTED, AT_WORK} & set(seen)


def interrupted(folder: Path, after_s: float) -> tuple[int, str]:
    """Return the status of a `design` that gets a Ctrl-C so long after it was started, and what it said."""
    command = [PROGRAM, "design", DISPLAY, "--out", folder / "controller.json"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    return process.returncode, said
