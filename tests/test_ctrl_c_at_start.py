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

LOADING = """
import os, signal, sys, weakref
class Held:
    pass
class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r} and {swallowed}:
            held = Held()
            kept = weakref.ref(held, lambda gone: (os.kill(os.getpid(), signal.SIGINT), sum(range(9))))
            del held
        elif name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupted())
sys.argv = ["tactuator", "design", "missing.toml", "--out", "c.json"]
exec(open({program!r}).read())
"""
"""The installed program with a Ctrl-C as a module is looked for, in a callback or not."""


@pytest.mark.parametrize("swallowed", [False, True], ids=["at once", "in a callback"])
@pytest.mark.parametrize("module", ["tactuator.cli", "typing", "typer", "tactuator.cli.commands"])
def test_program__ctrl_c_as_a_module_loads__one_line_and_130(module, swallowed):
    script = LOADING.format(module=module, swallowed=swallowed, program=str(PROGRAM))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "tactuator: interrupted\n")


TURNED = """
import signal, sys
class Turned:
    def find_spec(self, name, path=None, target=None):
        if name == "tactuator.verbs.controller":
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt as error:
                raise {error}("a library's own words") from error
sys.meta_path.insert(0, Turned())
sys.argv = ["tactuator", "design", "missing.toml", "--out", "c.json"]
exec(open({program!r}).read())
"""
"""The installed program where a library turns a Ctrl-C, as one of its modules is made, into an error of its own."""


@pytest.mark.parametrize("error", ["ValueError", "OSError"])
def test_program__ctrl_c_that_a_library_turns_into_an_error__one_line_and_130(error):
    script = TURNED.format(error=error, program=str(PROGRAM))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "tactuator: interrupted\n")


def test_program__ctrl_c_at_any_moment_of_its_start__one_line_and_130(tmp_path):
    draws = random.Random(21)
    moments = [(number + draws.random()) / 12 * 0.3 for number in range(12)]
    seen = [interrupted(tmp_path, after_s) for after_s in [*moments, 0.8]]
    for status, said in seen:
        if (status, said) != (130, "tactuator: interrupted\n"):  # Python's own end, before a line of ours
            assert OURS not in said
            assert "tactuator:" not in said
    assert (130, "tactuator: interrupted\n") in seen


def interrupted(folder: Path, after_s: float) -> tuple[int, str]:
    """Return the status of a `design` that gets a Ctrl-C so long after it was started, and what it said."""
    command = [PROGRAM, "design", DISPLAY, "--out", folder / "controller.json"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    return process.returncode, said
