"""Studies: a protocol of any kind at an apparatus, its versions, its subjects, and a session for each of their visits.

Subjects are enrolled, corrected and claimed without any apparatus, each change an event with who made it.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.protocol.judging import JudgingProtocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.protocol.study import StudyProtocol, SubjectPart
from tactuator.experiment.session.recognition_task import RecognitionTask
from tactuator.experiment.session.session import Session
from tactuator.experiment.session.task import Apparatus, Clock, SessionTask
from tactuator.experiment.session.tone_task import DetectionTask, JudgingTask
from tactuator.experiment.store import records
from tactuator.experiment.store.records import Change, Found, Tokens, Visit, note, stamp
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.voids import void_parts
from tactuator.experiment.words import read_words, shipped_words


def task_of(protocol: StudyProtocol, beside: Path, apparatus: Apparatus) -> SessionTask:
    """Return the task of the protocol at the apparatus; files that it names lie in `beside`.

    Raises BadInput where the apparatus cannot play it, or its language is not there.
    """
    study = protocol.study
    own_file = None if study.language_file is None else beside / study.language_file
    words = shipped_words(study.language) if own_file is None else read_words(own_file, study.language)
    return _TASKS[type(protocol)].load(protocol, beside, apparatus, words)


_TASKS: Mapping[type[StudyProtocol], type[SessionTask]] = {
    Protocol: DetectionTask, JudgingProtocol: JudgingTask, RecognitionProtocol: RecognitionTask
}  # fmt: skip


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
        if part.code in records.codes(self.connection, self.id):
            raise BadInput(f"subject {part.code!r} is enrolled already", "a code that is not taken")
        _refuse_taken(known, part.participant_id)
        facts = self.protocol.facts(part.demographics)
        self.protocol.require_facts(part)
        row = records.add_subject(self.connection, self.id, part, facts, self.now)
        if self.who != records.PROGRAM:  # the protocol names the others
            note(self.connection, None, "enrolled", "", self.now, self.who, subject=row.id)
        for visit in range(1, self.protocol.study.visits + 1):
            token = self.tokens(part.code, visit)
            records.add_session(self.connection, self.protocol, row, token, self.now, part.skin_temperature_c)

    def add_visit(self, subject: str) -> None:
        """Add a further visit of the subject of that code. Raises BadInput for an unknown subject."""
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

    def rename(self, code: str, new: str, reason: str) -> None:
        """Give the subject of that code another one; an event has the reason.

        A former code stays the subject's: nobody else gets it, and a protocol file that has it means them. Raises
        BadInput for a subject who is not there, a code that is not allowed or taken, and no reason.
        """
        if not reason.strip():
            raise BadInput("no reason", "one in words, which is kept")
        subject = next((row for row in records.subjects(self.connection, self.id) if row.code == code), None)
        if subject is None:
            raise BadInput(f"subject {code!r} is not in the study", "one that is enrolled")
        SubjectPart(code=new)
        if new == code or records.codes(self.connection, self.id).get(new, subject.id) != subject.id:
            raise BadInput(f"subject {new!r} is enrolled already", "a code that is not taken")
        records.rename_subject(self.connection, subject, new)
        change = Change("subject", code, new)
        kind, why = records.RENAMED, reason.strip()
        note(self.connection, None, kind, why, self.now, self.who, subject=subject.id, change=change)

    def set_day(self, session: int, skin_temperature_c: float | None, preload_n: float | None) -> None:
        """Store the data of the day of a session; what was there before is kept as an event."""
        row = records.session(self.connection, session)
        for _, change in self._change_day(row, {"skin_temperature_c": skin_temperature_c, "preload_n": preload_n}):
            note(self.connection, session, "day", "", self.now, self.who, subject=row.subject_id, change=change)

    def claim(self, row: Found, participant_id: str) -> bool:
        """Store the name that others have for the subject of that session, and return whether it is theirs now.

        Every claim is an event. The refusal gives no reason, which would reveal whose an id is.
        """
        reason = self._refused_claim(row, participant_id)
        kind = "claim-refused" if reason else "claimed"
        note(self.connection, row.id, kind, reason, self.now, self.who, subject=row.subject_id)
        if not reason:
            records.change_subject(self.connection, row.subject_id, participant_id=participant_id)
        return not reason

    def _refused_claim(self, row: Found, participant_id: str) -> str:
        """Return why an id is not taken for the subject's, "" where it is."""
        try:
            SubjectPart(code=row.subject_code, participant_id=participant_id)
        except BadInput:
            return "it cannot be one"
        mine = records.session(self.connection, row.id).participant_id
        if mine is not None and mine != participant_id:
            return "the subject has another"
        known = records.subjects(self.connection, self.id)
        others = {subject.participant_id for subject in known if subject.id != row.subject_id}
        return "it is another subject's" if participant_id in others else ""

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
        present = records.facts(self.connection, self.id).get(row.subject_id, {})
        for name, text in correction.facts.items():
            value, unit = self.protocol.fact(name, text)
            if value != present.get(name):
                changes.append(Change(name, present.get(name), value))
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

    Raises BadInput without any, or with several and no name.
    """
    names = records.study_names(connection)
    if name is None and len(names) != 1:
        raise BadInput(f"the store has {len(names)} studies", f"`study` with one of: {', '.join(names) or 'none'}")
    study = records.study_by_name(connection, names[0] if name is None else name)
    if study is None:
        raise BadInput(f"study {name!r} is not in the store", f"{', '.join(names) or 'none: it is empty'}")
    newest = records.versions(connection, study)[-1]
    return StudyRecords(connection, study, parse_protocol(newest.toml, StudyProtocol), tokens, now, who)


@dataclass
class Study:
    """A study in its store.

    id: its row. task: of the newest version. beside: the folder of the protocol's files.
    """

    store: Store
    id: int
    task: SessionTask
    version: int
    beside: Path
    clock: Clock
    tokens: Tokens
    _tasks: dict[int, SessionTask] = field(init=False, default_factory=dict)

    def sessions(self) -> list[Found]:
        """Return the rows of the study's sessions, by subject and visit."""
        with self.store.read() as connection:
            return records.sessions(connection, self.id)

    def session(self, row: Found, visit: Visit | None = None) -> Session:
        """Return the session of that row, resumed in the version of the protocol that it began with.

        Raises BadInput where that version cannot be played here.
        """
        version = row.protocol_version_id or self.version
        return Session(self.store, row, self._task(version), version, self.clock, visit)

    def _task(self, version: int) -> SessionTask:
        if version == self.version:
            return self.task
        if version not in self._tasks:
            with self.store.read() as connection:
                rows = records.versions(connection, self.id)
            text = next(row.toml for row in rows if row.id == version)
            self._tasks[version] = task_of(parse_protocol(text, StudyProtocol), self.beside, self.task.apparatus)
        return self._tasks[version]

    @contextmanager
    def editing(self, who: str = records.PROGRAM) -> Iterator[StudyRecords]:
        """Open the study's records for changes by that person, all of which are stored or none."""
        with self.store.begin() as connection:
            yield self.records_in(connection, who)

    def records_in(self, connection: Connection, who: str) -> StudyRecords:
        """Return the study's records in a transaction that is open."""
        return StudyRecords(connection, self.id, self.task.protocol, self.tokens, self.clock.utc(), who)

    def voids(self) -> dict[tuple[int, int | None, int | None], str]:
        """Return why visits, runs and trials are void, as `void_parts` does."""
        with self.store.read() as connection:
            return void_parts(connection)

    def facts(self) -> dict[int, dict[str, str]]:
        """Return the demographic items of subjects by their row and the item's name."""
        with self.store.read() as connection:
            return records.facts(connection, self.id)


def open_study(
    store: Store,
    task: SessionTask,
    text: str,
    clock: Clock,
    tokens: Tokens,
    amend: str | None = None,
    beside: Path | None = None,
    who: str = records.PROGRAM,
) -> Study:
    """Return the study of that protocol, made if it is new; new subjects in the protocol are enrolled.

    A protocol of the same name with another text is another version of it. Where it only has more subjects it is
    accepted as that; otherwise amend gives the reason, and BadInput is raised without one. who: who amends. Subjects,
    links and sessions that are there stay as they are, and a session that has begun stays with its version. Raises
    BadInput for a version that cannot come to results, unless there are answers to it; also where the study is there
    with other stimuli, or has a later version than the text's.
    """
    with store.begin() as connection:
        study, version = _version(connection, task, text, clock, amend, who)
        if not records.has_begun(connection, version):
            for fault in task.faults():
                raise fault
        task.enrol(connection, study)
        opened = Study(store, study, task, version, beside or Path(), clock, tokens)
        known = records.codes(connection, study)
        for part in task.protocol.subject:
            if part.code not in known:
                opened.records_in(connection, records.PROGRAM).enrol(part)
    return opened


def _version(
    connection: Connection, task: SessionTask, text: str, clock: Clock, amend: str | None, who: str
) -> tuple[int, int]:
    name, now = task.protocol.study.name, clock.utc()
    study = records.study_by_version(connection, text) or records.study_by_name(connection, name)
    if study is None:
        study = records.add_study(connection, name, now)
        return study, records.add_version(connection, study, text, "", now)
    rows = records.versions(connection, study)
    same = next((row for row in rows if row.toml == text), None)
    if same is not None and same is not rows[-1]:
        raise BadInput(
            f"protocol is version {same.number} of study {name!r}, which is at {rows[-1].number}",
            "the newest version, or one that was never there",
        )
    if same is not None:
        return study, int(same.id)
    if amend is None:
        before = parse_protocol(rows[-1].toml, StudyProtocol)
        if before.apart_from_subjects() != task.protocol.apart_from_subjects():
            raise BadInput(
                f"study {name!r} is at version {rows[-1].number} of its protocol, from which this one differs",
                "that version, `experiment serve --amend` with the reason for another, or another name",
            )
        amend = "subjects"
    note(connection, None, "amended", f"{name}: version {rows[-1].number + 1} at {stamp(now)}: {amend}", now, who)
    return study, records.add_version(connection, study, text, amend, now)


def open_session(study: Study, subject: str, visit: Visit | None = None) -> Session:
    """Return the session of the subject of that code: of the first visit that is not over, else of the last.

    Raises BadInput where the study has none.
    """
    rows = [row for row in study.sessions() if row.subject_code == subject]
    if not rows:
        codes = ", ".join(dict.fromkeys(row.subject_code for row in study.sessions()))
        raise BadInput(f"subject {subject!r} is not in the study", f"{codes or 'one that is enrolled'}")
    opened = [study.session(row, visit) for row in rows]
    return next((session for session in opened if session.stage not in ("done", "ended")), opened[-1])
