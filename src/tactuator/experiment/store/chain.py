"""The chain over a store's rows: every row that is written leaves a link, and each link has the hash of the one before.

What is hashed is stated in docs/files.md, so that a program of another's can check a store.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from sqlalchemy import Boolean, Connection, Float, Row, Table, func, insert, literal_column, select, update

from tactuator.errors import BadInput
from tactuator.experiment.store import schema

Head = tuple[int, str]
"""Number and hash of a link: what has to be kept elsewhere to find that later ones were taken away."""
_READ = 5000
# made once for all trials: rows go beside a statement, not into it
_writing = cache(lambda table: insert(table).returning(table, sort_by_parameter_order=True))
_LINKING = insert(schema.chain).returning(schema.chain.c.id)  # without what it returns, a message or three a link
_LAST = select(schema.chain.c.id, schema.chain.c.sha256).order_by(schema.chain.c.id.desc()).limit(1)


def _sha256(content: object) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), default=repr)
    return hashlib.sha256(text.encode()).hexdigest()


def row_sha256(table: Table, values: Sequence[Any]) -> str:
    """Return the hash of a row's values, in the order of the table's columns, as the database holds them."""
    content = {}
    for column, value in zip(table.c, values, strict=True):
        if isinstance(column.type, Boolean) and value in (0, 1):
            value = bool(value)
        elif isinstance(column.type, Float) and isinstance(value, int):
            value = float(value)  # SQLite returns what it was given, and reads a real number
        content[column.name] = value
    return _sha256(content)


def _key(table: Table) -> Any:
    return table.primary_key.columns[0]


def add(connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]], origin: str = "") -> list[Row[Any]]:
    """Write new rows of a table with their links, and return them. origin: uid of the store they come from."""
    if not rows:
        return []
    added = write(connection, table, rows)
    link(connection, [(table, row) for row in added], origin)
    return added


def write(connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]]) -> list[Row[Any]]:
    """Write one or more new rows of a table and return them; `link` has to follow in the same transaction."""
    return list(connection.execute(_writing(table), list(rows)).all())


def change(connection: Connection, table: Table, key: int, values: Mapping[str, Any], origin: str = "") -> Row[Any]:
    """Write columns of a row, with a link, and return the row."""
    statement = update(table).where(_key(table) == key).values(**values).returning(table)
    row = connection.execute(statement).one()
    link(connection, [(table, row)], origin)
    return row


def link(connection: Connection, rows: Iterable[tuple[Table, Row[Any]]], origin: str = "") -> None:
    """Write the links of rows that were written, in the order of writing."""
    last, previous = head(connection)
    links = []
    for number, (table, row) in enumerate(rows, last + 1):
        link = (number, table.name, row[list(table.c).index(_key(table))], row_sha256(table, row), origin)
        previous = _sha256([previous, *link])
        links.append(dict(zip(schema.chain.c.keys(), (*link, previous), strict=True)))
    connection.execute(_LINKING, links)


def uid(connection: Connection) -> str:
    """Return the name that no other store has: what the first link has for the hash before it."""
    return str(connection.execute(select(schema.schema_version.c.uid)).scalar_one())


def head(connection: Connection) -> Head:
    """Return the last link; (0, the store's uid) where there is none."""
    last = connection.execute(_LAST).first()
    return (0, uid(connection)) if last is None else (last.id, last.sha256)


@dataclass(frozen=True)
class Altered:
    """A row that is not as the program wrote it.

    link: the number of its last link, None for a row without one. what: how it differs.
    """

    link: int | None
    table: str
    row: int
    what: str


def altered_rows(connection: Connection, kept: Head | None = None) -> tuple[list[Altered], Head]:
    """Return the rows that are not as they were written, in the order of their links, and the head.

    kept: a head of before. Raises BadInput for one of another form.
    """
    altered, last = _broken_links(connection, kept)
    for name, table in schema.tables.tables.items():
        if name not in schema.NOT_CHAINED:
            altered += _altered_in(connection, table)
    return sorted(altered, key=lambda each: last[0] + 1 if each.link is None else each.link), last


def _broken_links(connection: Connection, kept: Head | None) -> tuple[list[Altered], Head]:
    """Follow the chain from its beginning; where a link does not fit, those after it are taken as they stand."""
    broken: list[Altered] = []
    chain, number, previous, is_kept = schema.chain, 0, uid(connection), kept is None
    for row in _raw(connection, chain):
        if row[0] != number + 1:
            broken.append(Altered(number + 1, chain.name, number + 1, "taken away"))
        elif row[-1] != _sha256([previous, *row[:-1]]):
            broken.append(Altered(row[0], chain.name, row[0], "changed"))
        number, previous = row[0], row[-1]
        is_kept = is_kept or (number, previous) == kept
    if kept is not None and not is_kept and kept != (0, uid(connection)):
        what = "taken away" if kept[0] > number else "not the one of the head that was kept"
        broken.append(Altered(number + 1 if kept[0] > number else kept[0], chain.name, kept[0], what))
    return broken, (number, previous)


def _altered_in(connection: Connection, table: Table) -> Iterator[Altered]:
    """Hold a table's rows against their last links: both come in the order of the rows."""
    chain = schema.chain
    last = select(func.max(chain.c.id)).where(chain.c.of_table == table.name).group_by(chain.c.of_row)
    query = select(chain.c.of_row, chain.c.id, chain.c.content_sha256).where(chain.c.id.in_(last))
    every = connection.execute(query.order_by(chain.c.of_row).execution_options(yield_per=_READ))
    links = (link for link in every if isinstance(link.of_row, int))  # others are told as changed links
    place, link = list(table.c).index(_key(table)), next(links, None)
    for row in _raw(connection, table):
        key = row[place]
        while link is not None and link.of_row < key:
            yield Altered(link.id, table.name, link.of_row, "taken away")
            link = next(links, None)
        if link is None or link.of_row > key:
            yield Altered(None, table.name, key, "put in")
            continue
        if link.content_sha256 != row_sha256(table, row):
            yield Altered(link.id, table.name, key, "changed")
        link = next(links, None)
    while link is not None:
        yield Altered(link.id, table.name, link.of_row, "taken away")
        link = next(links, None)


def _raw(connection: Connection, table: Table) -> Iterable[Row[Any]]:
    """Read a table in the order of its rows, the values as the database holds them: a type would hide a change."""
    names: list[Any] = [literal_column(column.name) for column in table.c]
    query = select(*names).select_from(table).order_by(_key(table))
    return connection.execute(query.execution_options(yield_per=_READ))


def head_of(text: str) -> Head:
    """Read a head as `experiment verify` tells it, NUMBER:SHA256. Raises BadInput for another form."""
    number, _, sha256 = text.partition(":")
    if not (number.isdecimal() and sha256):
        raise BadInput(f"head {text!r}", "NUMBER:SHA256, as `experiment verify` tells it")
    return int(number), sha256
