"""Results: one list of facts each, from which come the summary, the tables, JSON, HTML in a notebook and `repr`."""

import dataclasses
import html
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput, visible
from tactuator.plain import finite

_LONGEST = 499
_LINES = 10
"""A summary has no more."""
FREQUENCY = "frequency (Hz)"
NOBODY_FELT_IT = "simulated: nobody felt this"
"""What a table or figure of simulated subjects says in itself."""


@dataclass(frozen=True, eq=False)
class Fact:
    """A figure or a sentence of a result.

    Parameters
    ----------
    name: its key in JSON; "" where text alone has it.
    value: what JSON has; in text, a number by its form, True and False as yes and no.
    words: its name in text; "" where JSON alone has it.
    unit, form: of a number in text.
    summary: whether the summary has it; otherwise the tables of `--full` alone.
    """

    name: str
    value: Any
    words: str = ""
    unit: str = ""
    form: str = ".4g"
    summary: bool = False

    @property
    def text(self) -> str:
        """Return the value as a person reads it, with its unit."""
        if isinstance(self.value, bool):
            return "yes" if self.value else "no"
        number = f"{self.value:{self.form}}" if isinstance(self.value, float) else str(self.value)
        return f"{number} {self.unit}" if self.unit else number


def found(words: str, value: object, unit: str = "", form: str = ".4g") -> Fact:
    """Return a fact of the summary which JSON has in another form."""
    return Fact("", value, words, unit, form, summary=True)


def data(document: Mapping[str, Any]) -> list[Fact]:
    """Return the entries of a document as facts of JSON alone."""
    return [Fact(name, value) for name, value in document.items()]


def fields_of(result: Any) -> dict[str, Any]:
    """Return the fields of a dataclass by name, but those with repr=False."""
    return {field.name: getattr(result, field.name) for field in dataclasses.fields(result) if field.repr}


@dataclass(frozen=True)
class ResultTable:
    """A table of results. notes: lines below the table; whole: columns whose cells are never broken."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Column:
    """A column of a result's table, as data and as text.

    Parameters
    ----------
    name: its key, with the unit.
    values: one for each row.
    words: its heading in text; "" where data alone has it.
    form: of a number in text, or what writes a value.
    half: half-widths of the values, which text has behind ±.
    """

    name: str
    values: Sequence[Any]
    words: str = ""
    form: str | Callable[[Any], str] = ".4g"
    half: Sequence[float] | None = None

    @property
    def cells(self) -> list[str]:
        """Return the values as a person reads them."""
        cells = [self._cell(value) for value in self.values]
        return (
            cells
            if self.half is None
            else [f"{cell} ± {half:.2g}" for cell, half in zip(cells, self.half, strict=True)]
        )

    def _cell(self, value: Any) -> str:
        if callable(self.form):
            return self.form(value)
        return f"{value:{self.form}}" if isinstance(value, float) else str(value)


def columns_of(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[Column]:
    """Return the columns of a table that data alone has, from its rows."""
    cells = [[value.item() if hasattr(value, "item") else value for value in row] for row in rows]
    return [Column(name, [row[k] for row in cells]) for k, name in enumerate(names)]


def text_table(columns: Sequence[Column], caption: str = "", notes: Sequence[str] = ()) -> ResultTable:
    """Return the columns that text has."""
    shown = [column for column in columns if column.words]
    rows = tuple(zip(*(column.cells for column in shown), strict=True))
    return ResultTable(caption, tuple(column.words for column in shown), rows, tuple(notes))


def rows_of(columns: Sequence[Column]) -> list[dict[str, Any]]:
    """Return the rows of a table, each by the columns' names."""
    rows = zip(*(column.values for column in columns), strict=True)
    return [dict(zip((column.name for column in columns), row, strict=True)) for row in rows]


@dataclass(frozen=True, eq=False)
class ChartLine:
    """A curve of a chart.

    label: in the legend ("": none). x, y: (n,). half: of the 95 % confidence of y, (n,), or (2, n) below and above; a
    band about a line, bars at marks. style: as matplotlib writes it ("-", "--", "o", "o-"). crossed: points that do not
    count, (n,). colour: its place in the palette, another colour, or None for the next. right: has the axis at the
    right. width: of the line, points.
    """

    label: str
    x: Any
    y: Any
    style: str = "-"
    half: Any = None
    crossed: Any = None
    colour: Any = None
    right: bool = False
    width: float = 1.4


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves on one pair of axes, with what they are held against.

    x_label, y_label, right_label: with units. targets: levels that were asked for. tolerance, jnd: half-widths about
    each target, of what is allowed and of what is not felt. limits: other levels, by name; upright: the same on the
    axis of x; stretches: parts of that axis, by name. log_x: x is a frequency in hertz. log_y: y is a magnitude, above
    0. y_range: ends of the axis, None where the curves decide; y_step: between its marks, 0 for any. title: above a
    panel. simulated: nobody felt what it shows.
    """

    x_label: str
    y_label: str
    curves: Sequence[ChartLine]
    log_x: bool = False
    targets: Sequence[float] = ()
    tolerance: float | None = None
    jnd: float | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    upright: Mapping[str, float] = field(default_factory=dict)
    right_label: str = ""
    simulated: bool = False
    log_y: bool = False
    stretches: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    y_range: tuple[float | None, float | None] = (None, None)
    y_step: float = 0.0
    title: str = ""


class Result:
    """A result: its facts, and what they become; `plot`, `to_dataframe` where it has curves or a table.

    `holds` is the verdict: the only place from which the command line's status 1 comes. By default the facts are the
    fields of the dataclass, but those with repr=False.
    """

    def facts(self) -> Sequence[Fact]:
        """Return every figure of the result, once."""
        return [
            Fact(name, value, name.replace("_", " "), summary=True)
            if isinstance(value, str | int | float | Path)
            else Fact(name, value)
            for name, value in fields_of(self).items()
        ]

    def next_step(self) -> str:
        """Return what to do next on the command line, if anything is to be said of that."""
        return ""

    def table(self) -> Sequence[Column]:
        """Return the columns of the result's table, if it has one."""
        return ()

    def tables(self) -> Sequence[ResultTable | str]:
        """Return the tables and lines that `--full` prints below the facts."""
        columns = self.table()
        return [text_table(columns)] if columns and columns[0].values else []

    def columns(self) -> Mapping[str, Any]:
        """Return the table's columns of equal length, units in the names; raises BadInput where it is no table."""
        columns = self.table()
        if not columns:
            raise BadInput(f"{type(self).__name__} is no table: use to_dict()")
        return {column.name: column.values for column in columns}

    def chart(self) -> Chart:
        """Return what `plot` draws; raises BadInput where there is nothing to draw."""
        raise BadInput(f"{type(self).__name__} has nothing to draw: use to_dict()")

    def notices(self) -> Sequence[str]:
        """Return lines for standard error: doubts about the result."""
        return ()

    @property
    def holds(self) -> bool:
        """Return False where the verdict is no: the command line then ends with status 1."""
        return True

    @property
    def ending(self) -> BaseException | None:
        """Return what the command line raises once the result is printed: a part of it that is missing."""
        return None

    def headline(self) -> Mapping[str, str]:
        """Return the facts of the summary, each with its unit."""
        return {fact.words: fact.text for fact in self.facts() if fact.summary and fact.value is not None}

    def to_dict(self) -> dict[str, Any]:
        """Return the result in JSON's own types (infinite and undefined numbers as None): what `--json` prints."""
        return {fact.name: finite(fact.value) for fact in self.facts() if fact.name}

    def all_tables(self) -> Sequence[ResultTable | str]:
        """Return what `--full` prints: a table of the facts, then the others."""
        rows = tuple((fact.words, fact.text) for fact in self.facts() if fact.words and fact.value is not None)
        return [*([ResultTable("", ("what", "value"), rows)] if rows else []), *self.tables()]

    def to_dataframe(self) -> Any:
        """Return the table as a pandas.DataFrame; BadInput where pandas is not installed, or there is no table."""
        columns = self.columns()
        try:
            pandas = import_module("pandas")
        except ImportError:
            raise BadInput("pandas is not installed: pip install pandas, or use to_dict()") from None
        return pandas.DataFrame(dict(columns))

    def plot(self, ax: Any = None) -> Any:
        """Draw the result into `ax` (None: the current axes of matplotlib) and return the axes."""
        # matplotlib takes a second to load, and only `report` draws
        return import_module("tactuator.report.chart").draw(self.chart(), ax)

    def summary_lines(self, below: Sequence[str] = (), width: int = 80, more: str = "to_dict()") -> list[str]:
        """Return at most ten lines: what was found, and what is `below` it; more: where the rest is."""
        last = _wrapped(below, width)
        shown = (fact for fact in self.facts() if fact.summary and fact.value is not None)
        findings = [f"{fact.words}: {fact.text}" for fact in shown]
        lines, room = _wrapped(findings, width), _LINES - len(last)
        if len(lines) > room:
            lines = [*_fitting(findings, width, room - 1), f"more: {more}"]
        return [*lines, *last]

    def __repr__(self) -> str:
        return in_a_line(_name(self), self.headline())

    def __str__(self) -> str:
        return "\n".join(self.summary_lines())

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
            for name, value in self.headline().items()
        )
        return f"<table><caption>{html.escape(_name(self))}</caption>{rows}</table>"


def in_a_line(kind: str, figures: Mapping[str, str]) -> str:
    """Return figures by their words in a line of under 500 characters."""
    whole = f"<{kind} {', '.join(f'{words}: {text}' for words, text in figures.items())}>"
    return whole if len(whole) <= _LONGEST else f"{whole[: _LONGEST - 5]} ...>"


def _wrapped(texts: Sequence[str], width: int) -> list[str]:
    """Return texts as lines of a width, broken between words; a path is never broken."""
    return [
        line
        for text in texts
        for line in textwrap.wrap(
            visible(text), width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
        )
    ]


def _fitting(texts: Sequence[str], width: int, room: int) -> list[str]:
    """Return the first texts that have room, as lines; the last of them may end at one of its semicolons."""
    kept: list[str] = []
    for text in texts:
        items = text.split("; ")
        begun = ("; ".join(items[:count]) for count in range(len(items), 0, -1))
        fits = next((part for part in begun if len(_wrapped([*kept, part], width)) <= room), None)
        kept += [] if fits is None else [fits]
        if kept and fits != text:
            break
    return _wrapped(kept, width)


def _name(result: Result) -> str:
    return type(result).__name__.removesuffix("Result")
