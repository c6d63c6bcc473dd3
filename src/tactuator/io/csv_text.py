"""Tables as CSV that spreadsheets open: numbers stay numbers, and text of people is never executed."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable
from typing import Any

_PLAIN_NUMBER = re.compile(r"-?(\d++\.?\d*+|\.\d++)([eE][+-]?\d++)?", re.ASCII)
_EXECUTED = re.compile("[ \u00a0\ufeff\u200b]*+[-=+@\uff1d\uff0b\uff0d\uff20]|[\t\r\n]")
"""Begins a formula, also with signs of full width and after what programs pass over."""


def cell(value: Any, missing: str = "") -> Any:
    """Return the value as a cell: text that a spreadsheet would execute begins with an apostrophe. A number is none."""
    if value is None or value == "":
        return missing
    if not isinstance(value, str):
        return value
    return f"'{value}" if _EXECUTED.match(value) and not _PLAIN_NUMBER.fullmatch(value) else value


def csv_text(names: Iterable[str], rows: Iterable[Iterable[Any]], head: str = "", digits: int | None = None) -> str:
    """Return a table as CSV text, its head before it. digits: of floats; None: all that they have."""
    stream = io.StringIO()
    stream.write(head)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(map(cell, names))
    for row in rows:
        writer.writerow(f"{one:.{digits}g}" if digits and isinstance(one, float) else cell(one) for one in row)
    return stream.getvalue()
