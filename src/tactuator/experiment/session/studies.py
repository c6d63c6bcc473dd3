"""Opens a study: a protocol of either kind at a station, with a session for every subject in the store."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.experiment.protocol.identification import IdentificationProtocol
from tactuator.experiment.protocol.protocol import Protocol, StudyProtocol
from tactuator.experiment.session.apparatus import Station
from tactuator.experiment.session.clock import Clock
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.identification_task import IdentificationTask
from tactuator.experiment.session.session import Session
from tactuator.experiment.session.task import Task
from tactuator.experiment.store import records
from tactuator.experiment.store.store import Store


def task_of(protocol: StudyProtocol, beside: Path, station: Station) -> Task:
    """The protocol at the station; files that it names lie in `beside`.

    Raises BadInput where the station cannot play it.
    """
    if isinstance(protocol, IdentificationProtocol):
        return IdentificationTask.load(protocol, beside, station)
    assert isinstance(protocol, Protocol)
    return DetectionTask(protocol, station)


def open_study(store: Store, task: Task, text: str, clock: Clock, tokens: Sequence[str]) -> int:
    """The study of that protocol text, made if it is new; its row. tokens: of the subjects' links, if it is.

    Raises BadInput where the study is there with other stimuli.
    """
    with store.begin() as connection:
        study = records.open_study(connection, task.protocol, text, clock.utc(), tokens)
        task.enrol(connection, study)
    return study


def open_session(store: Store, task: Task, study: int, subject: str, clock: Clock) -> Session:
    """The session of the subject of that code, resumed; BadInput where the protocol has none."""
    with store.read() as connection:
        rows = records.sessions(connection, study)
    row = next((row for row in rows if row.subject_code == subject), None)
    if row is None:
        codes = ", ".join(one.subject_code for one in rows)
        raise BadInput(f"subject {subject!r} is not in the protocol; allowed: {codes}")
    return Session(store, row.id, row.subject_number, task, clock)
