"""Runs every verb that writes on a disk with little room, and interrupts it at moments spread over its run.

After each run a file must be as it was before, or as an undisturbed run leaves it, byte for byte; a store must be sound
by SQLite's own check; nothing else may lie about. No traceback, no crash, and a status that is documented. Not shared
with the verbs: a tmpfs of a limited size, signals from outside, and checksums. Needs root (`unshare -m`). Seen to fail
with `--broken copy` (a file beside is copied, not renamed) and `--broken deaf` (nobody listens to Ctrl-C).
"""

from __future__ import annotations

import argparse
import hashlib
import os
import pkgutil
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import NoReturn

import numpy as np
import soundfile

import tactuator
from tactuator import __main__ as begin
from witnesses.hard.sitting import protocol

VERBS = [
    "init --out new.toml --protocol imece2004",
    "init --examples examples",
    "record display.toml --out new.h5 --duration-s 5 --travel-share 0.3",
    "identify record.h5 --out model.json --figures figures",
    "design display.toml --out controller.json --figures figures",
    "wordlength controller.json --figures figures",
    "build controller.json --out new.tim",
    "noise --controller controller.json --duration-s 3 --gains 2 --write noise.json",
    "measure --controller controller.json --frequency-hz 30,100 --confidence-db 2 --longest-s 1 --out new.h5",
    "measure --controller controller.json --frequency-hz 30,100 --confidence-db 2 --longest-s 1 --out new.csv "
    "--figures figures",
    "experiment waveforms --controller controller.json --out waveforms --duration 0.1 --fingers index",
    "render speech.wav --controller controller.json --out new.wav --felt felt.wav --save-coding coding.toml",
    "render speech.wav --controller controller.json --out new.h5 --felt felt.wav --figures figures",
    "firmware program --board mps2-an500 --out new.elf",
    "experiment enrol X9 --store lab.db",
    "experiment correct S1 --store lab.db --reason typed --group hearing-impaired",
    "experiment observe short.toml --store new.db --controller controller.json",
    "experiment observe short.toml --store lab.db --controller controller.json",
    "experiment thresholds --store lab.db --curve-out curve.csv --figures figures",
    "experiment export --store lab.db --out tidy.csv",
    "experiment export --store lab.db --out psych --format psych-ds",
    "experiment export --store lab.db --out bids --format bids",
]
LEVELS, INTERRUPTS = 20, 50
_STATUSES = {0, 1, 2, 3, 130}


@dataclass
class Disk:
    """A small file system: what stands there before a verb, and room for what it writes."""

    place: Path
    before: Path
    log: Path

    def reset(self) -> None:
        """Bring the disk to where it was before the verb."""
        for path in self.place.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        shutil.copytree(self.before, self.place, dirs_exist_ok=True)

    def fill(self, free: int) -> None:
        """Leave so many bytes free."""
        found = os.statvfs(self.place)
        with (self.place / "filler").open("wb") as file:
            file.write(bytes(max(0, found.f_bavail * found.f_bsize - free)))

    def files(self) -> dict[str, str]:
        """Return the checksum of every file; of a store, whether it is sound."""
        return {
            str(path.relative_to(self.place)): _sum(path)
            for path in self.place.rglob("*")
            if path.is_file() and path.name != "filler" and not path.name.endswith(("-wal", "-shm"))
        }

    def used(self) -> int:
        """Return the bytes in use."""
        found = os.statvfs(self.place)
        return (found.f_blocks - found.f_bfree) * found.f_bsize


def _sum(path: Path) -> str:
    if path.suffix != ".db":
        return hashlib.sha256(path.read_bytes()).hexdigest()
    try:
        with closing(sqlite3.connect(path)) as connection:
            return str(connection.execute("PRAGMA integrity_check").fetchone()[0])
    except sqlite3.DatabaseError as error:
        return str(error)


def _be_the_program(disk: Disk, verb: str, prepare: Callable[[], None]) -> NoReturn:
    """Run a verb in this process, which is a fork, and end it."""
    status = 99
    try:
        os.setsid()
        with disk.log.open("wb") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        os.chdir(disk.place)
        sys.argv = ["tactuator", *verb.split()]
        signal.signal(signal.SIGINT, begin._leave)
        prepare()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        status = begin.main() or 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 98
    except BaseException as error:
        os.write(2, f"Traceback of {error!r}\n".encode())
    finally:
        sys.stdout.flush()
        os._exit(status)


def _run(
    disk: Disk, verb: str, prepare: Callable[[], None], interrupt_s: float | None = None
) -> tuple[int, str, float]:
    """Run a verb in a fork of this process, interrupted after so long; status, what it said, seconds."""
    begun = time.monotonic()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the fork is not to hear it before the program would
    child = os.fork()
    if child == 0:
        _be_the_program(disk, verb, prepare)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if interrupt_s is not None:
        time.sleep(interrupt_s)
        os.kill(child, signal.SIGINT)
    _, told = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(told), disk.log.read_text(errors="replace"), time.monotonic() - begun


def _faults(disk: Disk, status: int, said: str, allowed: dict[str, set[str]]) -> list[str]:
    """Return what is wrong after a run."""
    found = [] if status in _STATUSES else [f"status {status}"]
    found += ["a traceback"] if "Traceback" in said else []
    for name, content in disk.files().items():
        if name.endswith(".db"):
            found += [] if content == "ok" else [f"{name}: {content}"]
        elif name not in allowed:
            found.append(f"{name} lies about")
        elif content not in allowed[name]:
            found.append(f"{name} is neither old nor whole")
    return found


def _judge(disk: Disk, verb: str, prepare: Callable[[], None], levels: int, interrupts: int) -> list[str]:
    """Run a verb at every level of room and interrupted at every moment; what went wrong."""
    disk.reset()
    old, empty = disk.files(), disk.used()
    status, said, seconds = _run(disk, verb, lambda: None)
    if status not in (0, 1):
        return [f"undisturbed: status {status}: {said[-300:]}"]
    new, need = disk.files(), disk.used() - empty + (1 << 16)
    allowed = {name: {one[name] for one in (old, new) if name in one} for name in old | new}
    wrong = []
    for level in range(levels):
        disk.reset()
        disk.fill(need * level // levels)
        status, said, _ = _run(disk, verb, prepare)
        (disk.place / "filler").unlink()
        free = need * level // levels
        wrong += [f"{free} bytes free: {one}\n{said[-800:]}" for one in _faults(disk, status, said, allowed)]
    for moment in range(interrupts):
        disk.reset()
        after_s = seconds * (moment + 0.5) / interrupts
        status, said, _ = _run(disk, verb, prepare, after_s)
        wrong += [f"Ctrl-C after {after_s:.3f} s: {one}\n{said[-800:]}" for one in _faults(disk, status, said, allowed)]
    return wrong


def _import_all() -> None:
    """Import every module once, so that each fork has it and its time is that of its work."""
    for found in pkgutil.walk_packages(tactuator.__path__, "tactuator."):
        with suppress(ImportError):
            import_module(found.name)


def _first_files(folder: Path) -> None:
    """Make what the verbs read."""
    os.chdir(folder)
    for line in [
        "init --out display.toml",
        "design display.toml --out controller.json",
        "record display.toml --out record.h5 --duration-s 10",
    ]:
        subprocess.run([sys.executable, "-m", "tactuator", *line.split()], check=False, stdout=subprocess.DEVNULL)
    Path("short.toml").write_text(protocol(4, ["S1"]), encoding="utf-8")
    noise = np.random.default_rng(1).standard_normal(16000) * np.repeat([0.1, 0.01, 0.1, 0.01], 4000)
    soundfile.write("speech.wav", noise, 16000)
    line = "experiment observe short.toml --store lab.db --controller controller.json"
    subprocess.run([sys.executable, "-m", "tactuator", *line.split()], check=True, stdout=subprocess.DEVNULL)


def _copied(self: Path, target: Path) -> None:
    shutil.copyfile(self, target)
    self.unlink()


def _broken(how: str | None) -> Callable[[], None]:
    def prepare() -> None:
        if how == "copy":
            setattr(Path, "replace", _copied)  # noqa: B010
        if how == "deaf":
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            setattr(signal, "signal", lambda *given: None)  # noqa: B010

    return prepare


def main() -> int:
    """Run the witness, and return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="verbs that hold this text")
    parser.add_argument("--levels", type=int, default=LEVELS)
    parser.add_argument("--interrupts", type=int, default=INTERRUPTS)
    parser.add_argument("--broken", choices=["copy", "deaf"])
    given = parser.parse_args()
    if "OWN_MOUNTS" not in os.environ:
        command = ["unshare", "-m", "--propagation", "private", sys.executable, "-m", "witnesses.hard.verbs"]
        return subprocess.run([*command, *sys.argv[1:]], env=os.environ | {"OWN_MOUNTS": "1"}, check=False).returncode
    work, home, bad, runs = Path(tempfile.mkdtemp()), Path.cwd(), 0, 0
    try:
        disk = Disk(work / "disk", work / "before", work / "log")
        disk.before.mkdir()
        disk.place.mkdir()
        _import_all()
        _first_files(disk.before)
        os.chdir(home)
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "none", disk.place], check=True)
        for verb in [one for one in VERBS if given.only in one]:
            wrong = _judge(disk, verb, _broken(given.broken), given.levels, given.interrupts)
            runs += given.levels + given.interrupts
            bad += len(wrong)
            print(f"{'ok   ' if not wrong else 'WRONG'} {verb}", *wrong, sep="\n      ", flush=True)
    finally:
        os.chdir(home)
        subprocess.run(["umount", work / "disk"], check=False)
        shutil.rmtree(work)
    print(f"{runs} runs, {bad} faults")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
