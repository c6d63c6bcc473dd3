"""Enrolment: a subject with a session for each visit, and further visits, without any apparatus."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_any_protocol
from tactuator.experiment.protocol.study import StudyProtocol, SubjectPart
from tactuator.experiment.store import study_records
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
        raise BadInput(
            f"the store has {len(names)} studies; allowed: --study with one of: {', '.join(names) or 'none'}"
        )
    study = study_records.study_by_name(connection, names[0] if name is None else name)
    if study is None:
        raise BadInput(f"study {name!r} is not in the store; allowed: {', '.join(names) or 'none: it is empty'}")
    newest = study_records.versions(connection, study)[-1]
    return Books(study, parse_any_protocol(newest.toml), tokens, now)


def enrol(connection: Connection, books: Books, part: SubjectPart) -> None:
    """Add a subject with a session for each visit. Raises BadInput for one that is there, or facts not allowed."""
    known = study_records.subjects(connection, books.study)
    if any(part.code == one.code for one in known):
        raise BadInput(f"subject {part.code!r} is enrolled already; allowed: a code that is not taken")
    if part.participant_id is not None and any(part.participant_id == one.participant_id for one in known):
        raise BadInput(f"participant id {part.participant_id!r} is another subject's; allowed: one that is not taken")
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
        raise BadInput(f"subject {subject!r} is not in the study; allowed: one that is enrolled")
    who = next(one for one in study_records.subjects(connection, books.study) if one.code == subject)
    token = books.tokens(subject, rows[-1].visit + 1)
    study_records.add_session(connection, books.protocol, who, token, books.now)
