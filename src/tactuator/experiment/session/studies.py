"""Studies: a protocol of any kind at an apparatus, its versions, and a session for every visit of its subjects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.protocol.judging import JudgingProtocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.session.enrolment import StudyRecords
from tactuator.experiment.session.recognition_task import RecognitionTask
from tactuator.experiment.session.session import Session
from tactuator.experiment.session.task import Apparatus, Clock, SessionTask
from tactuator.experiment.session.tone_task import DetectionTask, JudgingTask
from tactuator.experiment.store import records
from tactuator.experiment.store.records import Found, Tokens, Visit, note, stamp
from tactuator.experiment.store.store import Store
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
    """Return the study of that protocol, made if it is new; whoever is new in the protocol is enrolled.

    A protocol of the same name with another text is another version of it. Where it only has more subjects it is
    accepted as that; otherwise amend gives the reason, and BadInput is raised without one. who: who amends. Subjects,
    links and sessions that are there stay as they are, and a session that has begun stays with its version. Raises
    BadInput also where the study is there with other stimuli, or has a later version than the text's.
    """
    with store.begin() as connection:
        study, version = _version(connection, task, text, clock, amend, who)
        task.enrol(connection, study)
        opened = Study(store, study, task, version, beside or Path(), clock, tokens)
        known = {subject.code for subject in records.subjects(connection, study)}
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
            f"protocol is version {same.number} of study {name!r}, which stands at {rows[-1].number}",
            "the newest version, or one that was never there",
        )
    if same is not None:
        return study, int(same.id)
    if amend is None:
        before = parse_protocol(rows[-1].toml, StudyProtocol)
        if before.apart_from_subjects() != task.protocol.apart_from_subjects():
            raise BadInput(
                f"study {name!r} stands at version {rows[-1].number} of its protocol, and this one says something else",
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
