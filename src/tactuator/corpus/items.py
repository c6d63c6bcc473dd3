"""Items of a corpus: the tree of speech files and the reference that each is to become."""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from tactuator.errors import BadInput

ENDINGS = (".wav", ".flac", ".ogg", ".oga", ".opus", ".mp3", ".aif", ".aiff", ".aifc", ".au", ".snd", ".caf", ".w64")


@dataclass(frozen=True)
class Item:
    """A speech file and its reference, both relative to their trees, with / between folders."""

    source: str
    out: str


def find_items(folder: str | Path, out: str | Path, ending: str = ".wav") -> tuple[Item, ...]:
    """Return every speech file beneath `folder`, in the order of their names, but nothing that lies in `out`.

    a/b.flac becomes a/b.wav; where two files would become one, they keep their own endings: a/b.flac.wav. Raises
    BadInput where the folder is missing or holds no speech file.
    """
    folder, out = Path(folder), Path(out)
    if not folder.is_dir():
        raise BadInput(f"{folder} is not a folder", "a folder of speech files")
    inside = out.resolve()
    found = sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.suffix.lower() in ENDINGS and not path.name.startswith(".") and inside not in path.resolve().parents
    )
    if not found:
        raise BadInput(f"{folder} holds no speech file", f"files ending in {', '.join(ENDINGS)}")
    plain = {source: Path(source).with_suffix(ending).as_posix() for source in found}
    taken = Counter(plain.values())
    return tuple(Item(s, plain[s] if taken[plain[s]] == 1 else s + ending) for s in found)


def file_sha256(path: str | Path) -> str:
    """Return SHA-256 (hex) of a file's bytes."""
    digest = hashlib.sha256()
    with Path(path).open("rb") as file:
        while part := file.read(1 << 20):
            digest.update(part)
    return digest.hexdigest()


def written_sha256(path: Path) -> list[str]:
    """Return SHA-256 (hex) of a reference's file, and of the file with its scale beside a WAV."""
    files = [path, path.with_suffix(".json")] if path.suffix == ".wav" else [path]
    return [file_sha256(one) for one in files]


def item_seed(seed: int, source: str) -> int:
    """Return the seed of one file's simulation: it depends on the corpus's seed and the file's name, not on
    the order.
    """
    return int.from_bytes(hashlib.sha256(f"{seed}:{source}".encode()).digest()[:4], "little")
