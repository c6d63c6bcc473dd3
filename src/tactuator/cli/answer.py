"""Printing of a verb's answer: one JSON object for programs, or a table for people; progress goes to standard error."""

import dataclasses
import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from tactuator.experiment.result.tables import ResultTable


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


def plain(value: object) -> object:
    """Return the value in JSON's own types; raises TypeError for what has no counterpart there."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, Path):
        return str(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no counterpart in JSON")


def shown(one: ResultTable) -> Group:
    """Return the table with its notes below."""
    table = Table(*one.columns, title=one.caption)
    for row in one.rows:
        table.add_row(*row)
    return Group(table, *one.notes)
