"""Journal of a corpus: every item that is finished, line by line as it happens, so that a run goes on where another
stopped.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from tactuator.errors import BadInput
from tactuator.io.formats.text import parse_finite_json

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
            entry = _entry(line)
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


def _entry(line: str) -> dict[str, Any] | None:
    try:
        entry = parse_finite_json(line)
    except BadInput:
        return None
    return entry if isinstance(entry, dict) and "item" in entry else None
