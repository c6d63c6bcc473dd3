"""Cuts the power of a machine whose program answers trials into a store, and compares the store with what it had told.

A shim below SQLite (power.c) writes down each change of a file and each wait for the disk. After a kill the files are
made anew from that journal: what was waited for is there; of the rest each piece of 512 bytes is there or is not, by
chance, and so are lengths and the removal of files. Memory that is mapped (`-shm`) is gone. Not shared with the
store: journal, replay, list of answers, and SQLite's own reading of the file. Seen to fail with `--broken careless`
(the store does not wait for the disk).
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import struct
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from witnesses.hard.sitting import Broken, Sittings, warm

_ENTRY = struct.Struct("<IIQQ")
_WRITE, _TRUNCATE, _SYNC, _UNLINK = 1, 2, 3, 4
_SECTOR = 512


@dataclass
class _File:
    """A file: what is on the disk, and what was done since without waiting for it."""

    durable: bytearray | None = None
    pending: list[tuple[int, int, bytes]] = field(default_factory=list)

    def settle(self) -> None:
        """Bring everything that is pending onto the disk."""
        for kind, offset, content in self.pending:
            self._do(kind, offset, content)
        self.pending.clear()

    def cut(self, rng: random.Random) -> None:
        """Let each sector of what is pending be there or not."""
        keeps = rng.choice([0.0, 0.5, 0.9])
        for kind, offset, content in self.pending:
            if kind != _WRITE:
                if rng.random() < keeps:
                    self._do(kind, offset, content)
                continue
            for at in range(0, len(content), _SECTOR):
                if rng.random() < keeps:
                    self._do(_WRITE, offset + at, content[at : at + _SECTOR])
        self.pending.clear()

    def _do(self, kind: int, offset: int, content: bytes) -> None:
        if kind == _UNLINK:
            self.durable = None
            return
        if self.durable is None:
            self.durable = bytearray()
        size = offset if kind == _TRUNCATE else max(len(self.durable), offset + len(content))
        self.durable.extend(bytes(max(0, size - len(self.durable))))
        if kind == _TRUNCATE:
            del self.durable[size:]
        else:
            self.durable[offset : offset + len(content)] = content


def replay(journal: Path, folder: Path, rng: random.Random) -> None:
    """Make the folder's files anew as a power cut leaves them; they were on the disk when the journal began."""
    files = {str(path): _File(bytearray(path.read_bytes())) for path in folder.iterdir() if path.suffix != ".db-shm"}
    content, at = journal.read_bytes() if journal.exists() else b"", 0
    while at + _ENTRY.size <= len(content):
        kind, path_size, offset, size = _ENTRY.unpack_from(content, at)
        begin = at + _ENTRY.size + path_size
        length = size if kind == _WRITE else 0
        if begin + length > len(content):
            break
        path = content[begin - path_size : begin].decode()
        one = files.setdefault(path, _File())
        if path == str(folder):  # waited for: what was removed is gone
            for each in files.values():
                if any(entry[0] == _UNLINK for entry in each.pending):
                    each.settle()
        elif kind == _SYNC:
            one.settle()
        else:
            one.pending.append((kind, size if kind == _TRUNCATE else offset, content[begin : begin + length]))
        at = begin + length
    files.pop(str(folder), None)
    for path, one in files.items():
        one.cut(rng)
        Path(path).unlink(missing_ok=True)
        if one.durable is not None:
            Path(path).write_bytes(one.durable)


def _preloaded(work: Path) -> None:
    """Begin this program again with the shim below it, unless it is there."""
    if "POWER_SHIM" in os.environ:
        return
    shim = work / "power.so"
    source = Path(__file__).with_name("power.c")
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", shim, source, "-ldl"], check=True)
    environment = os.environ | {"POWER_SHIM": str(work), "LD_PRELOAD": str(shim)}
    os.execve(sys.executable, [sys.executable, "-m", "witnesses.hard.cuts", *sys.argv[1:]], environment)


def main() -> int:
    """Run the witness, and return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=100, help="power cuts")
    parser.add_argument("--broken", choices=["careless"])
    given = parser.parse_args()
    work = Path(os.environ.get("POWER_SHIM") or tempfile.mkdtemp())
    _preloaded(work)
    try:
        return _cut_often(given.seed, given.count, Broken(careless=given.broken is not None), work)
    finally:
        shutil.rmtree(work)


def _cut_often(seed: int, count: int, broken: Broken, work: Path) -> int:
    rng, folder, journal, before = random.Random(seed), work / "disk", work / "journal", work / "before"
    warm()
    folder.mkdir()
    sittings, bad = Sittings(folder / "lab.db", seed, broken, []), 0

    def prepare() -> None:
        os.environ |= {"POWER_FOLDER": str(folder), "POWER_LOG": str(journal)}

    for number in range(count):
        shutil.rmtree(before, ignore_errors=True)
        shutil.copytree(folder, before)
        journal.unlink(missing_ok=True)
        sittings.until_killed(rng.randrange(0, 60), rng.uniform(0.0, 0.02), prepare)
        shutil.rmtree(folder)
        before.rename(folder)
        replay(journal, folder, rng)
        faults = sittings.faults()
        if any(faults.values()):
            print(f"cut {number + 1}:", faults)
            bad += 1
            break
        if number % 10 == 9:
            sys.stderr.write(f"\r{number + 1} cuts, {len(sittings.told)} answers")
    print(f"\n{sittings.begun} cuts, {len(sittings.told)} answers told, {bad} cuts after which the store was wrong")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
