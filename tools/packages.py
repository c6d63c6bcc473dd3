"""The packages of a lock into `.venv`, by pip and by nothing else."""

import os
import platform
import re
import shutil
import subprocess
import sys

from tools import needs, stamps
from tools.needs import say

#: What pip says -> what is said here. The first that fits; {0} is the first group.
FAILURES = (
    (r"No space left on device|Disk quota exceeded|\[Errno (?:28|122)\]", None),
    (
        r"DO NOT MATCH THE HASHES.*?\n\s*(\S+)",
        "a file for {0} is not the one whose hash the lock holds: the package index, or what lies between, altered it",
    ),
    (
        r"((?:NewConnection|ConnectTimeout|ReadTimeout|MaxRetry|NameResolution|Proxy|SSL|Connection|Protocol)Error"
        r"|[Tt]imed out|HTTP error \d+|not a trusted or secure host)",
        "the package index cannot be reached ({0}): see to the network, or to pip's settings (`pip config list`, "
        "PIP_INDEX_URL)",
    ),
    (
        r"No matching distribution found for ([^\s;]+)",
        "the package index offers no file of {0} for Python {python} on {machine}: it is out of reach or not the right "
        "one (`pip config list`, PIP_INDEX_URL), or there is none ready-made, and another Python may do "
        "(`make PYTHON=python3.11 ...`)",
    ),
)


def install(which, how):
    """Bring one set into `.venv`: "anew", or "add" to what is there; in one line why not, and nothing half-made."""
    if how == "add":
        held = stamps.read_stamp()["locks"]
        stamps.write_packages_stamp(*held, adding=True)  # a run that is broken off keeps the set that is there
    else:
        make_venv(which)
    try:
        pip_install(which)
        check_imports()
        stamps.write_packages_stamp(*stamps.sets_within(which))
    except BaseException:
        if how == "anew":
            empty_venv()
        raise


def make_venv(which):
    """Make an empty virtual environment, or say in one line why not."""
    say("making .venv with Python %d.%d" % sys.version_info[:2])
    if os.path.lexists(stamps.VENV) and not stamps.VENV.is_dir():
        sys.exit("%s is in the way: it is not a folder; delete it or rename it" % stamps.VENV)
    empty_venv()
    needs.check_room(which)
    done = output_of([os.path.realpath(sys.executable), "-m", "venv", stamps.VENV])
    if done.returncode != 0:
        empty_venv()
        remedy = "on Debian and Ubuntu: apt-get install python3-venv"
        sys.exit(explained(done.stdout, "Python's venv module cannot make .venv (%s)" % remedy))


def empty_venv():
    """Delete all that is in `.venv`, and the folder; one that is a link to another disk stays a link."""
    if stamps.VENV.is_symlink():
        for path in stamps.VENV.iterdir():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    elif stamps.VENV.exists():
        shutil.rmtree(stamps.VENV)


def pip_install(which):
    """Install one lock with pip: every file by its hash, none compiled from its source."""
    lock = stamps.LOCKS[which]
    say("installing the %s set from requirements/%s" % ("runtime" if which == "run" else which, lock.name))
    pip = [stamps.PYTHON, "-m", "pip", "install", "--no-input", "--disable-pip-version-check", "--progress-bar=off"]
    pip += ["--no-compile", "--only-binary=:all:", "--require-hashes"]
    done = output_of([*pip, "-r", lock], shown=Progress(lock))
    failed = "the packages of requirements/%s could not be installed" % lock.name
    if done.returncode != 0:
        sys.exit(explained(done.stdout, failed))
    done = compile_all()
    if no_space(done.stdout):
        sys.exit(explained(done.stdout, failed))


def compile_all():
    """Compile what pip installed, on all processors at once; pip would take one file after the other.

    A file that is not of this Python's syntax stays as it is, as with pip.
    """
    say("compiling the packages")
    (packages,) = stamps.VENV.glob("lib/python3*/site-packages")
    for workers in ("0", "1"):  # a system without semaphores cannot share work, and says so by a traceback
        done = output_of([stamps.PYTHON, "-m", "compileall", "-q", "-j", workers, packages])
        if "Traceback" not in done.stdout or no_space(done.stdout):
            break
    return done


def no_space(said):
    """Return True where a command said that the disk is full."""
    return re.search(FAILURES[0][0], said) is not None


def check_imports():
    """Import every runtime dependency once, or say in one line which cannot be."""
    say("importing every runtime dependency once")
    done = output_of([stamps.PYTHON, stamps.ROOT / "tools" / "imports.py"])
    if done.returncode != 0:
        sys.exit(done.stdout.strip() or "tools/imports.py ended with status %d" % done.returncode)


class Progress:
    """Shows at a terminal how many packages of a lock pip has got to."""

    def __init__(self, lock):
        self.all = len(re.findall(r"^\S+==", lock.read_text(), flags=re.MULTILINE))
        self.count = 0

    def __call__(self, line):
        """Take one line of pip's."""
        if line.startswith("Collecting "):
            self.count += 1
            self.show("%d of %d: %s" % (self.count, self.all, line.split()[1].partition("==")[0]))
        elif line.startswith("Installing collected"):
            self.show("%d packages into .venv" % self.all)

    def show(self, text):
        """Write over the line, where somebody sees it."""
        if sys.stderr.isatty():
            print("\r\033[Kinstall: " + text, end="", file=sys.stderr, flush=True)

    def end(self):
        """Take the line away."""
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def output_of(command, shown=None):
    """Run a command and return how it ended, with both its outputs as one text."""
    said = []
    with subprocess.Popen(
        [str(part) for part in command],
        cwd=stamps.ROOT,
        text=True,
        errors="replace",
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as process:
        for line in process.stdout:
            said.append(line)
            if shown:
                shown(line)
    if shown:
        shown.end()
    return subprocess.CompletedProcess(command, process.returncode, "".join(said))


def explained(said, what):
    """Return one line for what a command said when it failed; all of it is kept in .setup/failed.log."""
    log = stamps.ROOT / ".setup" / "failed.log"
    try:
        log.write_text(said)
        more = " (all that was said: %s)" % log.relative_to(stamps.ROOT)
    except OSError:
        more = ""
    here = {"python": platform.python_version(), "machine": "%s %s" % (platform.system(), platform.machine())}
    for pattern, sentence in FAILURES:
        found = re.search(pattern, said, flags=re.DOTALL)
        if found and sentence is None:
            return "%s: %s" % (what, needs.no_room())
        if found:
            return "%s: %s%s" % (what, sentence.format(found[1], **here), more)
    lines = [line for line in said.splitlines() if line.strip()] or ["nothing was said"]
    last = next((line for line in reversed(lines) if "error" in line.lower()), lines[-1])
    return "%s: %s%s" % (what, " ".join(last.split()), more)
