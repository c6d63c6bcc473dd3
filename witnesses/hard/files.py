"""Gives every reader two hundred hostile files, the last twenty through the command line.

Each file is read by a fork of this process. It has to end within 10 s of wall clock and 1 GB (highest resident memory,
the kernel's own count), with an answer or with one line, without a traceback and with nothing on standard error beside
that line. Whether an answer is right is not judged here. Not shared with the readers: the damage (damage.py), the clock
and the kernel's count. Seen to fail with `--broken naive` (every file is read whole and taken for JSON).
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from tactuator.__main__ import main as program
from tactuator.errors import TactuatorError
from witnesses.hard.damage import bombs, lay
from witnesses.hard.readers import EXAMPLES, READERS, Reader, make_files, warm
from witnesses.hard.sitting import protocol

MOST_S, MOST_BYTES, BY_COMMAND = 10.0, 1 << 30, 20
_STATUSES = {0, 1, 2, 3}


@dataclass
class Found:
    """What a reader's hostile files led to."""

    answers: int = 0
    refusals: int = 0
    longest_s: float = 0.0
    largest_bytes: int = 0
    faults: list[str] = field(default_factory=list)


def _in_function(read: Callable[[Path], object], path: Path) -> int:
    try:
        read(path)
    except TactuatorError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _by_command(command: str, path: Path) -> int:
    sys.argv = ["tactuator", *(str(path) if part == "{}" else part for part in command.split())]
    try:
        return program() or 0
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 98


def _child(work: Callable[[], int], log: Path) -> int:
    child = os.fork()
    if child:
        return child
    os.setsid()
    nothing, told = os.open(os.devnull, os.O_RDWR), os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    os.dup2(told, 2)
    status = 97
    try:
        status = work()
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(status)


def _resident(child: int) -> int:
    try:
        return int(Path(f"/proc/{child}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):
        return 0


def _run(work: Callable[[], int], log: Path) -> tuple[int, str, float, int]:
    """Run in a fork; status (-9: had to be ended), what it wrote to standard error, seconds, highest bytes."""
    begun = time.monotonic()
    child = _child(work, log)
    while True:
        ended, told, used = os.wait4(child, os.WNOHANG)
        if ended:
            break
        if time.monotonic() - begun > MOST_S or _resident(child) > MOST_BYTES:
            os.killpg(child, signal.SIGKILL)
            _, told, used = os.wait4(child, 0)
            break
        time.sleep(0.003)
    with log.open("rb") as file:
        said = file.read(100_000).decode(errors="replace")
    return os.waitstatus_to_exitcode(told), said, time.monotonic() - begun, used.ru_maxrss * 1024


def _fault(status: int, said: str, seconds: float, most: int) -> str:
    lines = [line for line in said.split("\n") if line.strip()]
    if seconds > MOST_S or most > MOST_BYTES:
        return f"{seconds:.1f} s, {most >> 20} MB"
    if "Traceback" in said or status not in _STATUSES:
        return f"status {status}: {lines[-1][:300] if lines else 'nothing said'}"
    if status == 2 and len(lines) != 1:
        return f"{len(lines)} lines: {said[:300]!r}"
    return ""


def _naive(path: Path) -> object:
    return json.loads(path.read_bytes())


def _require_whole_is_read(reader: Reader, folder: Path, found: Found) -> None:
    """Count it as a fault where the reader or its command refuses the file as it was written."""
    (folder / "bad").mkdir(exist_ok=True)
    for one in folder.iterdir():
        if one.name.startswith("reference"):
            shutil.copy(one, folder / "bad")
    path = folder / reader.file
    works = [
        partial(_in_function, reader.read, path),
        *[partial(_by_command, reader.command, path)] * bool(reader.command),
    ]
    for work in works:
        status, said, *_ = _run(work, folder / "log")
        if status not in (0, 1):
            found.faults.append(f"the whole file: status {status}: {said[-300:]}")


def judge(reader: Reader, folder: Path, count: int, seed: int, broken: bool, contents: tuple[bytes, ...]) -> Found:
    """Give a reader its hostile files."""
    rng, found = random.Random(f"{seed} {reader.file}"), Found()
    good, bad, read = (folder / reader.file).read_bytes(), folder / "bad", _naive if broken else reader.read
    own = range(count - BY_COMMAND, count) if reader.command else range(0)
    _require_whole_is_read(reader, folder, found)
    for number in range(count):
        shutil.rmtree(bad, ignore_errors=True)
        bad.mkdir()
        if reader.file.startswith("reference"):
            shutil.copy(folder / "reference.wav", bad)
            shutil.copy(folder / "reference.json", bad)
        path = bad / reader.file
        path.unlink(missing_ok=True)
        what = lay(path, good, number, rng, contents)
        work = partial(_by_command, reader.command, path) if number in own else partial(_in_function, read, path)
        status, said, seconds, most = _run(work, folder / "log")
        found.answers += status == 0
        found.refusals += status == 2
        found.longest_s, found.largest_bytes = max(found.longest_s, seconds), max(found.largest_bytes, most)
        if fault := _fault(status, said, seconds, most):
            found.faults.append(f"{number} {what}{' by command' * (number in own)}: {fault}")
    return found


def main() -> int:
    """Run the witness, and return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=200, help="hostile files for each reader")
    parser.add_argument("--only", nargs="*", default=[""], help="readers whose file holds one of these texts")
    parser.add_argument("--broken", choices=["naive"])
    given = parser.parse_args()
    warm()
    home, bad, total, contents = Path.cwd(), 0, 0, bombs()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        try:
            make_files(folder, EXAMPLES / "displays/tactuator.toml", protocol(4, ["S1"]))
            for reader in [one for one in READERS if any(text in one.file for text in given.only)]:
                found = judge(reader, folder, given.count, given.seed, bool(given.broken), contents)
                total += given.count
                bad += len(found.faults)
                told = f"{found.refusals} refused, {found.answers} read, {found.longest_s:.1f} s"
                print(f"{reader.name}: {told}, {found.largest_bytes >> 20} MB", *found.faults, sep="\n   ", flush=True)
        finally:
            os.chdir(home)
    print(f"{total} files, {bad} faults")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
