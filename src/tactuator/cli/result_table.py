"""A table of results on a terminal."""

from __future__ import annotations

from rich.console import Group
from rich.table import Table

from tactuator.experiment.result_tables import ResultTable


def shown(one: ResultTable) -> Group:
    """The table, and its notes below."""
    table = Table(*one.columns, title=one.caption)
    for row in one.rows:
        table.add_row(*row)
    return Group(table, *one.notes)
