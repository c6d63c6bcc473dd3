"""Printing of a verb's answer: one JSON object for programs, or a table for people; progress goes to standard error."""

import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from tactuator.api.plain import plain
from tactuator.experiment.result.confusion import ResultTable


def answer(result: Mapping[str, object], as_json: bool, shown: RenderableType) -> None:
    """Print `result` as exactly one JSON object when `as_json`, otherwise what is shown to a person
    (text as it is: "[dB SL]" is a unit, not markup; colour a cell with `rich.text.Text`).

    In the JSON, numbers that JSON cannot say (infinite, not a number) are null; complex numbers are [re, im].
    """
    if as_json:
        sys.stdout.write(json.dumps(plain(result), ensure_ascii=False, allow_nan=False) + "\n")
    else:
        Console(file=sys.stdout, markup=False).print(shown)


def progress() -> Progress:
    """Return progress bars on standard error, gone when done, and silent where nobody watches (no terminal)."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


@contextmanager
def working(text: str) -> Iterator[None]:
    """Show on a terminal that something is under way whose length nobody knows."""
    with progress() as bars:
        bars.add_task(text, total=None)
        yield


def written(*paths: Path | None) -> list[str]:
    """Return a line for every file or folder that was written."""
    return [f"written: {path}" for path in paths if path is not None]


def shown(one: ResultTable) -> Group:
    """Return the table with its notes below; a table that is too wide for its frame stands without one."""
    return Group(_Framed(one), *one.notes)


class _Framed:
    """A table in a frame, or without one where that saves a cell from being broken."""

    def __init__(self, one: ResultTable) -> None:
        self.one = one

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        framed = self._table(Table(title=self.one.caption or None))
        bare = self._table(Table(title=self.one.caption or None, box=SIMPLE_HEAD, padding=0, pad_edge=False))
        wide = options.update(max_width=10_000)
        narrowest, widest = framed.__rich_measure__(console, wide)
        fits_bare_alone = widest > options.max_width >= bare.__rich_measure__(console, wide).maximum
        yield bare if fits_bare_alone or narrowest > options.max_width else framed

    def _table(self, table: Table) -> Table:
        for name in self.one.columns:
            table.add_column(name, overflow="fold")
        for row in self.one.rows:
            table.add_row(*row)
        return table
