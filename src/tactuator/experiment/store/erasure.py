"""Erasure of a person: every row of theirs, and their names in protocols and in what remains of the log of events."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, delete, or_, select, update

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Found, note, subjects, versions

_NAMES = ("subject", "outside_id")
"""Items of a correction whose values are names of the person."""
_LEAST_NAME = 3
"""Digits of a number that is taken for a name in the text of other events: `1` is more often something else."""


@dataclass(frozen=True)
class Erased:
    """How much was erased of a person."""

    visits: int
    runs: int
    trials: int


def erase(connection: Connection, study: int, code: str, now: datetime, who: str) -> Erased:
    """Delete everything of the subject of that code and leave an event that says how much, and not whose.

    Raises BadInput where there is no such subject, or a stored protocol names them where their part cannot be cut out.
    """
    person = next((row for row in subjects(connection, study) if row.code == code), None)
    if person is None:
        raise BadInput(f"subject {code!r} is not in the study", "one that is enrolled")
    names = _names(connection, person)
    texts = {row.id: _without(row, names) for row in versions(connection, study)}
    erased = _delete(connection, person.id)
    for version, text in texts.items():
        changed = {"toml": text, "sha256": protocol_hash(text)}
        table = schema.protocol_version
        connection.execute(update(table).where(table.c.id == version).values(**changed))
    _forget(connection, names)
    detail = f"a subject with {erased.visits} visits, {erased.runs} runs and {erased.trials} trials"
    note(connection, None, "erased", detail, now, who)
    return erased


def _names(connection: Connection, person: Found) -> set[str]:
    """Return what the person is or was called: code, name elsewhere, and tokens of links."""
    event, session = schema.event.c, schema.session.c
    mine = select(event.before, event.after).where(event.subject_id == person.id, event.item.in_(_NAMES))
    former = [name for row in connection.execute(mine) for name in row]
    tokens = connection.execute(select(session.link_token).where(session.subject_id == person.id)).scalars()
    return {name for name in (person.code, person.participant_id, *former, *tokens) if name}


def _delete(connection: Connection, person: int) -> Erased:
    session, run, trial, event = schema.session, schema.run, schema.trial, schema.event
    visits = select(session.c.id).where(session.c.subject_id == person)
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
    return Erased(of_visits, of_runs, of_trials)


def _forget(connection: Connection, names: Iterable[str]) -> None:
    """Replace the names in the events of others and of the study."""
    event, known = schema.event, [name for name in names if len(name) >= _LEAST_NAME or not name.isdigit()]
    if not known:
        return
    for row in connection.execute(select(event)).all():
        texts = {name: row._mapping[name] for name in ("who", "detail", "before", "after")}
        changed = {name: _scrubbed(text, known) for name, text in texts.items() if text}
        if any(texts[name] != text for name, text in changed.items()):
            connection.execute(update(event).where(event.c.id == row.id).values(**changed))


def _scrubbed(text: str, names: Iterable[str]) -> str:
    each = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    return re.sub(rf"(?<![\w-])(?:{each})(?![\w-])", "erased", text)


_HEADER = re.compile(r"^[ \t]*+\[++[ \t]*+([\w.\"' -]++)[ \t]*+\]+", re.MULTILINE)


def _without(version: Found, names: set[str]) -> str:
    """Return the text of a protocol without the person's part, and without their names in its comments."""
    text = version.toml
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError:  # another release's, or a damaged one: it is kept for reading alone
        return _scrubbed(text, names)
    parts = document.get("subject", [])
    kept = [part for part in parts if not _is_of(part, names)]
    for place in reversed([index for index, part in enumerate(parts) if _is_of(part, names)]):
        text = _cut(text, place)
    if len(kept) != len(parts):
        text += f"\n# a subject was erased from version {version.number}\n"  # versions differ in their text
    if {**document, "subject": kept} != {"subject": [], **tomllib.loads(text)} and parts:
        got = f"version {version.number} of the protocol names the subject in a table that cannot be cut out"
        raise BadInput(got, "[[subject]] tables")
    scrubbed = _scrubbed(text, names)
    return scrubbed if tomllib.loads(scrubbed) == tomllib.loads(text) else text


def _is_of(part: dict[str, Any], names: set[str]) -> bool:
    return part.get("code") in names or part.get("participant_id") in names


def _cut(text: str, place: int) -> str:
    """Return the text without its [[subject]] table of that place, up to the next table that is no part of it."""
    headers = [(match.start(), match.group(1).replace(" ", ""), match.group(0)) for match in _HEADER.finditer(text)]
    starts = [index for index, (_, name, line) in enumerate(headers) if name == "subject" and "[[" in line]
    if place >= len(starts):
        return text
    first = starts[place]
    ends = (at for at, name, _ in headers[first + 1 :] if not name.startswith("subject."))
    return text[: headers[first][0]] + text[next(ends, len(text)) :]
