"""Run a page: its commands and its Python, in order, in one folder, as a reader would who types them."""

import contextlib
import fcntl
import io
import math
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from tactuator.cli import output
from tactuator.cli.main import main
from tools.pages.blocks import commands, read_page, session

#: What only a shell understands; a command without it is run in this process, which saves its imports.
SHELL = re.compile(r"[|<>&;$*`]")
NUMBER = re.compile(r"(\d+(?:\.\d+)?)")
ENVIRONMENT = {"BROWSER": "true", "COLUMNS": "120", "MPLBACKEND": "Agg", "OPENBLAS_NUM_THREADS": "1"}
SERVER_S = 60.0
ONE_SERVER = Path(tempfile.gettempdir()) / "tactuator-page-server.lock"


class PageFault(Exception):
    """A block of a page did not do what the page says."""


@dataclass(frozen=True)
class Said:
    """What one command, or one Python block, printed, and where in its page it ends."""

    command: str
    output: str
    end: int


def make_folder(folder):
    """Make the folder that every page begins in: the examples, as a reader gets them."""
    status, output = _in_process(["init", "--examples", str(folder)])
    if status != 0:
        raise PageFault(f"tactuator init --examples: {output}")


def run_page(text, name, folder):
    """Run every block of a page that is to be run, and return what each said; raise PageFault at the first fault."""
    said, names = [], {"__name__": "__main__"}
    blocks, figures, _ = read_page(text)
    with contextlib.chdir(folder), _environment():
        for block in blocks:
            place = f"{name}:{block.line}"
            if "file" in block.marks:
                Path(block.marks["file"]).write_text(block.text, encoding="utf-8")
            elif block.runs and block.language == "python":
                said.append(Said("", _python(block, place, names), block.end))
            elif block.runs:
                said += [Said(*each, block.end) for each in _shell(block, place)]
        for figure in figures:
            if not Path(figure.path).is_file():
                raise PageFault(f"{name}:{figure.line}: no file {figure.path} to show: the page wrote none")
    return said


@contextlib.contextmanager
def _environment():
    before = os.environ.copy()
    os.environ.update(ENVIRONMENT, PATH=f"{Path(sys.executable).parent}{os.pathsep}{before.get('PATH', '')}")
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _python(block, place, names):
    """Run a Python block with the names of those before it, and return what it printed."""
    out = io.StringIO()
    source = "\n" * block.line + block.text  # so that a traceback tells lines of the page
    try:
        with contextlib.redirect_stdout(out):
            exec(compile(source, place, "exec"), names)
    except Exception as error:
        raise PageFault(f"{place}: {''.join(traceback.format_exception(error, limit=-3))}") from None
    return out.getvalue()


def _shell(block, place):
    """Run the commands of a block, and yield each with what it printed."""
    lines = session(block.text) if block.language == "console" else [(line, []) for line in commands(block.text)]
    for number, (line, shown) in enumerate(lines):
        last = number == len(lines) - 1
        asked = int(block.marks["exit"]) if "exit" in block.marks and last else 0
        words = shlex.split(line, comments=True)
        if words[0] == "cd":
            os.chdir(words[1])
            status, output = 0, ""
        elif "serves" in block.marks and last:
            status, output = _served(line)
        elif words[0] == "tactuator" and not SHELL.search(line.partition(" #")[0]):
            status, output = _in_process(words[1:])
        else:
            status, output = _by_bash(line)
        if status != asked:
            raise PageFault(f"{place}: {line}\nended with status {status}, not {asked}:\n{output[-2000:]}")
        if missing := [text for text in shown if not any(_alike(text, printed) for printed in output.splitlines())]:
            raise PageFault(f"{place}: {line}\ndid not print {missing[0]!r}:\n{output[-2000:]}")
        yield line, output


def _alike(shown, printed):
    """Return True for the same words with numbers within 2 %: the last digit may differ between processors."""
    words, others = (re.split(NUMBER, " ".join(line.split())) for line in (shown, printed))
    pairs = zip(words[1::2], others[1::2], strict=False)
    return words[::2] == others[::2] and all(math.isclose(float(a), float(b), rel_tol=0.02) for a, b in pairs)


def _in_process(words):
    """Run a command of tactuator here, and return its status and all that it printed, whatever the machine's speed."""
    out = io.StringIO()
    with patch.object(output, "EVERY_S", 3600.0), contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        status = main(words)
    return status, out.getvalue()


def _by_bash(line):
    done = subprocess.run(
        ["bash", "-c", line], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    return done.returncode, done.stdout


def _served(line):
    """Start a server, wait until it tells its address, interrupt it; its status is 0 if that was all.

    One at a time on a machine: the server of a page takes the port that a reader's does.
    """
    with ONE_SERVER.open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        with subprocess.Popen(
            ["bash", "-c", f"exec {line}"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as server:
            output, until = "", time.monotonic() + SERVER_S
            for text in server.stdout:
                output += text
                if "http://" in text or time.monotonic() > until:
                    break
            server.send_signal(signal.SIGINT)
            output += server.communicate(timeout=SERVER_S)[0]
    told = "http://" in output and server.returncode in (0, 130)
    return (0 if told else server.returncode or 1), output
