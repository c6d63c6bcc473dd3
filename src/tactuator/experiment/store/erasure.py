"""Erasure of a person: every row of theirs, and their names in protocols and in every text that others are noted by."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, delete, or_, select, update

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import CONSENT_NAME, Found, note, subjects, versions

_NAMES = ("subject", "outside_id")
"""Items of a correction whose values are names of the person."""
_LEAST_NAME = 3
"""Characters of a number, of a fact, and of a name in any case, that are sought in texts: `12` is often another. No
name of one character is: `F` is a choice of others."""


@dataclass(frozen=True)
class Erased:
    """How much was erased of a person, and the names that were replaced in texts."""

    visits: int
    runs: int
    trials: int
    names: tuple[str, ...]


def erase(connection: Connection, study: int, code: str, now: datetime, who: str) -> Erased:
    """Delete everything of the subject of that code and leave an event that says how much, and not whose.

    Raises BadInput where there is no such subject, or a stored protocol names them where their part cannot be cut out.
    """
    person = next((row for row in subjects(connection, study) if row.code == code), None)
    if person is None:
        raise BadInput(f"subject {code!r} is not in the study", "one that is enrolled")
    codes = _codes(connection, person)
    texts = {row.id: _without(row, codes) for row in versions(connection, study)}
    names = codes | _consent_names(connection, person.id) | _own_facts(connection, person.id, texts.values())
    visits, runs, trials, tokens = _delete(connection, person.id)
    others = {name for row in subjects(connection, study) for name in (row.code, row.participant_id)}
    sought = {name for name in names - others if len(name) >= (_LEAST_NAME if name.isdigit() else 2)}
    _forget(connection, texts, _Scrub(sought | tokens, others))
    erased = Erased(visits, runs, trials, tuple(sorted(names - others)))
    detail = f"a subject with {erased.visits} visits, {erased.runs} runs and {erased.trials} trials"
    note(connection, None, "erased", detail, now, who)
    return erased


def _texts(connection: Connection, *queries: Select[Any]) -> set[str]:
    return {text for query in queries for row in connection.execute(query) for text in row if text}


def _codes(connection: Connection, person: Found) -> set[str]:
    """Return the codes and names elsewhere that the person has or had."""
    event = schema.event.c
    former = select(event.before, event.after).where(event.subject_id == person.id, event.item.in_(_NAMES))
    return _texts(connection, former) | {name for name in (person.code, person.participant_id) if name}


def _consent_names(connection: Connection, person: int) -> set[str]:
    mine = schema.event.join(schema.session, schema.event.c.session_id == schema.session.c.id)
    wanted = (schema.session.c.subject_id == person, schema.event.c.kind == CONSENT_NAME)
    return _texts(connection, select(schema.event.c.detail).select_from(mine).where(*wanted))


def _own_facts(connection: Connection, person: int, protocols: Iterable[str]) -> set[str]:
    """Return the texts noted of the person that say who it was: nobody else's facts and no protocol have them."""
    fact, event, subject = schema.demographic.c, schema.event.c, schema.subject.c
    items = select(fact.name).where(fact.subject_id == person)
    former = select(event.before, event.after).where(event.subject_id == person, event.item.in_(items))
    mine = _texts(connection, select(fact.value).where(fact.subject_id == person), former)
    groups = select(subject.subject_group).where(subject.id != person)
    others = _texts(connection, select(fact.value).where(fact.subject_id != person), groups)
    shared, protocol = set(map(str.casefold, others)), str([_read(text) for text in protocols])
    known = (text for text in mine if len(text) >= _LEAST_NAME and any(map(str.isalpha, text)))
    return {text for text in known if text.casefold() not in shared and _Scrub({text})(protocol) == protocol}


def _delete(connection: Connection, person: int) -> tuple[int, int, int, set[str]]:
    """Delete the rows of the person and return the numbers of visits, runs and trials, and tokens of links."""
    session, run, trial, event = schema.session, schema.run, schema.trial, schema.event
    visits = select(session.c.id).where(session.c.subject_id == person)
    tokens = _texts(connection, select(session.c.link_token).where(session.c.subject_id == person))
    runs = select(run.c.id).where(run.c.session_id.in_(visits))
    trials = select(trial.c.id).where(trial.c.run_id.in_(runs))

    def gone(table: Any, where: ColumnElement[bool]) -> int:
        return int(connection.execute(delete(table).where(where)).rowcount)

    void = schema.void.c
    gone(schema.void, or_(void.session_id.in_(visits), void.run_id.in_(runs), void.trial_id.in_(trials)))
    gone(schema.response, schema.response.c.trial_id.in_(trials))
    gone(schema.interval, schema.interval.c.trial_id.in_(trials))
    of_trials = gone(trial, trial.c.run_id.in_(runs))
    of_runs = gone(run, run.c.session_id.in_(visits))
    gone(event, or_(event.c.subject_id == person, event.c.session_id.in_(visits)))
    of_visits = gone(session, session.c.subject_id == person)
    gone(schema.demographic, schema.demographic.c.subject_id == person)
    gone(schema.subject, schema.subject.c.id == person)
    return of_visits, of_runs, of_trials, tokens


class _Scrub:
    """Replaces names in texts, in any case of letters; `others` are left: codes of other people."""

    def __init__(self, names: Iterable[str], others: Container[str | None] = ()) -> None:
        longest = ((name, re.escape(name)) for name in sorted(names, key=len, reverse=True))
        each = "|".join(text if len(name) < _LEAST_NAME else f"(?i:{text})" for name, text in longest)
        self._names, self._others = re.compile(rf"(?<![\w-])(?:{each})(?![\w-])" if each else r"(?!)"), others

    def __call__(self, text: str) -> str:
        return self._names.sub(lambda found: found[0] if found[0] in self._others else "erased", text)

    def protocol(self, text: str) -> str:
        """Replace the names in a protocol where it stays what it says: in comments."""
        document, lines = _read(text), text.splitlines(keepends=True)
        if document is None:  # another release's, or a damaged one: it is kept for reading alone
            return self(text)
        for place, line in enumerate(lines):
            changed = [*lines[:place], self(line), *lines[place + 1 :]]
            if changed != lines and _read("".join(changed)) == document:
                lines = changed
        return "".join(lines)


def _forget(connection: Connection, protocols: Mapping[int, str], scrub: _Scrub) -> None:
    """Replace the names in protocols, by their rows, and wherever people wrote a text."""
    version = schema.protocol_version
    for row, toml in protocols.items():
        text = scrub.protocol(toml)
        connection.execute(update(version).where(version.c.id == row).values(toml=text, sha256=protocol_hash(text)))
    for table in schema.tables.sorted_tables:
        prose = [column.name for column in table.columns if isinstance(column.type, schema.Prose)]
        for found in connection.execute(select(table)).all() if prose else ():
            texts = {name: text for name in prose if (text := found._mapping[name])}
            changed = {name: scrub(text) for name, text in texts.items()}
            if changed != texts:
                connection.execute(update(table).where(table.c.id == found.id).values(**changed))


def _read(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


_HEADER = re.compile(r"^[ \t]*+\[++[ \t]*+([\w.\"' -]++)[ \t]*+\]+", re.MULTILINE)


def _without(version: Found, codes: set[str]) -> str:
    """Return the text of a protocol without the person's part."""
    text: str = version.toml
    document = _read(text)
    if document is None:
        return text
    parts = document.get("subject", [])
    kept = [part for part in parts if not _is_of(part, codes)]
    for place in reversed([index for index, part in enumerate(parts) if _is_of(part, codes)]):
        text = _cut(text, place)
    if len(kept) != len(parts):
        text += f"\n# a subject was erased from version {version.number}\n"  # versions differ in their text
    if {**document, "subject": kept} != {"subject": [], **tomllib.loads(text)} and parts:
        got = f"version {version.number} of the protocol names the subject in a table that cannot be cut out"
        raise BadInput(got, "[[subject]] tables")
    return text


def _is_of(part: dict[str, Any], codes: set[str]) -> bool:
    return part.get("code") in codes or part.get("participant_id") in codes


def _cut(text: str, place: int) -> str:
    """Return the text without its [[subject]] table of that place, up to the next table that is no part of it."""
    headers = [(match.start(), match.group(1).replace(" ", ""), match.group(0)) for match in _HEADER.finditer(text)]
    starts = [index for index, (_, name, line) in enumerate(headers) if name == "subject" and "[[" in line]
    if place >= len(starts):
        return text
    first = starts[place]
    ends = (at for at, name, _ in headers[first + 1 :] if not name.startswith("subject."))
    return text[: headers[first][0]] + text[next(ends, len(text)) :]
