"""Cells of a table's rows: numbers with a point or a comma, pairs of numbers, stamps of date and time."""

from __future__ import annotations

import csv
import re
from datetime import UTC, datetime

from tactuator.errors import BadInput

COMMENTS = "#*!%;"
_REAL = r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eEdD][-+]?\d++)?"
_NUMBER = re.compile(_REAL)
_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+")
_BOTH = re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+,\d+")
_POLAR = re.compile(rf"\(?\s*({_REAL})\s*dB\s*,\s*({_REAL})\s*([^\d\s,()]*)\s*\)?", re.IGNORECASE)
_PAIR = re.compile(rf"\(?\s*({_REAL})\s*,\s*({_REAL})\s*\)?")
_COMPLEX = re.compile(
    rf"\(?\s*({_REAL})\s*([-+])\s*(?:[ij]\s*+\*?\s*+)?({_REAL.removeprefix('[-+]?')})\s*+\*?\s*+[ij]?\s*+\)?"
)
_NOTHING = {"", "nan", "-nan", "+nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "1.#qnan", "1.#ind"}
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d+)?)?(Z|[-+]\d\d:?\d\d)?")
_STAMP = re.compile(
    r"(\d{1,4}[-/]\d{1,2}[-/]\d{1,4}|\d{1,2}\.\d{1,2}\.\d{2,4})?[T ]?(\d{1,2}:\d\d(:\d\d([.,:]\d+)?)?)? ?(Z|AM|PM)?"
)
_CLOCK = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)")
POLAR, CARTESIAN = ("dB", "deg"), ("real", "imag")


def cell_value(cell: str) -> float | None:
    """Return the number of a cell, NaN for an empty one, seconds since 1970 of a date with time and since midnight of a
    time of day; None for a text.
    """
    text = cell.strip("'\" ").replace("\u2212", "-")
    if _NUMBER.fullmatch(text):
        return float(text.upper().replace("D", "E"))
    if _COMMA.fullmatch(text):
        return float(text.replace(",", "."))
    plain = text.casefold()
    if plain in _NOTHING:
        return float("nan")
    if plain.lstrip("+-") in ("inf", "infinity"):
        return float(plain)
    if _DATE.fullmatch(text):
        try:
            read = datetime.fromisoformat(text.replace(",", "."))
        except ValueError:
            return None
        return (read if read.tzinfo else read.replace(tzinfo=UTC)).timestamp()
    if clock := _CLOCK.fullmatch(text):
        return 3600.0 * int(clock[1]) + 60.0 * int(clock[2]) + float(clock[3].replace(",", "."))
    return None


def is_empty(cell: str) -> bool:
    """Return whether a cell has nothing, or a word for it."""
    return cell.strip("'\" ").casefold() in _NOTHING


def is_stamp(cell: str) -> bool:
    """Return whether a cell may be a date, or a time of day: neither a number nor a text."""
    return bool(_STAMP.fullmatch(cell.strip("'\" ")))


def is_nearly_number(cell: str) -> bool:
    """Return whether a cell that is no number is written with the characters of one."""
    text = cell.strip("'\" ")
    return bool(re.search(r"\d", text) and re.fullmatch(r"[-+\d.,'\u2019 eE]+", text)) and not is_stamp(cell)


def cell_pair(cell: str) -> tuple[float, float] | None:
    """Return the two numbers of a cell as `(a dB, b°)`, `re,im` or `re+imj`; None for another."""
    text = cell.strip("'\" ").replace("\u2212", "-")
    if found := _POLAR.fullmatch(text) or _PAIR.fullmatch(text):
        return float(found[1]), float(found[2])
    found = _COMPLEX.fullmatch(text)
    if found and text.count("i") + text.count("j") == 1:
        return float(found[1]), float(found[2] + found[3])
    return None


def pair_units(cells: list[str]) -> tuple[str, str] | None:
    """Return what the two numbers of a column's cells are, `POLAR` or `CARTESIAN`; None for cells of another kind.

    Raises BadInput where the cells may as well be numbers with thousands.
    """
    given = [cell.strip("'\" ") for cell in cells if not is_empty(cell)]
    if not given or all(cell_value(cell) is not None for cell in given):
        return None
    if any(cell_pair(cell) is None and not _COMMA.fullmatch(cell) for cell in given):
        return None
    if all(_BOTH.fullmatch(cell) or _COMMA.fullmatch(cell) for cell in given):
        raise BadInput(f"{given[0]!r} may be thousands or two numbers", "decimal points, no thousands")
    units = {found[3].casefold() for cell in given if (found := _POLAR.fullmatch(cell))}
    if not units:
        return CARTESIAN
    return ("dB", "rad") if any(unit.startswith("rad") for unit in units) else POLAR


def check_commas(cells: list[str]) -> None:
    """Raise BadInput where the commas within numbers could as well part thousands as decimals."""
    numbers = [cell for cell in cells if re.fullmatch(r"[-+]?[\d,]*,\d+([eE][-+]?\d+)?", cell)]
    if numbers and all(_THOUSANDS.fullmatch(cell) for cell in numbers):
        raise BadInput(f"{numbers[0]!r} may be thousands or a decimal comma", "decimal points")


def decimal_point(cell: str) -> str:
    """Return the cell with a point for the decimal comma of a number; anything else as it is."""
    return cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell


def parts(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line; between blanks, without a remark at its end. Raises BadInput for an open quote."""
    line = line.strip("\r\n ") if delimiter == "\t" else line.strip()
    if delimiter is None:
        line = re.split(r"\s[!#]", line, maxsplit=1)[0]
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter or " "), [])]
    except csv.Error as error:
        raise BadInput(f"{error}", "cells of a table") from None


def is_comment(line: str, delimiter: str | None) -> bool:
    """Return whether a line is a remark; where `;` parts the cells, a line may begin with an empty one."""
    first = line.lstrip('\ufeff \t"')[:1]
    return first != "" and first in COMMENTS and first != delimiter
