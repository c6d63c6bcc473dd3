"""Printing of a verb's result: one JSON object for programs, or tables for people; progress goes to standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from tactuator.table import ResultTable
from tactuator.verbs.progress import Step
from tactuator.verbs.result import Result, plain

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions
    from rich.progress import Progress
    from rich.table import Table


def answer(result: Result, as_json: bool, written: Sequence[object] = ()) -> None:
    """Print `result` as exactly one JSON object when `as_json`, otherwise its tables and the files that were written
    (text as it is: "[dB SL]" is a unit, not markup).

    In the JSON, numbers that JSON cannot say (infinite, not a number) are null; complex numbers are [re, im].
    """
    for notice in result.notices():
        sys.stderr.write(f"tactuator: {notice}\n")
    if as_json:
        import json

        sys.stdout.write(json.dumps(plain(result.to_dict()), ensure_ascii=False, allow_nan=False) + "\n")
        return
    from rich.console import Console, Group

    shown = [Group(Framed(part), *part.notes) if isinstance(part, ResultTable) else part for part in result.tables()]
    Console(file=sys.stdout, markup=False).print(*shown, *(f"written: {path}" for path in written), sep="\n")


class Framed:
    """A table in a frame, or without one where that saves a cell from being broken."""

    def __init__(self, content: ResultTable) -> None:
        self.content = content

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        from rich.box import SIMPLE_HEAD
        from rich.table import Table

        title = self.content.caption or None
        framed = self._filled(Table(title=title))
        bare = self._filled(Table(title=title, box=SIMPLE_HEAD, padding=0, pad_edge=False))
        wide = options.update(max_width=10_000)
        narrowest, widest = framed.__rich_measure__(console, wide)
        fits_bare_alone = widest > options.max_width >= bare.__rich_measure__(console, wide).maximum
        yield bare if fits_bare_alone or narrowest > options.max_width else framed

    def _filled(self, table: Table) -> Table:
        from rich.text import Text

        for name in self.content.columns:
            table.add_column(name, overflow="fold", no_wrap=name in self.content.whole)
        for row in self.content.rows:
            table.add_row(*map(Text, row))
        return table


class Bars:
    """Bars on standard error, one below the other, gone when done; nothing where nobody watches (no terminal)."""

    def __init__(self) -> None:
        self._shown: Progress | None = None

    @contextmanager
    def __call__(self, text: str, total: float | None) -> Iterator[Step]:
        """Show a bar for a stretch of work."""
        if not sys.stderr.isatty():
            yield lambda done=None, total=None, text=None: None
            return
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        with ExitStack() as stack:
            if self._shown is None:
                columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
                self._shown = stack.enter_context(Progress(*columns, console=Console(stderr=True), transient=True))
                stack.callback(setattr, self, "_shown", None)
            shown, task = self._shown, self._shown.add_task(text, total=total)
            yield lambda done=None, total=None, text=None: shown.update(
                task, completed=done, total=total, description=text
            )
