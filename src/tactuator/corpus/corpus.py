"""Rendering of a corpus, which can be restarted, with a manifest that does not depend on who did the work."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from tactuator.corpus.task import CorpusOutcome, CorpusTask, Item, file_sha256, find_items, item_seed, written_sha256
from tactuator.corpus.workers import Workers
from tactuator.errors import BadInput
from tactuator.io.atomic import sweep_half_written, write_text
from tactuator.io.text import parse_finite_json
from tactuator.speech.coding import coding_document
from tactuator.speech.render import RenderJob
from tactuator.verbs.result import plain

NAME = "journal.jsonl"


@dataclass
class Journal:
    """An open journal: `finished` holds what earlier runs of the same parameters finished, by item."""

    finished: dict[str, dict[str, Any]]
    _file: IO[str]

    def add(self, item: str, entry: Mapping[str, Any]) -> None:
        """Write an entry through to the disk. Raises BadInput where it has no room."""
        try:
            self._file.write(json.dumps({"item": item, **entry}, sort_keys=True, allow_nan=False) + "\n")
            self._file.flush()
        except OSError as error:
            raise BadInput(f"{self._file.name}: cannot be written ({error.strerror})", "a disk with room") from None
        self.finished[item] = dict(entry)


@contextmanager
def open_journal(folder: Path, parameters: Mapping[str, Any]) -> Iterator[Journal]:
    """Yield the journal in `folder`, begun anew if it is of other parameters; a last line that was cut off
    is dropped.
    """
    path = folder / NAME
    head = json.dumps({"parameters": parameters}, sort_keys=True, allow_nan=False)
    lines = path.read_text(encoding="utf-8", errors="replace").split("\n") if path.is_file() else []
    if path.exists() and not path.is_file():
        raise BadInput(f"{path} is a folder, a pipe or a device", "a file, or none yet")
    finished: dict[str, dict[str, Any]] = {}
    if lines and lines[0] == head:
        for line in lines[1:-1]:  # a whole line ends in a newline: what follows the last one was cut off
            entry = _read_entry(line)
            if entry is not None:
                finished[str(entry.pop("item"))] = entry
    try:
        with path.open("w", encoding="utf-8") as file:
            file.write(head + "\n")
            journal = Journal({}, file)
            for item, entry in finished.items():
                journal.add(item, entry)
            yield journal
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})", "a folder that can be written") from None


def _read_entry(line: str) -> dict[str, Any] | None:
    try:
        entry = parse_finite_json(line)
    except BadInput:
        return None
    return entry if isinstance(entry, dict) and "item" in entry else None


MANIFEST = "manifest.json"
FORMAT = "tactuator-corpus/1"

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class CorpusResult:
    """Result of a corpus. manifest: the content of manifest.json. done: rendered by this run; kept: finished by an
    earlier one.
    """

    manifest: Mapping[str, Any]
    done: int
    kept: int

    @property
    def failures(self) -> list[dict[str, str]]:
        """Return the files of which nothing came, with the reason."""
        return list(self.manifest["failures"])


def run_corpus(
    folder: str | Path,
    out: str | Path,
    job: RenderJob,
    workers: Workers,
    ending: str = ".wav",
    progress: Progress = lambda done, total: None,
) -> CorpusResult:
    """Render every speech file beneath `folder` into `out`, and write out/manifest.json at the end.

    A file that was finished by an earlier run with the same parameters, whose bytes are the same and whose reference is
    still there, is not done again. Files that fail are listed and the rest carried on. Raises BadInput where `folder`
    holds nothing or `out` cannot be written.
    """
    folder, out = Path(folder), Path(out)
    items = find_items(folder, out, ending)
    _make(out)
    with _alone_in(out):
        return _run(folder, items, out, job, workers, ending, progress)


def _run(
    folder: Path,
    items: tuple[Item, ...],
    out: Path,
    job: RenderJob,
    workers: Workers,
    ending: str,
    progress: Progress,
) -> CorpusResult:
    parameters = {**job.parameters(), "ending": ending}
    _sweep(items, out)
    with open_journal(out, parameters) as journal:
        before = dict(journal.finished)
        kept = {item.source for item in items if _is_done(item, folder, out, before.get(item.source))}
        again = [item for item in items if item.source not in kept]
        for item in again if ending == ".wav" else ():
            if item.source in before:  # the head is an earlier run's, and perhaps too damaged to tell
                (out / item.out).with_suffix(".json").unlink(missing_ok=True)
        todo = _tasks(again, folder, out, job)
        failures, done = {}, 0
        progress(len(kept), len(items))
        for outcome in workers.outcomes(todo):
            if outcome.figures is None:
                failures[outcome.item] = outcome.error or "not rendered"
            else:
                journal.add(outcome.item, _entry(outcome))
                done += 1
            progress(len(kept) + done + len(failures), len(items))
        entries = {item.source: journal.finished[item.source] for item in items if item.source not in failures}
    _sweep(items, out)
    manifest = _manifest(parameters, items, entries, failures)
    write_text(out / MANIFEST, json.dumps(manifest, indent=1, sort_keys=True, allow_nan=False) + "\n")
    return CorpusResult(manifest, done, len(kept))


def _make(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{out} cannot be made: {error.strerror}", "a folder that can be written") from None


@contextmanager
def _alone_in(out: Path) -> Iterator[None]:
    """Hold the folder for one run; the lock is the operating system's, and ends with the process."""
    handle = os.open(out, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise BadInput(f"{out}: another run writes into it", "one at a time") from None
    finally:
        os.close(handle)


def _sweep(items: tuple[Item, ...], out: Path) -> None:
    """Remove half-written files that killed workers left."""
    written = [out / item.out for item in items]
    sweep_half_written([out / MANIFEST, *written, *(path.with_suffix(".json") for path in written)])


def _tasks(items: list[Item], folder: Path, out: Path, job: RenderJob) -> list[CorpusTask]:
    controller, coding = json.dumps(job.controller.document()), json.dumps(coding_document(job.coding))
    return [
        CorpusTask(
            item=item.source,
            source=str((folder / item.source).absolute()),
            out=str((out / item.out).absolute()),
            controller=controller,
            coding=coding,
            level_db_sl=job.level_db_sl,
            simulate=job.simulate,
            seed=item_seed(job.seed, item.source),
        )
        for item in items
    ]


def _entry(outcome: CorpusOutcome) -> dict[str, Any]:
    return {
        "source_sha256": outcome.source_sha256,
        "written_sha256": outcome.written_sha256,
        "figures": plain(outcome.figures),
    }


def _is_done(item: Item, folder: Path, out: Path, entry: Mapping[str, Any] | None) -> bool:
    if entry is None:
        return False
    try:
        return bool(
            file_sha256(folder / item.source) == entry["source_sha256"]
            and written_sha256(out / item.out) == entry["written_sha256"]
        )
    except (OSError, KeyError):
        return False


def _manifest(
    parameters: Mapping[str, Any],
    items: tuple[Item, ...],
    entries: Mapping[str, Mapping[str, Any]],
    failures: Mapping[str, str],
) -> dict[str, Any]:
    files = [
        {
            "source": item.source,
            "source_sha256": entries[item.source]["source_sha256"],
            "out": item.out,
            **{key: value for key, value in entries[item.source]["figures"].items() if key != "speech"},
        }
        for item in items
        if item.source in entries
    ]
    return {
        "format": FORMAT,
        "parameters": dict(parameters),
        "files": files,
        "failures": [{"source": source, "error": failures[source]} for source in sorted(failures)],
        "duration_s": sum(file["duration_s"] for file in files),
    }
