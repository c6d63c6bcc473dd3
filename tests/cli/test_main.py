"""The promises of the command line, on a verb made for the purpose; a Ctrl-C while it loads."""

import random
import signal
import subprocess
import sys
import time
import types
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import pytest
import typer

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.io.shipped import EXAMPLES
from tactuator.verbs import table
from tactuator.verbs.parameters import Option

PROGRAM = Path(sys.executable).parent / "tactuator"


@pytest.fixture
def trial(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], None]], None]:

    def make(action: Callable[[], None]) -> None:
        module = types.ModuleType("tactuator.trial")

        def trial(
            rate_hz: Annotated[float, Option("Of the trial.")] = 1.0,
            file: Annotated[Path | None, Option("File to write.", writes=True)] = None,
        ) -> None:
            """Try."""
            action()

        module.trial = trial
        monkeypatch.setitem(sys.modules, "tactuator.trial", module)
        monkeypatch.setattr(table, "FUNCTIONS", {"trial": "trial:trial"})
        monkeypatch.setattr("tactuator.cli.commands.FUNCTIONS", table.FUNCTIONS)
        monkeypatch.setattr("tactuator.cli.commands.sentence_of", lambda place: "Try.")

    return make


def test_main__version_no_arguments_or_no_part__are_told(run):
    assert run("--version") == (0, f"tactuator {__version__}\n", "")
    assert "\n  design " in run().out
    run.refused("firmware", said="firmware: no part of it is named; allowed: program, verify, stream")


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (None, 0, ""),
        (typer.Exit(1), 1, ""),
        (BadInput("got this,\n  allowed is that"), 2, "tactuator: got this, allowed is that\n"),
        (OSError(), 2, "tactuator: OSError\n"),
        (FileNotFoundError(2, "No such file", "out.txt"), 2, "tactuator: out.txt: No such file\n"),
        (KeyboardInterrupt(), 130, "tactuator: interrupted\n"),
    ],
    ids=["well", "verdict no", "bad input, two lines", "nameless", "unwritable", "Ctrl-C"],
)
def test_main__however_a_verb_ends__has_its_status_and_one_line(error, status, said, trial, run):
    def action() -> None:
        if error is not None:
            raise error

    trial(action)
    assert run("trial") == (status, "", said)


def test_main__own_fault__shows_the_traceback_and_is_no_verdict(trial, run):
    trial(lambda: 1 // 0)
    ended = run("trial")
    assert ended.status == 70
    assert "Traceback" in ended.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("train", "; there are trial"),
        ("trail", "'trail' (did you mean 'trial'?)"),
        ("--loud", "--loud (`tactuator --help` tells"),
        ("trial --loud", "--loud (`tactuator trial --help` tells"),
        ("trial --rate-hz fast", "valid number, unable to parse string as a number (got 'fast')"),
        ("trial surplus", "(surplus) (`tactuator trial --help` tells what it takes"),
    ],
)
def test_main__misused__exits_2_with_one_line(arguments, words, trial, run):
    trial(lambda: None)
    run.refused(*arguments.split(), said=words)


def test_main__interrupted_in_a_verb_that_writes__says_what_was_written(trial, run, tmp_path):
    new, old = tmp_path / "new.csv", tmp_path / "old.csv"
    old.write_text("0")

    def action() -> None:
        new.write_text("1")
        raise KeyboardInterrupt

    trial(action)
    for out, said in ((new, new), (old, "nothing")):
        assert run("trial", "--file", str(out)) == (130, "", f"tactuator: interrupted; written: {said}\n")


VERB = """
import os, signal, sys, time, types, weakref
from importlib import import_module
program = import_module("tactuator.cli.main")
def trial():
    {body}
module = types.ModuleType("tactuator.trial")
module.trial = trial
sys.modules["tactuator.trial"] = module
import_module("tactuator.verbs.table").FUNCTIONS["trial"] = "trial:trial"
sys.argv = ["tactuator", "trial"]
sys.exit(program.main())
"""
CLEANING = """
    try:
        open({path!r}, "w").close()
        print("ready", flush=True)
        time.sleep(60)
    finally:
        os.unlink({path!r})
"""


@pytest.mark.parametrize(
    ("number", "status", "said"), [(signal.SIGINT, 130, b"tactuator: interrupted\n"), (signal.SIGTERM, 143, b"")]
)
def test_main__stopped_by_a_signal__cleans_up_and_says_so(number, status, said, tmp_path):
    half = tmp_path / "half-written"
    script = VERB.replace("{body}", CLEANING.format(path=str(half)).strip())
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (status, said)
    assert not half.exists()


def test_program__installed_reader_gone__ends_without_a_word():
    with subprocess.Popen([PROGRAM, "--version"], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        err = process.stderr.read()
    assert err == b""


ENDED = """
import os, signal, sys
from tactuator.cli import main
sys.argv = ["tactuator", "--version"]
status = main()
os.kill(os.getpid(), signal.SIGINT)
sys.exit(status)
"""
SWALLOWED = """
    class Held:
        pass
    held = Held()
    kept = weakref.ref(held, lambda gone: (os.kill(os.getpid(), signal.SIGINT), time.sleep(0.001)))
    del held
    time.sleep(30)
"""


@pytest.mark.parametrize(
    ("script", "status", "said"),
    [(VERB.replace("{body}", SWALLOWED.strip()), 130, "tactuator: interrupted\n"), (ENDED, 0, "")],
    ids=["in a callback", "ended"],
)
def test_program__ctrl_c_where_no_verb_can_take_it__leaves_no_traceback(script, status, said):
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (status, said)


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
    command = [PROGRAM, "design", DISPLAY, "--out", folder / "controller.json"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    return process.returncode, said
