"""What is printed of a result: one JSON object for programs, or text for people; progress goes to standard error."""

import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import count, islice
from threading import Event, Thread

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.measure import Measurement
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segments
from rich.table import Table
from rich.text import Text

from tactuator.api.progress import Step
from tactuator.errors import visible
from tactuator.result import Result, ResultTable


def answer(
    result: Result, as_json: bool, full: bool, written: Sequence[object] = (), typed: Callable[[str], str] = str
) -> None:
    """Print `result` and the files that were written: as exactly one JSON object, as its tables, or as a summary.

    typed: makes options of the parameters that a text names.

    Text is printed as it is: "[dB SL]" is a unit, not markup. In the JSON, numbers that JSON cannot say (infinite, not
    a number) are null; complex numbers are [re, im].
    """
    for notice in result.notices():
        sys.stderr.write(f"tactuator: {typed(visible(notice))}\n")
    if as_json:
        sys.stdout.write(visible(json.dumps(result.to_dict(), ensure_ascii=False, allow_nan=False)) + "\n")
        return
    console = Console(file=sys.stdout, markup=False, highlight=False, emoji=False)
    places = [f"written: {path}" for path in written]
    if not full:
        step = result.next_step()
        below = [*([f"next: {step}"] if step else []), *places]
        console.print(*map(typed, result.summary_lines(below, console.width, "--full")), sep="\n", soft_wrap=True)
        return
    for part in result.all_tables():
        if isinstance(part, ResultTable):
            _print(drawn(part, console, typed), console)
        for line in part.notes if isinstance(part, ResultTable) else (part,):
            console.print(typed(visible(line)))
    for place in places:
        console.print(visible(place))


_AT_ONCE = 10_000


def _print(table: Table, console: Console) -> None:
    """Print a table a part at a time: the whole text of thousands of rows would take up 100 MB."""
    segments = iter(console.render(table))
    while part := list(islice(segments, _AT_ONCE)):
        console.print(Segments(part), end="", crop=False)


def drawn(content: ResultTable, console: Console, typed: Callable[[str], str] = str) -> Table:
    """Return a table as wide as the console lets it be: no word is broken where there is room for all of them, and no
    number where there is room for those.
    """
    table = Table(title=content.caption or None, box=SIMPLE_HEAD, pad_edge=False)
    firm, least, most, wide = list[int](), list[int](), list[int](), console.options.update(max_width=10_000)
    rows = [[typed(visible(cell)) for cell in row] for row in content.rows]
    for name, *cells in zip(content.columns, *rows, strict=True):
        sizes = [Measurement.get(console, wide, Text(cell)) for cell in (name, *cells)]
        most.append(max(size.maximum for size in sizes))
        least.append(most[-1] if name in content.whole else max(size.minimum for size in sizes))
        firm.append(max((len(word) for cell in cells for word in cell.split() if re.search(r"\d", word)), default=1))
        table.add_column(name, overflow="fold", no_wrap=name in content.whole)
    for row in rows:
        table.add_row(*row)
    room = console.width - len(most) - 1
    fits = room >= sum(least)
    low, high = (least, most) if fits else (firm, least)
    spare = room - sum(low)
    apart = int(fits and spare >= len(most))
    table.padding, spare = (0, apart, 0, 0), spare - apart * len(most)
    if 0 <= spare < sum(high) - sum(low):
        for column, word, line in zip(table.columns, low, high, strict=True):
            column.width = word + spare * (line - word) // (sum(high) - sum(low))
    return table


EVERY_S = 30.0
"""Time between two lines about long work where standard error is no terminal."""


@dataclass(eq=False)
class _Stretch:
    """A stretch of work: what is at hand, and how much of it is done."""

    text: str
    total: float | None
    done: float = 0.0

    def __call__(self, done: float | None = None, total: float | None = None, text: str | None = None) -> None:
        self.text, self.total = text or self.text, self.total if total is None else total
        self.done = self.done if done is None else done

    @property
    def unfinished(self) -> bool:
        return self.total is None or self.done < self.total


class Bars:
    """Bars on standard error, one below the other, gone when done; a line now and then where none can be shown."""

    def __init__(self) -> None:
        self._shown: Progress | None = None
        self._at_work: list[_Stretch] = []

    @contextmanager
    def _lines(self, text: str, total: float | None) -> Iterator[Step]:
        """Write a line now and then, until the first of the stretches ends, about the first that is not finished."""
        stretch, ended, first = _Stretch(text, total), Event(), not self._at_work

        def write() -> None:
            for number in count(1):
                if ended.wait(EVERY_S):
                    return
                current = next((each.text for each in self._at_work if each.unfinished), text)
                sys.stderr.write(f"tactuator: {visible(current)}, {number * EVERY_S:g} s\n")
                sys.stderr.flush()

        self._at_work.append(stretch)
        if first:
            Thread(target=write, daemon=True).start()
        try:
            yield stretch
        finally:
            self._at_work.remove(stretch)
            ended.set()

    @contextmanager
    def __call__(self, text: str, total: float | None) -> Iterator[Step]:
        """Show a bar for a stretch of work."""
        console = Console(stderr=True)
        if not console.is_terminal or console.is_dumb_terminal:
            with self._lines(text, total) as step:
                yield step
            return
        with ExitStack() as stack:
            if self._shown is None:
                columns = (
                    TextColumn("{task.description}", markup=False),
                    BarColumn(),
                    MofNCompleteColumn(),
                    TimeRemainingColumn(),
                )
                self._shown = stack.enter_context(Progress(*columns, console=console, transient=True))
                stack.callback(setattr, self, "_shown", None)
            shown, task = self._shown, self._shown.add_task(visible(text), total=total)
            yield lambda done=None, total=None, text=None: shown.update(
                task, completed=done, total=total, description=None if text is None else visible(text)
            )
