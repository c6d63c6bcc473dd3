"""Make `.venv` what the lock files and the sources say: `python3 tools/install.py run|test|site`.

With `boards`, `tests` or `slow` it installs what is missing from the system, by apt as root. Nothing is done when
nothing changed; a file lock lets one run at a time do the work. What goes wrong is told in one line, and the next run
starts clean. The syntax of this file stays old: a Python too old must get as far as being told so.
"""

import sys

if sys.version_info < (3, 11):
    sys.exit(
        "tactuator needs Python 3.11 or later; %s is %d.%d: give another with `make PYTHON=python3.11 ...`"
        % (sys.executable, sys.version_info[0], sys.version_info[1])
    )

import fcntl
import hashlib
import importlib.util
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV, SETUP, STAMP, BUILD = (ROOT / name for name in (".venv", ".setup", ".venv/packages.stamp", ".venv/build.stamp"))
PYTHON = VENV / "bin" / "python"
PIP = [PYTHON, "-m", "pip", "install", "-q", "--no-input", "--no-compile", "--disable-pip-version-check"]
COMPILE = [PYTHON, "-m", "compileall", "-q", "-j", "0"]  # on all processors
HERE = [sys.version, os.path.realpath(sys.base_prefix), str(ROOT)]
SETS = ("run", "test", "site")  # each holds the one before it, at the same versions
LOCKS = {name: ROOT / "requirements" / (name + ".txt") for name in SETS}
ROOM_MB = {"run": 450, "test": 850, "site": 950}  # measured with Python 3.11 on Linux
PURPOSES = ("boards", "tests", "slow")
UNREACHED = r"(\w*(?:Connection|Timeout|Retry|Resolution|Proxy|SSL|Protocol)Error|not a trusted or secure host)"
FAILURES = {  # what pip says: what is said here; the first that fits
    r"No space left on device|Disk quota exceeded": "no room left on the disk",
    r"DO NOT MATCH THE HASHES.*?\n\s*(\S+)": "a file for {0} is not the one whose hash the lock holds",
    UNREACHED: "the package index cannot be reached ({0}): see to the network, or to `pip config list`",
    r"No matching distribution found for ([^\s;]+)": "the package index offers no file of {0} for Python {1} on {2}",
}


def say(text):
    """Tell the person at the terminal what is being done."""
    sys.stderr.write("install: " + text + "\n")


def run(command, what):
    """Run a command; in one line why it failed, with all that it said in .setup/failed.log."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    done = subprocess.run(command, cwd=ROOT, check=False, text=True, errors="replace", **pipes)
    if not done.returncode:
        return
    if not STAMP.exists():  # `.venv` is half made: its room is given back
        shutil.rmtree(VENV, ignore_errors=True)
    said = done.stdout
    (SETUP / "failed.log").write_text(said)
    lines = [line for line in said.splitlines() if line.strip()] or ["nothing was said"]
    reason = next((line for line in reversed(lines) if "error" in line.lower()), lines[-1])
    for pattern, sentence in reversed(FAILURES.items()):
        match = re.search(pattern, said, flags=re.DOTALL)
        reason = sentence.format(*match.groups(), platform.python_version(), platform.machine()) if match else reason
    sys.exit("%s: %s (all that was said: .setup/failed.log)" % (what, " ".join(reason.split())))


def check_system(which):
    """Refuse in one line when venv, the headers, a working compiler or room on the disk are missing."""
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc") or ["cc"]
    lacks = {
        "python3-venv": any(importlib.util.find_spec(module) is None for module in ("venv", "ensurepip")),
        "python3-dev": not (Path(sysconfig.get_path("include")) / "Python.h").exists(),
        "gcc": shutil.which(compiler[0]) is None,
    }
    if any(lacks.values()):
        needs = "%s needs venv with pip, Python.h and a C compiler (%r; CC names another); missing on Debian: %s"
        sys.exit(needs % (sys.executable, compiler[0], " ".join(name for name in lacks if lacks[name])))
    (SETUP / "try.c").write_text("#include <Python.h>\n#include <math.h>\nint main(void) { return 0; }\n")
    command = [*compiler, "-I", sysconfig.get_path("include"), SETUP / "try.c", "-o", SETUP / "try"]
    run(command, "the C compiler %r cannot build a program (apt-get install gcc libc6-dev)" % " ".join(compiler))
    free = shutil.disk_usage(ROOT).free // 10**6
    if not VENV.is_dir() and free < ROOM_MB[which]:
        sys.exit("no room for .venv: it needs about %d MB, and the disk has %d MB free" % (ROOM_MB[which], free))


def file_hash(*files):
    """Return one hash of files, their names and the interpreter."""
    digest = hashlib.sha256(sys.version.encode())
    for file in files:
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def sources():
    """Return every file that the build of the package reads, in a fixed order."""
    named = [ROOT / "pyproject.toml", ROOT / "setup.py", *(ROOT / "src").rglob("_core_build.py")]
    return sorted([*named, *(path for path in (ROOT / "core").rglob("*.[chi]*") if path.is_file())])


def plan(which, stamp):
    """Return the set to install, and whether into an empty `.venv`; (None, False) where nothing is to be done.

    A lock that changed, another interpreter or place, and a set that was broken off mean an empty `.venv`.
    """
    held = stamp.get("locks", {}) if stamp.get("here") == HERE and PYTHON.exists() else {}
    current = [name for name in held if held[name] == file_hash(LOCKS[name])]
    if all(name in current for name in SETS[: SETS.index(which) + 1]):
        return None, False
    return max([which, *held], key=SETS.index), not held or current != list(held)


def read_stamp():
    """Return what `.venv` was made from; nothing where it is not wholly there."""
    try:
        return json.loads(STAMP.read_text())
    except (OSError, ValueError):
        return {}


def write_stamp(**locks):
    """Record the lock of every set that `.venv` holds."""
    STAMP.write_text(json.dumps({"here": HERE, "locks": locks}))


def packages(which, empty):
    """Install a set with pip, every file by its hash and none compiled from its source."""
    what = "the packages of requirements/%s.txt could not be installed" % which
    if empty:
        say("making .venv with Python %d.%d" % sys.version_info[:2])
        shutil.rmtree(VENV, ignore_errors=True)
        run([os.path.realpath(sys.executable), "-m", "venv", VENV], "Python's venv module cannot make .venv")
    else:
        write_stamp(**read_stamp()["locks"], **{which: "begun"})
    say("installing the %s set, some minutes on a slow line" % which)
    run([*PIP, "--only-binary=:all:", "--require-hashes", "-r", LOCKS[which]], what)
    run([*COMPILE, "-x", "/tests?/", *VENV.glob("lib/python3*/site-packages")], what)
    for name in re.findall(r"^([\w.-]+)", (ROOT / "requirements/run.in").read_text(), flags=re.MULTILINE):
        broken = "%s is installed and cannot be imported; remedy: `make clean`, then the same again" % name
        run([PYTHON, "-c", "import " + re.sub("[-.]", "_", name.lower())], broken)
    write_stamp(**{name: file_hash(LOCKS[name]) for name in SETS[: SETS.index(which) + 1]})


def build():
    """Build the package in place with its C core, and import it."""
    say("building the C core")
    core = next((ROOT / "src").rglob("_core_build.py")).relative_to(ROOT / "src").parent
    run([*PIP, "--no-build-isolation", "--no-deps", "--no-index", "-e", ROOT], "the build failed")
    run([PYTHON, "-c", "import %s._core" % ".".join(core.parts)], "the build failed")
    run([*COMPILE, ROOT / "src"], "the build failed")
    BUILD.write_text(file_hash(*sources()))


def system(purpose):
    """Install what requirements/system.txt lists for a purpose and the system lacks, as root, or name it."""
    lines = [line.split() for line in (ROOT / "requirements" / "system.txt").read_text().splitlines()]

    def missing():
        wanted = [(name, package) for name, package, *purposes in lines[1:] if purpose in purposes]
        return sorted({package for name, package in wanted if not (Path(name).exists() or shutil.which(name))})

    if missing() and (os.geteuid() or not shutil.which("apt-get")):
        sys.exit("needed from the system: apt-get install " + " ".join(missing()))
    if missing():
        say("apt-get install " + " ".join(missing()))
        os.environ["DEBIAN_FRONTEND"] = "noninteractive"
        subprocess.run(["apt-get", "-qq", "update"], stdout=subprocess.DEVNULL, check=False)
        run(["apt-get", "-qq", "install", "-y", "--no-install-recommends", *missing()], "apt-get could not install")


def main():
    """Do what is needed, one run at a time."""
    what = sys.argv[1] if len(sys.argv) == 2 else ""
    if what not in SETS + PURPOSES:
        sys.exit("usage: python3 tools/install.py run|test|site, or boards|tests|slow for the system's packages")
    SETUP.mkdir(exist_ok=True)
    with (SETUP / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if what in PURPOSES:
            system(what)
            return
        wanted, empty = plan(what, read_stamp())
        due = not BUILD.exists() or BUILD.read_text() != file_hash(*sources())
        if wanted or due:
            check_system(what)
            if wanted:
                packages(wanted, empty)
            build()
            if what == "run" and sys.stderr.isatty():
                say("done; next: `. .venv/bin/activate`, then `tactuator`")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)
    except OSError as error:
        sys.exit("the set-up could not go on: " + " ".join(str(error).split()))
