"""Rows of one store into another: nothing twice, nothing left out, whatever the rows' numbers are there.

A row is known by what it is (a trial: study, subject, visit, run, attempt, number), and how far the other store's chain
was merged stands in the same transaction as the rows: a merge that was broken off is gone on with, or done again.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection, Table, func, or_, select

from tactuator.errors import BadInput
from tactuator.experiment.store import chain, schema
from tactuator.experiment.store.chain import Head
from tactuator.experiment.store.store import Store

ENROLLED = ("study", "protocol_version", "subject", "demographic", "session", "stimulus", "response_option")
"""Tables of what a station has to know before anybody sits down at it."""
_ORDER = tuple(table for table in schema.tables.sorted_tables if table.name in schema.KEYS)
_ONCE = ("trial", "interval", "response", "stimulus", "response_option")
"""Tables whose rows never change."""
_TOLD = {"subject": ("subject_group", "participant_id"), "demographic": ("value",)}
"""Columns of what was noted of a person: two stores that have another there contradict one another."""
_CHUNK, _UNREMEMBERED = 500, 1000

Key = tuple[Any, ...]
"""A row as every store knows it: its table, and the values of its key, a row of another table being its Key."""


@dataclass(frozen=True)
class Conflict:
    """Something that two stores have, and not the same; what: in words. The one that was there first stays."""

    table: str
    what: str


@dataclass(frozen=True)
class Merged:
    """What a merge wrote: rows, and what contradicted what was there."""

    rows: int
    conflicts: tuple[Conflict, ...]


def merge(source: Store, target: Store, tables: Iterable[str] = tuple(schema.KEYS)) -> Merged:
    """Bring the rows of those tables that the target does not have yet, as they stand in the source.

    Raises BadInput where the source's chain is not the one of which a part was merged before; StoreFault where either
    store cannot be reached, and nothing is then written.
    """
    while True:
        with target.read() as connection:
            here = chain.uid(connection)
        with source.read() as connection:
            uid, last = chain.uid(connection), chain.head(connection)
            if uid == here:
                raise BadInput(f"{source.name} is {target.name}, or a copy of it", "stores of their own")
            with target.read() as other:
                since = _since(other, uid)
            if since is not None and since == last:
                return Merged(0, ())
            _check_same_chain(connection, source, since)
            rows = _Portable(connection).changed(since[0] if since else 0, here, tables)
        if not rows and since is not None and last[0] - since[0] < _UNREMEMBERED:
            return Merged(0, ())  # nothing for the target: it is spared a write
        with target.begin() as connection:
            if _since(connection, uid) != since:
                continue  # another process of the same source was quicker
            writing = _Writing(connection, uid, since is not None or set(tables) != set(schema.KEYS))
            count = sum(writing.write(table, rows[table.name]) for table in _ORDER if rows.get(table.name))
            _remember(connection, uid, last)
        return Merged(count, tuple(writing.conflicts))


class Shared:
    """The store that stations share, for the station that has this one of its own: both are there at any time, and the
    station needs its own alone.
    """

    def __init__(self, station: Store, place: str) -> None:
        self._station, self._place = station, place
        self._store: Store | None = None

    def exchange(self) -> Merged:
        """Bring what others enrolled to the station, and what was done there to the shared store.

        Raises BadInput or StoreFault where that cannot be reached: what it lacks then comes with a later call.
        """
        if self._store is None:
            self._store = Store(self._place)
        enrolled, done = merge(self._store, self._station, ENROLLED), merge(self._station, self._store)
        return Merged(enrolled.rows, enrolled.conflicts + done.conflicts)

    def close(self) -> None:
        """Let go of the shared store."""
        if self._store is not None:
            self._store.close()


def _since(connection: Connection, uid: str) -> Head | None:
    merged = schema.merged.c
    row = connection.execute(select(merged.number, merged.sha256).where(merged.uid == uid)).first()
    return None if row is None else (row.number, row.sha256)


def _remember(connection: Connection, uid: str, last: Head) -> None:
    """Write how far a chain is merged. The link of that is nothing for other stores, which are thus spared a write."""
    table, values = schema.merged, {"number": last[0], "sha256": last[1]}
    row = connection.execute(select(table.c.id).where(table.c.uid == uid)).scalar()
    if row is None:
        chain.add(connection, table, [{"uid": uid, **values}])
    else:
        chain.change(connection, table, row, values)


def _check_same_chain(connection: Connection, source: Store, since: Head | None) -> None:
    if since is None or since[0] == 0:
        return
    link = schema.chain.c
    if connection.execute(select(link.sha256).where(link.id == since[0])).scalar() != since[1]:
        raise BadInput(
            f"store {source.name} is not what {since[0]} rows of it were merged from (an older copy, perhaps)",
            "the store itself, or a new one",
        )


def _parents(table: Table) -> Mapping[str, Table]:
    return {column.name: key.column.table for column in table.c for key in column.foreign_keys}


def _primary(table: Table) -> str:
    (column,) = table.primary_key.columns
    return str(column.name)


@dataclass
class _Portable:
    """Rows of a store without its numbers."""

    connection: Connection
    _keys: dict[tuple[str, int], Key] = field(default_factory=dict)

    def changed(self, since: int, without: str, tables: Iterable[str]) -> dict[str, list[dict[str, Any]]]:
        """Return the rows written after that link, but for those that came from the store `without`, by table."""
        link, rows = schema.chain.c, dict[str, list[dict[str, Any]]]()
        for table in _ORDER:
            if table.name not in tables:
                continue
            mine = (link.id > since, link.of_table == table.name, link.origin != without)
            numbers = sorted(set(self.connection.execute(select(link.of_row).where(*mine)).scalars()))
            key = table.c[_primary(table)]
            for first in range(0, len(numbers), _CHUNK):
                query = select(table).where(key.in_(numbers[first : first + _CHUNK])).order_by(key)
                for row in self.connection.execute(query):
                    rows.setdefault(table.name, []).append(self._portable(table, row._asdict()))
        return rows

    def _portable(self, table: Table, row: Mapping[str, Any]) -> dict[str, Any]:
        parents, values = _parents(table), dict(row)
        for name, parent in parents.items():
            values[name] = None if row[name] is None else self._key(parent, row[name])
        self._keys[table.name, row[_primary(table)]] = _key_of(table, values)
        values.pop("id", None)
        return values

    def _key(self, table: Table, number: int) -> Key:
        if (table.name, number) not in self._keys:
            query = select(table).where(table.c[_primary(table)] == number)
            self._portable(table, self.connection.execute(query).one()._asdict())
        return self._keys[table.name, number]


def _key_of(table: Table, values: Mapping[str, Any]) -> Key:
    return (table.name, *(values[name] for name in schema.KEYS[table.name]))


@dataclass
class _Writing:
    """Portable rows into a store. origin: the store they are from. newer: what was noted of a person replaces what is
    there.
    """

    connection: Connection
    origin: str
    newer: bool
    conflicts: list[Conflict] = field(default_factory=list)
    _numbers: dict[Key, int | None] = field(default_factory=dict)
    _new: set[Key] = field(default_factory=set)
    _refused: set[Key] = field(default_factory=set)

    def write(self, table: Table, rows: Iterable[Mapping[str, Any]]) -> int:
        """Write rows of a table whose parents were written, and return how many of them were new or changed."""
        asked: dict[Key, dict[str, Any]] = {}
        for row in rows:
            key = _key_of(table, row)
            if not self._refused.isdisjoint([key, *(row[name] for name in _parents(table))]):
                self._refused.add(key)
            else:
                asked[key] = self._placed(table, row)
        stored = self._stored(table, [values for key, values in asked.items() if key[1] not in self._new])
        fresh, changed = dict[Key, dict[str, Any]](), 0
        for key, values in asked.items():
            there = stored.get(_key_of(table, values))
            if there is None:
                if table.name == "subject" and self._is_taken(key, values):
                    continue
                fresh[key] = self._numbered(table, values)
            else:
                self._numbers[key] = there[_primary(table)]
                changed += self._differs(table, key, there, values)
        added = chain.add(self.connection, table, list(fresh.values()), self.origin)
        for key, row_there in zip(fresh, added, strict=True):
            self._numbers[key] = row_there._mapping[_primary(table)]
            self._new.add(key)
        return len(added) + changed

    def _number(self, key: Key | None) -> int | None:
        """Return the number that a row has here. Raises BadInput where it is not here."""
        if key is None:
            return None
        if key not in self._numbers:
            table = schema.tables.tables[key[0]]
            values = self._placed(table, dict(zip(schema.KEYS[key[0]], key[1:], strict=True)))
            there = self._stored(table, [values]).get(_key_of(table, values))
            if there is None:
                raise BadInput(f"{key[0]} of rows to be merged is not there", "the store it is in as well")
            self._numbers[key] = there[_primary(table)]
        return self._numbers[key]

    def _placed(self, table: Table, values: Mapping[str, Any]) -> dict[str, Any]:
        return {name: self._number(value) if name in _parents(table) else value for name, value in values.items()}

    def _stored(self, table: Table, rows: Iterable[Mapping[str, Any]]) -> dict[Key, Mapping[str, Any]]:
        """Return what is here of those rows and of what belongs to the same: many are looked for at once."""
        belongs, stored = schema.KEYS[table.name][0], dict[Key, Mapping[str, Any]]()
        wanted = list({values[belongs] for values in rows})
        for first in range(0, len(wanted), _CHUNK):
            some, column = wanted[first : first + _CHUNK], table.c[belongs]
            query = select(table).where(or_(column.in_(some), column.is_(None)))
            stored |= {_key_of(table, row._asdict()): row._asdict() for row in self.connection.execute(query)}
        return stored

    def _is_taken(self, key: Key, values: Mapping[str, Any]) -> bool:
        """Return whether the subject's name elsewhere is another subject's here, which is told."""
        subject, outside = schema.subject.c, values["participant_id"]
        if outside is None:
            return False
        mine = (subject.study_id == values["study_id"], subject.participant_id == outside)
        other = self.connection.execute(select(subject.code).where(*mine)).scalar()
        if other is not None:
            self._refuse(key, f"subject {values['code']} has the participant id of subject {other}")
        return other is not None

    def _numbered(self, table: Table, values: dict[str, Any]) -> dict[str, Any]:
        if table is schema.protocol_version:
            number = select(func.max(table.c.number)).where(table.c.study_id == values["study_id"])
            values["number"] = (self.connection.execute(number).scalar() or 0) + 1
        return values

    def _refuse(self, key: Key, what: str) -> None:
        self._refused.add(key)
        self.conflicts.append(Conflict(key[0], what))

    def _differs(self, table: Table, key: Key, there: Mapping[str, Any], values: Mapping[str, Any]) -> int:
        """Settle a row that both stores have; 1 where it was changed here."""
        if table is schema.session:
            return self._session(key, there, values)
        if table is schema.run:
            over = {} if values["state"] == "running" else {name: values[name] for name in ("state", "ended_utc")}
            return self._change(table, there, over)
        if table.name in _TOLD:
            noted = {name: values[name] for name in _TOLD[table.name] if values[name] != there[name]}
            if self.newer or not noted:
                return self._change(table, there, noted)
            self.conflicts += [
                Conflict(table.name, f"{_words(key)}: {name} is {there[name]!r} there and {noted[name]!r} here")
                for name in noted
            ]
        elif table.name in _ONCE and any(values[name] != there[name] for name in values):
            self.conflicts.append(Conflict(table.name, f"{_words(key)}: another one of the same number"))
        return 0

    def _session(self, key: Key, there: Mapping[str, Any], values: Mapping[str, Any]) -> int:
        """A visit belongs to the store in which it began; before that, to the one that was merged first."""
        if values["held_by"] is None:
            return self._change(schema.session, there, dict(values)) if self.newer and there["held_by"] is None else 0
        if there["held_by"] not in (None, values["held_by"]):
            self._refuse(key, f"{_words(key)} was begun in two stores")
            return 0
        return self._change(schema.session, there, {n: value for n, value in values.items() if value is not None})

    def _change(self, table: Table, there: Mapping[str, Any], values: Mapping[str, Any]) -> int:
        differ = {name: value for name, value in values.items() if value != there[name]}
        if differ:
            chain.change(self.connection, table, there[_primary(table)], differ, self.origin)
        return bool(differ)


def _words(key: Key) -> str:
    """Return a key for a person: `subject S1, visit 2`."""
    mine = ", ".join(str(part) for part in key[1:] if not isinstance(part, tuple))
    parents = [part for part in key[1:] if isinstance(part, tuple)]
    of = next((part for part in parents if part[0] not in ("study", "protocol_version")), ())
    return (f"{_words(of)}, " if of else "") + f"{'visit' if key[0] == 'session' else key[0]} {mine}".strip()
