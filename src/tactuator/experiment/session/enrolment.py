"""Subjects of a study: enrolled, corrected and claimed without any apparatus, each change an event with who made it."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.protocol.study import StudyProtocol, SubjectPart
from tactuator.experiment.store import records
from tactuator.experiment.store.records import Change, Found, Tokens, note

_TOKEN_BYTES = 16


def fresh_token(code: str, visit: int) -> str:
    """Return a token for the link of a subject's visit: nobody guesses it."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


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


@dataclass(frozen=True)
class StudyRecords:
    """Records of a study in an open transaction, in which subjects are enrolled and corrected.

    id: its row. protocol: the newest. who: who changes them. What a correction replaces stays as an event.
    """

    connection: Connection
    id: int
    protocol: StudyProtocol
    tokens: Tokens
    now: datetime
    who: str

    def enrol(self, part: SubjectPart) -> None:
        """Add a subject with a session for each visit. Raises BadInput for one that is there, or facts not allowed."""
        known = records.subjects(self.connection, self.id)
        if any(part.code == subject.code for subject in known):
            raise BadInput(f"subject {part.code!r} is enrolled already", "a code that is not taken")
        _refuse_taken(known, part.participant_id)
        facts = self.protocol.facts(part.demographics)
        row = records.add_subject(self.connection, self.id, part, facts, self.now)
        if self.who != records.PROGRAM:  # the protocol names the others
            note(self.connection, None, "enrolled", "", self.now, self.who, subject=row.id)
        for visit in range(1, self.protocol.study.visits + 1):
            token = self.tokens(part.code, visit)
            records.add_session(self.connection, self.protocol, row, token, self.now, part.skin_temperature_c)

    def add_visit(self, subject: str) -> None:
        """Add a further visit of the subject of that code. Raises BadInput where there is none."""
        rows = [row for row in records.sessions(self.connection, self.id) if row.subject_code == subject]
        if not rows:
            raise BadInput(f"subject {subject!r} is not in the study", "one that is enrolled")
        who = next(person for person in records.subjects(self.connection, self.id) if person.code == subject)
        token = self.tokens(subject, rows[-1].visit + 1)
        records.add_session(self.connection, self.protocol, who, token, self.now)
        note(self.connection, None, "visit", f"visit {rows[-1].visit + 1}", self.now, self.who, subject=who.id)

    def correct(self, code: str, correction: Correction, reason: str) -> list[Change]:
        """Write correct data of the subject of that code and return the changes, each now an event with the reason.

        Raises BadInput for a subject or visit that is not there, values that are not allowed, no reason, or where
        nothing differs from what is there.
        """
        if not reason.strip():
            raise BadInput("no reason", "one in words, which is kept with the correction")
        rows = [row for row in records.sessions(self.connection, self.id) if row.subject_code == code]
        if not rows:
            raise BadInput(f"subject {code!r} is not in the study", "one that is enrolled")
        changes = self._change_subject(rows[0], correction)
        day = {"skin_temperature_c": correction.skin_temperature_c, "preload_n": correction.preload_n}
        asked = {name: value for name, value in day.items() if value is not None}
        if asked or correction.visit is not None:
            changes += self._change_day(_visit(rows, code, correction.visit), asked)
        if not changes:
            raise BadInput(f"nothing of subject {code!r} differs from what is there", "another value")
        for session, change in changes:
            about: dict[str, Any] = {"subject": rows[0].subject_id, "change": change}
            note(self.connection, session, "correction", reason.strip(), self.now, self.who, **about)
        return [change for _, change in changes]

    def set_day(self, session: int, skin_temperature_c: float | None, preload_n: float | None) -> None:
        """Store the data of the day of a session; what was there before is kept as an event."""
        row = records.session(self.connection, session)
        for _, change in self._change_day(row, {"skin_temperature_c": skin_temperature_c, "preload_n": preload_n}):
            note(self.connection, session, "day", "", self.now, self.who, subject=row.subject_id, change=change)

    def claim(self, row: Found, participant_id: str) -> None:
        """Store the name that others have for the subject of that session.

        Raises BadInput where the subject has another such id, or it is another's.
        """
        try:
            taken = SubjectPart(code=row.subject_code, participant_id=participant_id).participant_id
        except BadInput:
            raise BadInput("participant id", "1 to 64 letters, digits, dots, dashes or underscores") from None
        mine = records.session(self.connection, row.id).participant_id
        if mine == taken:
            return
        known = records.subjects(self.connection, self.id)
        if mine is not None or any(subject.participant_id == taken for subject in known):
            raise BadInput("this link is another participant's", "one's own")
        records.change_subject(self.connection, row.subject_id, participant_id=participant_id)

    def _change_subject(self, row: Found, correction: Correction) -> list[tuple[int | None, Change]]:
        group, outside = correction.group, correction.participant_id
        others = [subject for subject in records.subjects(self.connection, self.id) if subject.id != row.subject_id]
        _refuse_taken(others, outside)
        changes = []
        if group is not None and group != row.subject_group:
            changes.append(Change("subject_group", row.subject_group, group))
            records.change_subject(self.connection, row.subject_id, subject_group=group)
        if outside is not None and outside != row.participant_id:
            changes.append(Change("outside_id", row.participant_id, outside))
            records.change_subject(self.connection, row.subject_id, participant_id=outside)
        stands = records.facts(self.connection, self.id).get(row.subject_id, {})
        for name, text in correction.facts.items():
            value, unit = self.protocol.fact(name, text)
            if value != stands.get(name):
                changes.append(Change(name, stands.get(name), value))
                records.set_fact(self.connection, row.subject_id, name, value, unit)
        return [(None, change) for change in changes]

    def _change_day(self, row: Found, values: Mapping[str, float | None]) -> list[tuple[int | None, Change]]:
        """Write columns of a visit's row and return (session, change) for each that differs."""
        before = row._mapping
        changes = [(row.id, Change(name, _text(before[name]), _text(value))) for name, value in values.items()]
        if values:
            records.change_session(self.connection, row.id, **values)
        return [(session, change) for session, change in changes if change.before != change.after]


def _refuse_taken(others: Sequence[Found], outside: str | None) -> None:
    if outside is not None and any(outside == subject.participant_id for subject in others):
        raise BadInput(f"participant id {outside!r} is another subject's", "one that is not taken")


def _visit(rows: list[Found], code: str, visit: int | None) -> Found:
    if visit is None and len(rows) > 1:
        raise BadInput(f"data of a day of subject {code!r}, who has {len(rows)} visits", "with the visit")
    row = next((each for each in rows if each.visit == (visit or 1)), None)
    if row is None:
        raise BadInput(f"visit {visit} of subject {code!r} is not planned", f"1 to {len(rows)}")
    return row


def _text(value: float | None) -> str | None:
    return None if value is None else f"{value:.10g}"


def study_records(connection: Connection, name: str | None, tokens: Tokens, now: datetime, who: str) -> StudyRecords:
    """Return the records of the store's study of that name; without a name, of its only one.

    Raises BadInput where there is none, or several and no name.
    """
    names = records.study_names(connection)
    if name is None and len(names) != 1:
        raise BadInput(f"the store has {len(names)} studies", f"--study with one of: {', '.join(names) or 'none'}")
    study = records.study_by_name(connection, names[0] if name is None else name)
    if study is None:
        raise BadInput(f"study {name!r} is not in the store", f"{', '.join(names) or 'none: it is empty'}")
    newest = records.versions(connection, study)[-1]
    return StudyRecords(connection, study, parse_protocol(newest.toml, StudyProtocol), tokens, now, who)
