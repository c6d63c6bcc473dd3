"""Where a text has its table: the rows of numbers under any head, the names over them, and how cells are parted."""

from __future__ import annotations

import re
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from tactuator.errors import BadInput
from tactuator.io.cells import cell_pair, cell_value, check_commas, is_comment, is_empty, is_stamp, pair_units, parts
from tactuator.io.column_name import changes_values, column_name, is_units, unit_of

DELIMITERS = ("\t", ";", ",", None)
_FIRST_ROWS = 200
_MOST_COLUMNS = 2000
"""Columns of a table; a line of more is not looked at, as an HDF5 file of more datasets is not."""
_TEXT_COSTS = 0.75
"""Numbers that a cell of text counts against, where the mark between cells is sought."""
_OF_TOUCHSTONE = {"hz", "khz", "mhz", "ghz", "s", "y", "z", "h", "g", "ma", "db", "ri", "r"}
_FORMATS = {"MA": ("magnitude", "deg"), "DB": ("dB", "deg"), "RI": ("real", "imag")}
_UNNAMED = {
    ".frd": ("frequency (Hz)", "magnitude (dB)", "phase (deg)"),
    ".zma": ("frequency (Hz)", "impedance (ohm)", "phase (deg)"),
}
"""Columns of formats that may come without names."""
_KNOWN = (
    "freq", "time", "phas", "magn", "ampl", "gain", "mag", "real", "imag", "command", "posit", "input", "output",
    "coher", "displ", "veloc", "accel", "voltage", "current", "spl", "level", "ch",
)  # fmt: skip
_LETTERS = {"t", "u", "y", "f", "x", "hz", "db", "re", "im", "in", "out", "deg", "ref"}


@dataclass(frozen=True)
class Layout:
    """How a table is written. delimiter: between cells, None for blanks; head: lines before the rows of numbers;
    width: cells of a row; names, units: of the columns; pairs: cells of two numbers each, by their place; head_hz:
    rates that the head states, hertz by its words; changes: what it states that may change the values.
    """

    delimiter: str | None
    head: int
    width: int
    names: tuple[str, ...]
    units: dict[str, str] = field(default_factory=dict)
    pairs: frozenset[int] = frozenset()
    has_decimal_commas: bool = False
    head_hz: Mapping[str, float] = field(default_factory=dict)
    changes: tuple[str, ...] = ()

    def is_row(self, line: str) -> bool:
        """Return whether a line below the head is one of the table."""
        return not line.isspace() and not is_comment(line, self.delimiter)

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line."""
        return parts(line, self.delimiter)


@dataclass(frozen=True)
class _Row:
    """A line as cells: how many are numbers, and how many texts."""

    place: int
    cells: list[str]
    numbers: int
    texts: int

    @property
    def is_numeric(self) -> bool:
        return self.numbers > 0 and (self.numbers > self.texts or self.numbers > 1)


def find_layout(lines: Sequence[str], ending: str = "") -> Layout | None:
    """Return the layout of the table in the first lines of a text, None where there are no rows of numbers.

    ending: of the file's name, which says what columns without names are. Raises BadInput for a row that has fewer
    cells, and for names of another number than the columns.
    """
    rows, delimiter = _parted(lines)
    numeric = [row for row in rows if row.is_numeric][-_FIRST_ROWS:]
    if not numeric:
        if (widest := max((len(row.cells) for row in rows), default=0)) > _MOST_COLUMNS:
            raise BadInput(f"a row of {widest} cells", f"up to {_MOST_COLUMNS} columns")
        return None
    width = statistics.mode(len(row.cells) for row in numeric)
    among = [row.cells for row in numeric if len(row.cells) == width]
    usual = [k for k in range(width) if 2 * sum(_is_number(cells[k]) for cells in among) > len(among)]
    blank = [k for k in range(min(usual, default=0)) if 2 * sum(is_empty(cells[k]) for cells in among) > len(among)]
    # a line that has something there is one of the head
    start = _start([row for row in rows if not _fills(row, blank)], width, usual)
    if start is None:
        return None
    below = [row.cells for row in rows if row.place >= start and len(row.cells) == width]
    check_commas([cell for cells in below for cell in cells])
    pairs = {k: halves for k in range(width) if (halves := pair_units([cells[k] for cells in below]))}
    head = lines[:start]
    touchstone = _touchstone(head, width)
    is_spare = not any(cells[-1] for cells in below)
    names, units = (touchstone, ()) if touchstone else _names(head, delimiter, width, len(pairs), is_spare)
    if not names and ending in _UNNAMED and width <= 3:
        names = _UNNAMED[ending][:width]
    _require_names(names, head, delimiter, width)
    named = _expanded(names, pairs, width)
    commas = delimiter != "," and any("," in cell for cells in below for cell in cells)
    by_name = dict(zip(named, units, strict=False)) if len(units) == len(named) else {}
    if not pairs:
        by_name |= {name: "s" for k, name in enumerate(named) if _is_clock(name, [cells[k] for cells in below])}
    return Layout(
        delimiter, start, width, named, by_name, frozenset(pairs), commas, _stated_rates(head), _changes(head)
    )


def _is_clock(name: str, cells: Sequence[str]) -> bool:
    """Return whether a column has dates or times of day, which are read in seconds, and no unit in its name."""
    given = [cell for cell in cells if not is_empty(cell)]
    return (
        bool(given)
        and all(":" in cell and cell_value(cell) is not None for cell in given)
        and not column_name(name).unit.kind
    )


_STEP = re.compile(
    r"(?i)\b(?:(delta_?x|[xt]_?inc\w*|dt|(?:sampl\w*|time|horizontal)[ _-]*(?:interval|step|period|increment))"
    r"|fs|sampl\w*[ _-]*freq\w*|[\w \t-]*rate)\b"
    r"[ \t]*(?:[\[(](?P<unit>[^\])]*)[\])])?[\s:=;,\"]*(?:[a-z]+:)?([-+\d.,e]*\d)[ \t]*(?P<behind>[a-zA-Z\u00b5]*)"
)
"""A step of time or a sampling rate with its value, as heads have it, and its unit before or behind it."""
_MOST_OF_HEAD = 1000
"""Characters of a line in which that is looked for: the search takes time by the square of their number."""


_NO_SAMPLING = re.compile(r"(?i)baud|bit|frame|heart|flow|refresh|update|slew|error|feed|data rate")


_STATEMENT = re.compile(r"[\s#%*;!\"]*([A-Za-z][\w .()/-]{0,80}?)\s*[:=]\s*([^\n]{1,80})")
_OF_INSTRUMENT = re.compile("(?i)vertical|horizontal|probe|trigger|axis|scaling mode")


def _changes(head: Sequence[str]) -> tuple[str, ...]:
    """Return what a head states that may change the values, but for an instrument's settings."""
    stated = (found for found in map(_STATEMENT.match, head) if found and not _OF_INSTRUMENT.search(found[1]))
    return tuple(f"{found[1]} {found[2].strip()}" for found in stated if changes_values(found[1], found[2]))


def _stated_rates(head: Sequence[str]) -> dict[str, float]:
    """Return the sampling rates that a head states, hertz by line, words and unit."""
    rates: dict[str, float] = {}
    for number, found in enumerate((_STEP.search(line[:_MOST_OF_HEAD]) for line in head), start=1):
        if found is None or _NO_SAMPLING.search(found[0]):
            continue
        step, text = found[1], found["unit"] or found["behind"]
        value, unit = cell_value(found[3].rstrip(",")), unit_of(text) if text else None
        if value and value > 0.0 and (not text or (unit and unit.kind == ("time" if step else "frequency"))):
            size = value * (unit.factor if unit else 1.0)
            words = re.split(r"[\[(:=,;]", found[0])[0].strip()
            rates[f"line {number}, {words}" + (f" ({text})" if text else "")] = 1.0 / size if step else size
    return rates


def _parted(lines: Sequence[str]) -> tuple[list[_Row], str | None]:
    """Return the lines as rows of cells, parted as gives the most numbers, and the mark that parts them."""
    best: tuple[float, list[_Row], str | None] = (-1.0, [], None)
    for delimiter in DELIMITERS:
        if delimiter is None or any(delimiter in line for line in lines):
            rows = list(_rows(lines, delimiter))
            score = sum(row.numbers - _TEXT_COSTS * row.texts for row in rows if row.is_numeric)
            if score > best[0]:
                best = (score, rows, delimiter)
    return best[1], best[2]


def _rows(lines: Sequence[str], delimiter: str | None) -> Iterator[_Row]:
    for place, line in enumerate(lines):
        if line.isspace() or is_comment(line, delimiter):
            continue
        cells = parts(line, delimiter)
        given = [cell for cell in cells if not is_empty(cell)] if len(cells) <= _MOST_COLUMNS else []
        numbers = sum(map(_is_number, given))
        texts = sum(not _is_number(cell) and not is_stamp(cell) for cell in given)
        yield _Row(place, cells, numbers, texts)


def _is_number(cell: str) -> bool:
    return cell_value(cell) is not None or cell_pair(cell) is not None


def _fills(row: _Row, places: Sequence[int]) -> bool:
    return any(k < len(row.cells) and not is_empty(row.cells[k]) for k in places)


def _start(rows: Sequence[_Row], width: int, usual: Sequence[int]) -> int | None:
    """Return the line of the first row: it has the usual cells, most of them numbers, the first of them as well. Raises
    BadInput where the line above is one of numbers, but fewer or more.
    """
    above: _Row | None = None
    for row in rows:
        given = [row.cells[k] for k in usual if not is_empty(row.cells[k])] if len(row.cells) == width else []
        numbers = [_is_number(cell) for cell in given]
        if given and numbers[0] and 2 * sum(numbers) > len(numbers):
            if above is not None and above.texts == 0 and above.numbers > 1:
                got = f"row 1 has {len(above.cells)} of {width} columns"
                raise BadInput(got, "as many in each ('#' before lines that are no rows)")
            return row.place
        above = row
    return None


def _touchstone(head: Sequence[str], width: int) -> tuple[str, ...]:
    """Return the columns of one or two ports that a Touchstone file's line of options says; none for other files."""
    for line in head:
        words = line.strip().removeprefix("#").casefold().split()
        options = [word for word in words if not re.fullmatch(r"[\d.]+", word)]
        if not line.lstrip().startswith("#") or width not in (3, 9) or not set(options) <= _OF_TOUCHSTONE or not words:
            continue
        hertz = next((word for word in options if word.endswith("hz")), "ghz")
        kind = next((word.upper() for word in options if word.upper() in _FORMATS), "MA")
        letter = next((word.upper() for word in options if word in "syzhg"), "S")
        swapped = any(re.match(r"(?i)\s*\[two-port data order\]\s*12_21", line) for line in head)
        ports = ("11",) if width == 3 else ("11", "12", "21", "22") if swapped else ("11", "21", "12", "22")
        pairs = [f"{letter}{port} ({half})" for port in ports for half in _FORMATS[kind]]
        return (f"frequency ({'Hz' if hertz == 'hz' else hertz[0].upper().replace('K', 'k') + 'Hz'})", *pairs)
    return ()


def _names(
    head: Sequence[str], delimiter: str | None, width: int, pairs: int, is_spare: bool
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the columns and their units, where the lines above say them: the nearest that has as many
    cells as a row; in a remark, or farther off, only where one of them is a word for a column.

    is_spare: whether the last column is empty, for which there may be no name.
    """
    units: tuple[str, ...] = ()
    is_nearest = True
    for line in reversed(head):
        if not re.search(r"\w|\u00b0", line):
            continue
        is_remark = is_comment(line, delimiter)
        for number, cells in enumerate(_headings(line, delimiter, is_remark)):
            cells = _trimmed(cells, width)
            if len(cells) not in {width, width + pairs, width - is_spare}:
                continue
            if not units and is_units(cells):
                units = tuple(cells)
                break
            if any(map(_is_known, cells)) or (is_nearest and not is_remark and number == 0):
                return tuple(cells), units
        is_nearest = is_nearest and (is_remark or bool(units))
    return units, ()


def _headings(line: str, delimiter: str | None, is_remark: bool) -> Iterator[list[str]]:
    """Yield the cells of a line of names: parted as the rows are, then in other ways."""
    plain = line.strip("\r\n ").lstrip("\ufeff")
    plain = plain.lstrip("#*!%; \t") if is_remark else plain
    yield parts(plain, delimiter)
    yield re.split(r"\s{2,}|\t", plain)
    yield re.findall(r"[^\s\[(]++(?:\s*+[\[(][^\])]{0,200}[\])])*+", plain)
    for mark in ("\t", ";", ","):
        yield plain.split(mark)


def _trimmed(cells: Sequence[str], width: int) -> list[str]:
    """Return names without blanks and quotes, and without a last one that no row has a cell for."""
    names = [cell.strip(" '\"\t") for cell in cells]
    while len(names) > width and names[-1].casefold() in ("", "comment"):
        names.pop()
    return names


def _is_known(cell: str) -> bool:
    """Return whether a cell is like the name of a column."""
    try:
        name = column_name(cell)
    except BadInput:
        return True
    return bool(name.unit.kind) or name.has(*_KNOWN) or bool(name.words & _LETTERS)


def _require_names(names: Sequence[str], head: Sequence[str], delimiter: str | None, width: int) -> None:
    """Raise BadInput for a line of names right above the rows, of another number than the columns."""
    given = [line for line in head if not line.isspace() and not is_comment(line, delimiter)]
    if names or not given:
        return
    cells = _trimmed(parts(given[-1], delimiter), width)
    if len(cells) > 1 and any(map(_is_known, cells)):
        raise BadInput(f"{len(cells)} names over {width} columns", "a name for each")


def _expanded(names: Sequence[str], pairs: dict[int, tuple[str, str]], width: int) -> tuple[str, ...]:
    """Return a name for each number of a row, no two alike."""
    if len(names) != width + len(pairs) or not pairs:
        whole = [names[k] if k < len(names) and names[k] else f"column{k + 1}" for k in range(width)]
        names = [
            name
            for k, each in enumerate(whole)
            for name in ([f"{each} ({half})" for half in pairs.get(k, ())] or [each])
        ]
    taken: dict[str, int] = {}
    unlike = []
    for name in names:
        taken[name] = taken.get(name, 0) + 1
        unlike.append(name if taken[name] == 1 else f"{name}.{taken[name]}")
    return tuple(unlike)
