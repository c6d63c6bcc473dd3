"""The promises of the command line, on a verb made for the purpose."""

import signal
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import pytest
import typer

from tactuator import __version__
from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.verbs import table
from tactuator.verbs.parameters import Option


@pytest.fixture
def trial(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], None]], None]:
    """Make `tactuator trial` do what is given."""

    def make(action: Callable[[], None]) -> None:
        module = types.ModuleType("tactuator.trial")

        def trial(rate_hz: Annotated[float, Option("Of the trial.")] = 1.0) -> None:
            """Try."""
            action()

        module.trial = trial
        monkeypatch.setitem(sys.modules, "tactuator.trial", module)
        monkeypatch.setattr(table, "FUNCTIONS", {"trial": "trial:trial"})
        monkeypatch.setattr("tactuator.cli.commands.FUNCTIONS", table.FUNCTIONS)
        monkeypatch.setattr("tactuator.cli.commands.sentence_of", lambda place: "Try.")

    return make


def failing(error: BaseException) -> Callable[[], None]:
    def action() -> None:
        raise error

    return action


def test_main__version__is_told(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"tactuator {__version__}\n"


def test_main__no_arguments__shows_the_verbs(capsys):
    assert main([]) == 0
    assert "\n  design " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (None, 0, ""),
        (typer.Exit(1), 1, ""),
        (BadInput("got this,\n  allowed is that"), 2, "tactuator: got this, allowed is that\n"),
        (OSError(), 2, "tactuator: OSError\n"),
        (KeyboardInterrupt(), 130, "tactuator: interrupted\n"),
    ],
    ids=["well", "verdict no", "bad input, two lines", "nameless", "Ctrl-C"],
)
def test_main__however_a_verb_ends__has_its_status_and_one_line(error, status, said, trial, capsys):
    trial((lambda: None) if error is None else failing(error))
    assert main(["trial"]) == status
    assert capsys.readouterr() == ("", said)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["train"], ["'train'", "there are trial"]),
        (["trail"], ["'trail'", "did you mean 'trial'?"]),
        (["--loud"], ["--loud", "`tactuator --help` tells"]),
        (["trial", "--loud"], ["--loud", "`tactuator trial --help` tells"]),
        (["trial", "--rate-hz", "fast"], ["'fast'", "--rate-hz"]),
        (["trial", "surplus"], ["surplus", "`tactuator trial --help` tells what it takes"]),
    ],
)
def test_main__misused__exits_2_with_one_line(arguments, words, trial, capsys):
    trial(lambda: None)
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert all(word in err for word in words)


def test_main__unwritable_output__exits_2_and_names_the_file(trial, capsys, tmp_path):
    target = tmp_path / "missing" / "out.txt"
    trial(lambda: target.write_text("x"))
    assert main(["trial"]) == 2
    assert capsys.readouterr().err == f"tactuator: {target}: No such file or directory\n"


def test_main__verb_with_parts_and_none_named__is_told_them_in_one_line(capsys):
    assert main(["firmware"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("tactuator: firmware: no part of it is named; allowed: program, verify, stream")


def test_main__own_fault__shows_the_traceback_and_is_no_verdict(trial, capsys):
    trial(failing(ZeroDivisionError("a fault")))
    assert main(["trial"]) == 70
    assert "Traceback" in capsys.readouterr().err


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


@pytest.mark.parametrize(
    ("number", "status", "said"), [(signal.SIGINT, 130, "tactuator: interrupted\n"), (signal.SIGTERM, 143, "")]
)
def test_main__stopped_by_a_signal__cleans_up_and_says_so(number, status, said, tmp_path):
    left = tmp_path / "half-written"
    body = f"""
    try:
        open({str(left)!r}, "w").close()
        print("ready", flush=True)
        time.sleep(60)
    finally:
        os.unlink({str(left)!r})
"""
    script = VERB.replace("{body}", body.strip())
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert process.returncode == status
    assert err.decode() == said
    assert not left.exists()


def test_main__reader_gone__ends_without_a_word(tmp_path):
    script = "import sys; from tactuator.cli import main; sys.exit(main())"
    with subprocess.Popen(
        [sys.executable, "-c", script, "--version"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.close()
        err = process.stderr.read()
    assert err == b""


def test_program__installed__is_on_the_path():
    program = Path(sys.executable).parent / "tactuator"
    done = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"tactuator {__version__}\n"


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
