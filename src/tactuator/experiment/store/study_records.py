"""Reading and writing of who takes part in what: studies, versions of their protocols, subjects, sessions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Select, delete, func, insert, select, update

from tactuator import __version__
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.store import schema
from tactuator.experiment.store.cells import Found, stamp

Tokens = Callable[[str, int], str]
"""A function of the subject's code and the number of the visit that returns the token of a link."""


@dataclass(frozen=True)
class NewSubject:
    """A subject to enrol; facts: (value, unit) of each demographic item by its name."""

    code: str
    group: str = "unknown"
    participant_id: str | None = None
    skin_temperature_c: float | None = None
    facts: Mapping[str, tuple[str, str]] | None = None


def add_study(connection: Connection, name: str, now: datetime) -> int:
    """Store a new study and return its id."""
    row = {"name": name, "created_utc": stamp(now)}
    return int(connection.execute(insert(schema.study).values(row).returning(schema.study.c.id)).scalar_one())


def study_by_version(connection: Connection, text: str) -> int | None:
    """Return the newest study that has had a protocol of exactly that text, or None."""
    version = schema.protocol_version
    query = select(func.max(version.c.study_id)).where(version.c.sha256 == protocol_hash(text))
    return connection.execute(query).scalar()


def study_by_name(connection: Connection, name: str) -> int | None:
    """Return the newest study of that name, or None."""
    return connection.execute(select(func.max(schema.study.c.id)).where(schema.study.c.name == name)).scalar()


def study_names(connection: Connection) -> list[str]:
    """Return the name of every study of the store once, in order."""
    return list(connection.execute(select(schema.study.c.name).distinct().order_by(schema.study.c.name)).scalars())


def versions(connection: Connection, study: int) -> list[Found]:
    """Return every version of the study's protocol, the oldest first."""
    table = schema.protocol_version
    return list(connection.execute(select(table).where(table.c.study_id == study).order_by(table.c.number)))


def add_version(connection: Connection, study: int, text: str, reason: str, now: datetime) -> int:
    """Store a further version of the study's protocol and return its id."""
    table = schema.protocol_version
    last = connection.execute(select(func.max(table.c.number)).where(table.c.study_id == study)).scalar() or 0
    row = {
        "study_id": study,
        "number": last + 1,
        "toml": text,
        "sha256": protocol_hash(text),
        "reason": reason,
        "tool_version": __version__,
        "created_utc": stamp(now),
    }
    return int(connection.execute(insert(table).values(row).returning(table.c.id)).scalar_one())


def subjects(connection: Connection, study: int) -> list[Found]:
    """Return the study's subjects in the order in which they were enrolled."""
    table = schema.subject
    return list(connection.execute(select(table).where(table.c.study_id == study).order_by(table.c.number)))


def add_subject(connection: Connection, study: int, new: NewSubject, now: datetime) -> Found:
    """Store a subject under the next number and return the row."""
    table = schema.subject
    last = connection.execute(select(func.max(table.c.number)).where(table.c.study_id == study)).scalar()
    row = {
        "study_id": study,
        "number": 0 if last is None else last + 1,
        "code": new.code,
        "subject_group": new.group,
        "participant_id": new.participant_id,
        "enrolled_utc": stamp(now),
    }
    made = connection.execute(insert(table).values(row).returning(table)).one()
    for name, (value, unit) in (new.facts or {}).items():
        set_fact(connection, made.id, name, value, unit)
    return made


def add_session(
    connection: Connection,
    protocol: StudyProtocol,
    subject: Found,
    token: str,
    now: datetime,
    skin_temperature_c: float | None = None,
) -> None:
    """Store the subject's next visit, under the circumstances of the protocol."""
    table = schema.session
    last = connection.execute(select(func.max(table.c.visit)).where(table.c.subject_id == subject.id)).scalar() or 0
    circumstances = protocol.circumstances.model_dump()
    if skin_temperature_c is not None:
        circumstances["skin_temperature_c"] = skin_temperature_c
    row = {
        "study_id": subject.study_id,
        "subject_id": subject.id,
        "visit": last + 1,
        "link_token": token,
        "experimenter": protocol.study.experimenter,
        "created_utc": stamp(now),
        **circumstances,
    }
    connection.execute(insert(table).values(row))


def session_query() -> Select[Any]:
    """Return a query of sessions with their subjects (subject_number, subject_code, subject_group)."""
    who = schema.subject
    return select(
        schema.session,
        who.c.number.label("subject_number"),
        who.c.code.label("subject_code"),
        who.c.subject_group,
        who.c.participant_id,
    ).join(who, who.c.id == schema.session.c.subject_id)


def sessions(connection: Connection, study: int) -> list[Found]:
    """Return the study's sessions in order of subjects and visits."""
    query = session_query().where(schema.session.c.study_id == study)
    return list(connection.execute(query.order_by(schema.subject.c.number, schema.session.c.visit)))


def session(connection: Connection, session: int) -> Found:
    """Return the session's row with its subject."""
    return connection.execute(session_query().where(schema.session.c.id == session)).one()


def change_session(connection: Connection, session: int, **values: Any) -> None:
    """Write columns of a session's row."""
    connection.execute(update(schema.session).where(schema.session.c.id == session).values(**values))


def change_subject(connection: Connection, subject: int, **values: Any) -> None:
    """Write columns of a subject's row."""
    connection.execute(update(schema.subject).where(schema.subject.c.id == subject).values(**values))


def facts(connection: Connection, study: int) -> dict[int, dict[str, str]]:
    """Return the demographic items of the study's subjects by their row and the item's name."""
    fact, found = schema.demographic, dict[int, dict[str, str]]()
    query = select(fact).join(schema.subject).where(schema.subject.c.study_id == study).order_by(fact.c.id)
    for row in connection.execute(query):
        found.setdefault(row.subject_id, {})[row.name] = row.value
    return found


def set_fact(connection: Connection, subject: int, name: str, value: str | None, unit: str) -> None:
    """Write a demographic item of a subject; with None, take it away."""
    fact = schema.demographic
    connection.execute(delete(fact).where(fact.c.subject_id == subject, fact.c.name == name))
    if value is not None:
        connection.execute(insert(fact).values(subject_id=subject, name=name, value=value, unit=unit))
