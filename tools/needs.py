"""What the set-up needs from the system, looked at before anything is done."""

import errno
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

from tools import stamps

#: MB that `.venv` grows to with the test set (the runtime set is half of it); measured with Python 3.11 on Linux.
ROOM_MB = {"run": 450, "test": 850, "site": 950}
FULL = (errno.ENOSPC, errno.EDQUOT)


def say(text):
    """Tell the person at the terminal what is being done."""
    print("install: " + text, file=sys.stderr, flush=True)


def check():
    """Refuse in one line when venv, the headers or a working compiler are missing, all of them named."""
    wanted = []
    if any(importlib.util.find_spec(module) is None for module in ("venv", "ensurepip")):
        wanted.append(("Python's venv module with pip", "python3-venv"))
    if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        wanted.append(("Python's C headers (Python.h)", "python3-dev"))
    compiler = compiler_command()
    if shutil.which(compiler[0]) is None:
        wanted.append(("a C compiler (no %r is to be found; CC names another)" % compiler[0], "gcc"))
    if wanted:
        sys.exit(
            "missing for Python %d.%d (%s): %s. On Debian and Ubuntu: apt-get install %s"
            % (
                *sys.version_info[:2],
                sys.executable,
                "; ".join(what for what, _ in wanted),
                " ".join(package for _, package in wanted),
            )
        )
    check_compiler(compiler)


def compiler_command():
    """Return the words of the compiler's command: CC, or the one that Python was built with, or cc."""
    return shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc") or ["cc"]


def check_compiler(compiler):
    """Refuse in one line when the compiler cannot make a program that knows Python's headers."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "try.c"
        source.write_text("#include <Python.h>\n#include <math.h>\nint main(void) { return 0; }\n")
        command = [*compiler, "-I", sysconfig.get_path("include"), str(source), "-o", str(Path(folder) / "try")]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
            said = (done.stderr or done.stdout).strip()
        except OSError as error:
            done, said = None, str(error)
    if done is None or done.returncode != 0:
        lines = [line for line in said.splitlines() if "error" in line] or said.splitlines() or ["it says nothing"]
        sys.exit(
            "the C compiler %r cannot build a program: %s. On Debian and Ubuntu: apt-get install gcc libc6-dev "
            "python3-dev" % (" ".join(compiler), lines[0].strip())
        )


def check_room(which):
    """Refuse in one line when the disk has no room for `.venv`."""
    place = stamps.VENV if stamps.VENV.is_dir() else stamps.ROOT
    free = shutil.disk_usage(place).free // 10**6
    if free < ROOM_MB[which]:
        sys.exit(
            "no room for .venv: it needs about %d MB, and the disk of %s has %d MB free" % (ROOM_MB[which], place, free)
        )


def no_room():
    """Return one line for a disk that filled up on the way."""
    places = {str(stamps.ROOT): "", tempfile.gettempdir(): " (TMPDIR names another)"}
    free = ["%s %d MB%s" % (place, shutil.disk_usage(place).free // 10**6, more) for place, more in places.items()]
    return "no room left on the disk; free now: " + ", ".join(free)


def reason(error):
    """Return one line for an OSError."""
    return no_room() if error.errno in FULL else " ".join(str(error).split())
