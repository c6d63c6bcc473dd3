"""Studies: a protocol of either kind at an apparatus, its versions, and a session for every visit of a subject."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ValidationError
from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.language.words import Words, read_words, shipped_words
from tactuator.experiment.protocol.file import parse_any_protocol
from tactuator.experiment.protocol.protocol import Protocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.protocol.study import StudyProtocol, SubjectPart
from tactuator.experiment.session.apparatus import Apparatus
from tactuator.experiment.session.clock import Clock
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.enrolment import Books, Correction, add_visit, change_day, correct, enrol
from tactuator.experiment.session.recognition_task import RecognitionTask
from tactuator.experiment.session.session import Session
from tactuator.experiment.session.task import SessionTask
from tactuator.experiment.store import study_records
from tactuator.experiment.store.cells import Found, stamp
from tactuator.experiment.store.run_records import Sitting, note
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.study_records import Tokens


def task_of(protocol: StudyProtocol, beside: Path, apparatus: Apparatus) -> SessionTask:
    """Return the task of the protocol at the apparatus; files that it names lie in `beside`.

    Raises BadInput where the apparatus cannot play it, or its language is not there.
    """
    words = words_of(protocol, beside)
    if isinstance(protocol, RecognitionProtocol):
        return RecognitionTask.load(protocol, beside, apparatus, words)
    assert isinstance(protocol, Protocol)
    return DetectionTask(protocol, apparatus, words)


def words_of(protocol: StudyProtocol, beside: Path) -> Words:
    """Return the words of the protocol's language. Raises BadInput where they are not there."""
    study = protocol.study
    if study.language_file is not None:
        return read_words(beside / study.language_file, study.language)
    return shipped_words(study.language)


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
            return study_records.sessions(connection, self.id)

    def session(self, row: Found, sitting: Sitting | None = None) -> Session:
        """Return the session of that row, resumed in the version of the protocol that it began with.

        Raises BadInput where that version cannot be played here.
        """
        version = row.protocol_version_id or self.version
        return Session(self.store, row, self._task(version), version, self.clock, sitting)

    def _task(self, version: int) -> SessionTask:
        if version == self.version:
            return self.task
        if version not in self._tasks:
            with self.store.read() as connection:
                rows = study_records.versions(connection, self.id)
            text = next(row.toml for row in rows if row.id == version)
            self._tasks[version] = task_of(parse_any_protocol(text), self.beside, self.task.apparatus)
        return self._tasks[version]

    def enrol(self, part: SubjectPart) -> None:
        """Add a subject with a session for each visit. Raises BadInput for one that is there, or facts not allowed."""
        with self.store.begin() as connection:
            enrol(connection, self._books(), part)

    def add_visit(self, subject: str) -> None:
        """Add a further visit of the subject of that code. Raises BadInput where there is none."""
        with self.store.begin() as connection:
            add_visit(connection, self._books(), subject)

    def _books(self) -> Books:
        return Books(self.id, self.task.protocol, self.tokens, self.clock.utc())

    def set_day(self, session: int, skin_temperature_c: float | None, preload_n: float | None) -> None:
        """Store the data of the day of a session; what was there before is kept as an event."""
        values = {"skin_temperature_c": skin_temperature_c, "preload_n": preload_n}
        with self.store.begin() as connection:
            row, now = study_records.session(connection, session), self.clock.utc()
            for _, change in change_day(connection, row, values):
                note(connection, session, "day", "", now, subject=row.subject_id, change=change)

    def correct(self, subject: str, correction: Correction, reason: str) -> None:
        """Write correct data of the subject of that code; what stood there is kept as an event. Raises BadInput as the
        function does.
        """
        with self.store.begin() as connection:
            correct(connection, self._books(), subject, correction, reason)

    def facts(self) -> dict[int, dict[str, str]]:
        """Return the demographic items of subjects by their row and the item's name."""
        with self.store.read() as connection:
            return study_records.facts(connection, self.id)

    def claim(self, row: Found, participant_id: str) -> None:
        """Store the name that others have for the subject of that session.

        Raises BadInput where the subject has another such id, or it is another's.
        """
        try:
            taken = SubjectPart(code=row.subject_code, participant_id=participant_id).participant_id
        except ValidationError:
            raise BadInput("participant id", "1 to 64 letters, digits, dots, dashes or underscores") from None
        with self.store.begin() as connection:
            mine = study_records.session(connection, row.id).participant_id
            if mine == taken:
                return
            known = study_records.subjects(connection, self.id)
            if mine is not None or any(one.participant_id == taken for one in known):
                raise BadInput("this link is another participant's", "one's own")
            study_records.change_subject(connection, row.subject_id, participant_id=participant_id)


def open_study(
    store: Store,
    task: SessionTask,
    text: str,
    clock: Clock,
    tokens: Tokens,
    amend: str | None = None,
    beside: Path | None = None,
) -> Study:
    """Return the study of that protocol, made if it is new; whoever is new in the protocol is enrolled.

    A protocol of the same name with another text is another version of it. Where it only has more subjects it is
    accepted as that; otherwise amend gives the reason, and BadInput is raised without one. Subjects, links and sessions
    that are there stay as they are, and a session that has begun stays with its version. Raises BadInput also where the
    study is there with other stimuli, or has a later version than the text's.
    """
    with store.begin() as connection:
        study, version = _version(connection, task, text, clock, amend)
        task.enrol(connection, study)
        opened = Study(store, study, task, version, beside or Path(), clock, tokens)
        known = {one.code for one in study_records.subjects(connection, study)}
        for part in task.protocol.subject:
            if part.code not in known:
                enrol(connection, opened._books(), part)
    return opened


def _version(connection: Connection, task: SessionTask, text: str, clock: Clock, amend: str | None) -> tuple[int, int]:
    """Return the rows of the study and of the version of its protocol that has this text."""
    name, now = task.protocol.study.name, clock.utc()
    study = study_records.study_by_version(connection, text) or study_records.study_by_name(connection, name)
    if study is None:
        study = study_records.add_study(connection, name, now)
        return study, study_records.add_version(connection, study, text, "", now)
    rows = study_records.versions(connection, study)
    same = next((row for row in rows if row.toml == text), None)
    if same is not None and same is not rows[-1]:
        raise BadInput(
            f"protocol is version {same.number} of study {name!r}, which stands at {rows[-1].number}",
            "the newest version, or one that was never there",
        )
    if same is not None:
        return study, int(same.id)
    if amend is None:
        before = parse_any_protocol(rows[-1].toml)
        if before.apart_from_subjects() != task.protocol.apart_from_subjects():
            raise BadInput(
                f"study {name!r} stands at version {rows[-1].number} of its protocol, and this one says something else",
                "that version, --amend with the reason for another, or another name",
            )
        amend = "subjects"
    note(connection, None, "amended", f"{name}: version {rows[-1].number + 1} at {stamp(now)}: {amend}", now)
    return study, study_records.add_version(connection, study, text, amend, now)


def open_session(study: Study, subject: str, visit: int | None = None, sitting: Sitting | None = None) -> Session:
    """Return the session of the subject of that code: of that visit, or the first that is not over.

    Raises BadInput where the study has none.
    """
    rows = [row for row in study.sessions() if row.subject_code == subject]
    if not rows:
        codes = ", ".join(dict.fromkeys(row.subject_code for row in study.sessions()))
        raise BadInput(f"subject {subject!r} is not in the study", f"{codes or 'one that is enrolled'}")
    if visit is not None:
        rows = [row for row in rows if row.visit == visit]
        if not rows:
            raise BadInput(f"visit {visit} of subject {subject!r} is not planned", "one that is")
    opened = [study.session(row, sitting) for row in rows]
    return next((one for one in opened if one.stage not in ("done", "ended")), opened[-1])
