"""The work on one file, in any process: the task holds everything it needs, the outcome all that came of it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from tactuator.corpus.items import file_sha256, written_sha256
from tactuator.errors import BadInput
from tactuator.io.controller import parse_controller
from tactuator.model.controller import Controller
from tactuator.speech.coding.coding import Coding
from tactuator.speech.coding.file import parse_coding
from tactuator.speech.job import RenderJob, render_file


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
