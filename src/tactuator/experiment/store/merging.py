"""Copying the studies of several stores into one."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Column, Connection, Table, func, insert, select

from tactuator.errors import BadInput
from tactuator.experiment.store import schema

_ROWS = 1000
"""Rows that are in memory at a time."""


def copy_studies(source: Connection, target: Connection) -> None:
    """Copy every row of the source behind those of the target; ids go on from the target's.

    Raises BadInput for a visit that is in both: one store is then a copy of the other, or of a part of it.
    """
    token = schema.session.c.link_token
    taken = set(target.execute(select(token)).scalars())
    twice = [visit for visit in source.execute(select(token)).scalars() if visit in taken]
    if twice:
        raise BadInput(f"{len(twice)} of its visits are in another of the stores too", "stores of different visits")
    tables = [table for table in schema.tables.sorted_tables if table is not schema.schema_version]
    last = {table.name: _last_id(target, table) for table in tables if "id" in table.c}
    for table in tables:
        added = {column.name: last[of] for column in table.columns if (of := _numbered_by(column)) is not None}
        order = table.primary_key.columns
        for rows in source.execute(select(table).order_by(*order)).mappings().partitions(_ROWS):
            target.execute(insert(table), [_renumbered(dict(row), added) for row in rows])


def _last_id(connection: Connection, table: Table) -> int:
    return int(connection.execute(select(func.coalesce(func.max(table.c.id), 0))).scalar_one())


def _numbered_by(column: Column[Any]) -> str | None:
    """Return the table of whose rows the column holds the id, or None."""
    for key in column.foreign_keys:
        return str(key.column.table.name)
    return str(column.table.name) if column.name == "id" else None


def _renumbered(row: dict[str, Any], added: dict[str, int]) -> dict[str, Any]:
    return row | {name: row[name] + more for name, more in added.items() if row[name] is not None}
