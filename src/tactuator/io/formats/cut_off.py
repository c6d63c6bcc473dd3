"""Texts that end in the middle of a number: the last of a table whose writer, or whose copy, was stopped."""

from __future__ import annotations

import re
from pathlib import Path

from tactuator.io.formats.text import encoding_of

_LAST_BYTES = 8192
_ROWS_MIN = 40
_NUMBER = re.compile(r"[-+]?\d*[.,](\d+)([eE][-+]?\d+)?\"?")


def last_number_cut_off(path: Path) -> str | None:
    """Return the last number of a text that ends within it, as it stands there; None where nothing tells so.

    Many a whole file lacks the last line's end, and numbers of any length are common. So it takes both: no end of the
    last line, and a last column whose numbers have as many digits behind the point (and in the exponent) in each of the
    40 rows or more before, but not in the last.
    """
    with path.open("rb") as file:
        encoding = encoding_of(file.read(64))
        size = file.seek(0, 2)
        file.seek(max(size - _LAST_BYTES, 0) // 4 * 4)  # at a whole character, also of four bytes
        text = file.read().decode(encoding, errors="replace")
    if not text or text[-1].isspace():
        return None
    *before, last = [re.split(r"[,;\t ]+", line.strip())[-1] for line in text.splitlines()[1:]] or [""]
    digits = {_digits(cell) for cell in before}
    if len(before) < _ROWS_MIN or len(digits) != 1 or (0, 0) in digits:
        return None
    return last if _digits(last) < digits.pop() else None


def _digits(cell: str) -> tuple[int, int]:
    """Return the number of digits behind the point and of characters in the exponent; (0, 0) for another text."""
    match = _NUMBER.fullmatch(cell)
    return (0, 0) if match is None else (len(match[1]), len(match[2] or ""))
