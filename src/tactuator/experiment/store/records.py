"""Reading and writing the store's rows: studies, sessions, runs, trials, events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Integer, Row, cast, func, insert, select, update

from tactuator import __version__
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.protocol.plan import PlannedRun
from tactuator.experiment.protocol.protocol import StudyProtocol, SubjectPart
from tactuator.experiment.store import schema
from tactuator.experiment.trial.trial import IntervalRecord, Trial

Found = Row[Any]


@dataclass(frozen=True)
class Apparatus:
    """What the stimuli are played with, stored with every run."""

    rig: str
    display: str
    controller_sha256: str
    curve: str
    curve_sha256: str
    sensor_gain_v_per_mm: float
    band_low_hz: float
    band_high_hz: float


def stamp(when: datetime) -> str:
    """An instant as the store writes it: ISO 8601 with its zone, to the microsecond."""
    return when.isoformat(timespec="microseconds")


def open_study(connection: Connection, protocol: StudyProtocol, text: str, now: datetime, tokens: Sequence[str]) -> int:
    """The study of that protocol text, made with a session for every subject if it is new. tokens: one a subject."""
    digest = protocol_hash(text)
    found = connection.execute(select(schema.study.c.id).where(schema.study.c.protocol_sha256 == digest)).scalar()
    if found is not None:
        return int(found)
    row = {
        "name": protocol.study.name,
        "protocol_toml": text,
        "protocol_sha256": digest,
        "tool_version": __version__,
        "created_utc": stamp(now),
    }
    study = int(connection.execute(insert(schema.study).values(row).returning(schema.study.c.id)).scalar_one())
    for number, (subject, token) in enumerate(zip(protocol.subject, tokens, strict=True)):
        connection.execute(insert(schema.session).values(_session(protocol, study, number, subject, token, now)))
    return study


def _session(
    protocol: StudyProtocol, study: int, number: int, subject: SubjectPart, token: str, now: datetime
) -> dict[str, Any]:
    circumstances = protocol.circumstances.model_dump()
    if subject.skin_temperature_c is not None:
        circumstances["skin_temperature_c"] = subject.skin_temperature_c
    return {
        "study_id": study,
        "subject_number": number,
        "subject_code": subject.code,
        "subject_group": subject.group,
        "link_token": token,
        "experimenter": protocol.study.experimenter,
        "created_utc": stamp(now),
        **circumstances,
    }


def sessions(connection: Connection, study: int) -> list[Found]:
    """The study's sessions in order of the subjects."""
    query = select(schema.session).where(schema.session.c.study_id == study).order_by(schema.session.c.subject_number)
    return list(connection.execute(query))


def session(connection: Connection, session: int) -> Found:
    """The session's row."""
    return connection.execute(select(schema.session).where(schema.session.c.id == session)).one()


def consent(connection: Connection, session: int, now: datetime) -> None:
    """The subject agreed."""
    connection.execute(update(schema.session).where(schema.session.c.id == session).values(consented_utc=stamp(now)))


def latest_runs(connection: Connection, session: int) -> list[Found]:
    """The last attempt at every position, in order."""
    query = (
        select(schema.run)
        .where(schema.run.c.session_id == session)
        .order_by(schema.run.c.position, schema.run.c.attempt)
    )
    return list({row.position: row for row in connection.execute(query)}.values())


def attempts(connection: Connection, session: int, position: int) -> int:
    """How many attempts at a planned run there are."""
    query = select(func.count()).where(schema.run.c.session_id == session, schema.run.c.position == position)
    return int(connection.execute(query).scalar_one())


def begin_run(
    connection: Connection,
    session: int,
    planned: PlannedRun,
    attempt: int,
    apparatus: Apparatus,
    now: datetime,
) -> int:
    """A new attempt at a planned run; its id."""
    row = {
        "session_id": session,
        "position": planned.position,
        "attempt": attempt,
        "state": "running",
        "practice": planned.practice,
        "paradigm": planned.paradigm,
        "procedure": planned.procedure,
        "finger": planned.finger,
        "frequency_hz": planned.frequency_hz,
        "started_utc": stamp(now),
        **vars(apparatus),
    }
    return int(connection.execute(insert(schema.run).values(row).returning(schema.run.c.id)).scalar_one())


def end_run(connection: Connection, run: int, state: str, now: datetime) -> None:
    """A run is done, restarted or stopped."""
    connection.execute(update(schema.run).where(schema.run.c.id == run).values(state=state, ended_utc=stamp(now)))


def answers(connection: Connection, run: int) -> list[Found]:
    """Every trial of a run with its response, in order."""
    query = (
        select(schema.trial, schema.response)
        .join(schema.response, schema.response.c.trial_id == schema.trial.c.id)
        .where(schema.trial.c.run_id == run)
        .order_by(schema.trial.c.number)
    )
    return list(connection.execute(query))


def tallies(connection: Connection, session: int) -> dict[int, tuple[int, int]]:
    """Answered and right trials of the runs of a session, by the run's row."""
    query = (
        select(schema.run.c.id, func.count(), func.sum(cast(schema.response.c.correct, Integer)))
        .select_from(schema.run.join(schema.trial).join(schema.response))
        .where(schema.run.c.session_id == session)
        .group_by(schema.run.c.id)
    )
    return {int(run): (int(count), int(right)) for run, count, right in connection.execute(query)}


def answer(connection: Connection, session: int, run: int, number: int) -> Found | None:
    """A trial of one of the session's runs with its response and the run's position, if it is there."""
    query = (
        select(schema.trial, schema.response, schema.run.c.position)
        .select_from(schema.response.join(schema.trial).join(schema.run))
        .where(schema.run.c.session_id == session, schema.trial.c.run_id == run, schema.trial.c.number == number)
    )
    return connection.execute(query).first()


@dataclass(frozen=True)
class Answer:
    """A response as it arrived. Client times: milliseconds of the client's own clock."""

    response: str
    received: datetime
    client_shown_ms: float | None = None
    client_pressed_ms: float | None = None


@dataclass(frozen=True)
class Played:
    """A trial that has been played; frequency and level of the curve are None where it is not at one frequency."""

    trial: Trial
    intervals: tuple[IntervalRecord, ...]
    presented: datetime
    frequency_hz: float | None = None
    curve_level_db_re_1um: float | None = None


def save_answer(connection: Connection, run: int, played: Played, answer: Answer) -> None:
    """The trial, its intervals and its response: all of it or, with the transaction, nothing."""
    trial, placement = played.trial, played.trial.placement
    row = {
        "run_id": run,
        "number": trial.number,
        "frequency_hz": played.frequency_hz,
        "level_db_sl": None if placement is None else placement.level_db_sl,
        "curve_level_db_re_1um": played.curve_level_db_re_1um,
        "correct_response": trial.correct,
        "presented_utc": stamp(played.presented),
    }
    key = connection.execute(insert(schema.trial).values(row).returning(schema.trial.c.id)).scalar_one()
    rows = [{"trial_id": key, "position": index, **vars(one)} for index, one in enumerate(played.intervals)]
    if rows:
        connection.execute(insert(schema.interval), rows)
    values = {
        "trial_id": key,
        "response": answer.response,
        "correct": trial.judge(answer.response),
        "client_shown_ms": answer.client_shown_ms,
        "client_pressed_ms": answer.client_pressed_ms,
        "server_received_utc": stamp(answer.received),
    }
    connection.execute(insert(schema.response).values(values))


def note(
    connection: Connection, session: int | None, kind: str, detail: str, now: datetime, trials: int | None = None
) -> None:
    """Something that happened."""
    row = {"session_id": session, "at_utc": stamp(now), "kind": kind, "detail": detail, "trials": trials}
    connection.execute(insert(schema.event).values(row))


def last_break(connection: Connection, session: int) -> int:
    """Trials the session had when its last break ended; 0 if there was none."""
    query = select(func.max(schema.event.c.trials)).where(
        schema.event.c.session_id == session, schema.event.c.kind == "break"
    )
    return int(connection.execute(query).scalar() or 0)


def trial_count(connection: Connection, session: int) -> int:
    """Answered trials of the session, of runs given up as well."""
    query = (
        select(func.count())
        .select_from(schema.response.join(schema.trial).join(schema.run))
        .where(schema.run.c.session_id == session)
    )
    return int(connection.execute(query).scalar_one())
