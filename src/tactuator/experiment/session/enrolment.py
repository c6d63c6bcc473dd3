"""Enrolment: a subject with a session for each visit, further visits, and corrections, without any apparatus.

What stood where something was corrected stays in the store as an event.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_any_protocol
from tactuator.experiment.protocol.study import StudyProtocol, SubjectPart
from tactuator.experiment.store import study_records
from tactuator.experiment.store.cells import Found
from tactuator.experiment.store.run_records import Change, note
from tactuator.experiment.store.study_records import NewSubject, Tokens

_TOKEN_BYTES = 16


def fresh_token(code: str, visit: int) -> str:
    """Return a token for the link of a subject's visit: nobody guesses it."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


@dataclass(frozen=True)
class Books:
    """Row, newest protocol, tokens of links and time: all that enrolment in a study needs."""

    study: int
    protocol: StudyProtocol
    tokens: Tokens
    now: datetime


def books_of(connection: Connection, name: str | None, tokens: Tokens, now: datetime) -> Books:
    """Return the books of the store's study of that name; without a name, of its only one.

    Raises BadInput where there is none, or several and no name.
    """
    names = study_records.study_names(connection)
    if name is None and len(names) != 1:
        raise BadInput(f"the store has {len(names)} studies", f"--study with one of: {', '.join(names) or 'none'}")
    study = study_records.study_by_name(connection, names[0] if name is None else name)
    if study is None:
        raise BadInput(f"study {name!r} is not in the store", f"{', '.join(names) or 'none: it is empty'}")
    newest = study_records.versions(connection, study)[-1]
    return Books(study, parse_any_protocol(newest.toml), tokens, now)


def enrol(connection: Connection, books: Books, part: SubjectPart) -> None:
    """Add a subject with a session for each visit. Raises BadInput for one that is there, or facts not allowed."""
    known = study_records.subjects(connection, books.study)
    if any(part.code == one.code for one in known):
        raise BadInput(f"subject {part.code!r} is enrolled already", "a code that is not taken")
    if part.participant_id is not None and any(part.participant_id == one.participant_id for one in known):
        raise BadInput(f"participant id {part.participant_id!r} is another subject's", "one that is not taken")
    try:
        facts = books.protocol.facts(part.demographics)
    except ValueError as error:
        raise BadInput(str(error)) from None
    new = NewSubject(part.code, part.group, part.participant_id, facts=facts)
    row = study_records.add_subject(connection, books.study, new, books.now)
    for visit in range(1, books.protocol.study.visits + 1):
        token = books.tokens(part.code, visit)
        study_records.add_session(connection, books.protocol, row, token, books.now, part.skin_temperature_c)


def add_visit(connection: Connection, books: Books, subject: str) -> None:
    """Add a further visit of the subject of that code. Raises BadInput where there is none."""
    rows = [row for row in study_records.sessions(connection, books.study) if row.subject_code == subject]
    if not rows:
        raise BadInput(f"subject {subject!r} is not in the study", "one that is enrolled")
    who = next(one for one in study_records.subjects(connection, books.study) if one.code == subject)
    token = books.tokens(subject, rows[-1].visit + 1)
    study_records.add_session(connection, books.protocol, who, token, books.now)


@dataclass(frozen=True)
class Correction:
    """Values that replace what was noted of a subject or a visit.

    facts: demographic items by name, "" to take one away. visit: whose data of the day are corrected, None: the first's
    unless there are several. A value of None leaves what is there.
    """

    group: str | None = None
    participant_id: str | None = None
    facts: Mapping[str, str] = field(default_factory=dict)
    visit: int | None = None
    skin_temperature_c: float | None = None
    preload_n: float | None = None


def correct(connection: Connection, books: Books, code: str, correction: Correction, reason: str) -> list[Change]:
    """Write correct data of the subject of that code and return the changes, each now an event with the reason.

    Raises BadInput for a subject or visit that is not there, values that are not allowed, no reason, or where nothing
    differs from what is there.
    """
    if not reason.strip():
        raise BadInput("no reason", "one in words, which is kept with the correction")
    rows = [row for row in study_records.sessions(connection, books.study) if row.subject_code == code]
    if not rows:
        raise BadInput(f"subject {code!r} is not in the study", "one that is enrolled")
    found = _of_subject(connection, books, rows[0], correction)
    day = {"skin_temperature_c": correction.skin_temperature_c, "preload_n": correction.preload_n}
    asked = {name: value for name, value in day.items() if value is not None}
    if asked or correction.visit is not None:
        found += change_day(connection, _visit(rows, code, correction.visit), asked)
    if not found:
        raise BadInput(f"nothing of subject {code!r} differs from what is there", "another value")
    for session, change in found:
        note(connection, session, "correction", reason.strip(), books.now, subject=rows[0].subject_id, change=change)
    return [change for _, change in found]


def change_day(
    connection: Connection, row: Found, values: Mapping[str, float | None]
) -> list[tuple[int | None, Change]]:
    """Write columns of a visit's row and return (session, change) for each that differs."""
    before = row._mapping
    found = [(row.id, Change(name, _text(before[name]), _text(value))) for name, value in values.items()]
    if values:
        study_records.change_session(connection, row.id, **values)
    return [(session, change) for session, change in found if change.before != change.after]


def _of_subject(
    connection: Connection, books: Books, row: Found, correction: Correction
) -> list[tuple[int | None, Change]]:
    group, others = correction.group, study_records.subjects(connection, books.study)
    outside = correction.participant_id
    if outside is not None and any(one.participant_id == outside and one.id != row.subject_id for one in others):
        raise BadInput(f"participant id {outside!r} is another subject's", "one that is not taken")
    found = []
    if group is not None and group != row.subject_group:
        found.append(Change("subject_group", row.subject_group, group))
        study_records.change_subject(connection, row.subject_id, subject_group=group)
    if outside is not None and outside != row.participant_id:
        found.append(Change("outside_id", row.participant_id, outside))
        study_records.change_subject(connection, row.subject_id, participant_id=outside)
    stands = study_records.facts(connection, books.study).get(row.subject_id, {})
    for name, text in correction.facts.items():
        try:
            value, unit = books.protocol.fact(name, text)
        except ValueError as error:
            raise BadInput(str(error)) from None
        if value != stands.get(name):
            found.append(Change(name, stands.get(name), value))
            study_records.set_fact(connection, row.subject_id, name, value, unit)
    return [(None, change) for change in found]


def _visit(rows: list[Found], code: str, visit: int | None) -> Found:
    if visit is None and len(rows) > 1:
        raise BadInput(f"data of a day of subject {code!r}, who has {len(rows)} visits", "with the visit")
    row = next((one for one in rows if one.visit == (visit or 1)), None)
    if row is None:
        raise BadInput(f"visit {visit} of subject {code!r} is not planned", f"1 to {len(rows)}")
    return row


def _text(value: float | None) -> str | None:
    return None if value is None else f"{value:.10g}"
