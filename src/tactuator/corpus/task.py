"""The work on one file of a corpus, in any process: the task holds all it needs, the outcome all that came of it."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput
from tactuator.io.controller import parse_controller
from tactuator.model.controller import Controller
from tactuator.speech.coding import Coding, parse_coding
from tactuator.speech.render import RenderJob, render_file

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
    sources = sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.suffix.lower() in ENDINGS and not path.name.startswith(".") and inside not in path.resolve().parents
    )
    if not sources:
        raise BadInput(f"{folder} holds no speech file", f"files ending in {', '.join(ENDINGS)}")
    plain = {source: Path(source).with_suffix(ending).as_posix() for source in sources}
    taken = Counter(plain.values())
    return tuple(Item(s, plain[s] if taken[plain[s]] == 1 else s + ending) for s in sources)


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
    return [file_sha256(file) for file in files]


def item_seed(seed: int, source: str) -> int:
    """Return the seed of one file's simulation: it depends on the corpus's seed and the file's name, not on
    the order.
    """
    return int.from_bytes(hashlib.sha256(f"{seed}:{source}".encode()).digest()[:4], "little")


@dataclass(frozen=True)
class CorpusTask:
    """The work on one file of a corpus.

    source, out: paths as the worker sees them. item: the source's name in the corpus. controller, coding: JSON.
    """

    item: str
    source: str
    out: str
    controller: str
    coding: str
    level_db_sl: float
    simulate: bool
    seed: int


@dataclass(frozen=True)
class CorpusOutcome:
    """Outcome of the work on one file.

    written_sha256: of what was written. figures: of the rendered file, plain JSON. error: one line, where nothing came
    of it.
    """

    item: str
    source_sha256: str | None
    written_sha256: list[str] | None
    figures: dict[str, Any] | None
    error: str | None


def do_task(task: CorpusTask) -> CorpusOutcome:
    """Render one file. Faults of the file, or of writing its reference, are in the outcome and are not raised."""
    try:
        digest = file_sha256(task.source)
        out = Path(task.out)
        out.parent.mkdir(parents=True, exist_ok=True)
        job = RenderJob(_controller(task.controller), _coding(task.coding), task.level_db_sl, task.simulate, task.seed)
        figures = render_file(task.source, out, job).document()
        figures["speech"] = task.item
        return CorpusOutcome(task.item, digest, written_sha256(out), figures, None)
    except BadInput as error:
        return failed(task, _one_line(str(error)))
    except OSError as error:
        return failed(task, _one_line(f"{error.filename}: {error.strerror}"))


def failed(task: CorpusTask, error: str) -> CorpusOutcome:
    """Return the outcome of a file of which nothing came."""
    return CorpusOutcome(task.item, None, None, None, error)


def _one_line(text: str) -> str:
    return " ".join(text.split())


@lru_cache(maxsize=2)
def _controller(text: str) -> Controller:
    """Return the controller, read once in each worker: the limits derived from it are kept with it."""
    return parse_controller(json.loads(text))


@lru_cache(maxsize=2)
def _coding(text: str) -> Coding:
    """Return the coding, read once in each worker."""
    return parse_coding(json.loads(text))
