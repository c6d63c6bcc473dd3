"""What a disk holds after a power cut, from the record of what was asked of it."""

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

_HEAD = struct.Struct("<cHqI")
_SECTOR = 512


@dataclass(frozen=True)
class Asked:
    """One request: w (bytes written), t (length cut), s (brought to the disk), u (name removed)."""

    kind: str
    path: Path
    place: int
    content: bytes


def requests(log: Path) -> list[Asked]:
    whole, at, found = log.read_bytes(), 0, []
    while at < len(whole):
        kind, length, place, count = _HEAD.unpack_from(whole, at)
        at += _HEAD.size
        path = Path(whole[at : at + length].decode())
        found.append(Asked(kind.decode(), path, place, whole[at + length : at + length + count]))
        at += length + count
    return found


@dataclass
class _File:
    """Bytes that are on the disk, requests that may be, and whether its name is in the folder for sure."""

    kept: bytearray = field(default_factory=bytearray)
    waiting: list[Asked] = field(default_factory=list)
    named: bool = False
    removed: bool = False


def after_cut(asked: list[Asked], share: float, rng: np.random.Generator) -> dict[str, bytes]:
    """Files by name after the power went with the last of the requests.

    What was brought to the disk is there. Of the rest each sector is there with probability `share`, in whatever order:
    a disk may write what waits as it likes, and a file whose folder was not brought to the disk may have no name.
    """
    files: dict[Path, _File] = {}
    for one in asked:
        if one.kind == "s" and one.path.suffix == "":  # the folder
            files = {path: file for path, file in files.items() if not file.removed}
            for file in files.values():
                file.named = True
        elif one.kind == "u":
            files[one.path].removed = True
        else:
            file = files.setdefault(one.path, _File())
            file.removed = False
            if one.kind == "s":
                for each in file.waiting:
                    _apply(file.kept, each)
                file.waiting.clear()
            else:
                file.waiting.append(one)
    return {
        path.name: _left(file, share, rng)
        for path, file in files.items()
        if not (file.removed and rng.random() < share) and (file.named or rng.random() < share)
    }


def _left(file: _File, share: float, rng: np.random.Generator) -> bytes:
    content = bytearray(file.kept)
    for one in file.waiting:
        if one.kind == "t":
            if rng.random() < share:
                _apply(content, one)
            continue
        begin, end = one.place, one.place + len(one.content)
        for sector in range(begin // _SECTOR, -(-end // _SECTOR)):
            if rng.random() < share:
                low, high = max(begin, sector * _SECTOR), min(end, (sector + 1) * _SECTOR)
                _apply(content, Asked("w", one.path, low, one.content[low - begin : high - begin]))
    return bytes(content)


def _apply(content: bytearray, one: Asked) -> None:
    if one.kind == "t":
        del content[one.place :]
        content.extend(bytes(one.place - len(content)))
        return
    content.extend(bytes(max(0, one.place - len(content))))
    content[one.place : one.place + len(one.content)] = one.content
