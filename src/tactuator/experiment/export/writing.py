"""Tables as text that no spreadsheet takes for formulas, and JSON beside them."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from tactuator.experiment.export.dictionary import Meaning
from tactuator.experiment.export.rows import ExportTable, TableRow, Value

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Characters that spreadsheets take for the beginning of a formula."""


def table_text(
    table: ExportTable, separator: str = ",", missing: str = "", rows: Iterable[TableRow] | None = None
) -> str:
    """Return the table (or those of its rows) as separated values with a header; missing: of cells with nothing."""
    names = [one.name for one in table.columns]
    cells = ([cell(row[name], missing) for name in names] for row in (table.rows if rows is None else rows))
    return lines([names, *cells], separator)


def cell(value: Value, missing: str = "") -> Value:
    """Return the value as a cell: words that a spreadsheet would execute begin with an apostrophe."""
    if value is None or value == "":
        return missing
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def lines(rows: Iterable[Sequence[object]], separator: str) -> str:
    """Return rows of separated values, each line ended by a line feed."""
    stream = io.StringIO()
    csv.writer(stream, delimiter=separator, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def write_json(path: Path, document: object) -> None:
    """Write the document as indented JSON."""
    path.write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def described(columns: Iterable[Meaning]) -> dict[str, dict[str, str]]:
    """Return a BIDS side-car's description of columns."""
    return {one.name: {"Description": one.description, **({"Units": one.unit} if one.unit else {})} for one in columns}


def label(text: str) -> str:
    """Return the text as a label in a file's name may be: letters and digits."""
    return re.sub(r"[^A-Za-z0-9]", "", text)
