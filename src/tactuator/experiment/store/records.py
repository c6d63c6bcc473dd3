"""Reading and writing of studies, subjects, sessions, runs, trials and the responses to them, in a store."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, cast

from sqlalchemy import Column, ColumnElement, Connection, Integer, Row, Select, Table, func, insert, select, update
from sqlalchemy import cast as sql_cast

from tactuator import __version__
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.protocol.study import PlannedRun, StudyProtocol, SubjectPart
from tactuator.experiment.store import schema
from tactuator.experiment.trial import IntervalRecord, Trial

Found = Row[Any]


def stamp(when: datetime) -> str:
    """Return an instant as the store writes it: ISO 8601 with its zone, to the microsecond."""
    return when.isoformat(timespec="microseconds")


PROGRAM = "tactuator"
"""Who did what nobody asked for."""

Tokens = Callable[[str, int], str]
"""A function of the subject's code and the number of the visit that returns the token of a link."""


def _last(connection: Connection, column: Column[Any], *where: ColumnElement[bool]) -> Any:
    return connection.execute(select(func.max(column)).where(*where)).scalar()


def _add(connection: Connection, table: Table, row: Mapping[str, Any]) -> Found:
    return connection.execute(insert(table).returning(table), row).one()


def _change(connection: Connection, table: Table, row: int, **values: Any) -> None:
    connection.execute(update(table).where(table.c.id == row).values(**values))


def add_study(connection: Connection, name: str, now: datetime) -> int:
    """Store a new study and return its id."""
    return int(_add(connection, schema.study, {"name": name, "created_utc": stamp(now)}).id)


def study_by_version(connection: Connection, text: str) -> int | None:
    """Return the newest study that has had a protocol of exactly that text, or None."""
    version = schema.protocol_version.c
    return cast("int | None", _last(connection, version.study_id, version.sha256 == protocol_hash(text)))


def study_by_name(connection: Connection, name: str) -> int | None:
    """Return the newest study of that name, or None."""
    return cast("int | None", _last(connection, schema.study.c.id, schema.study.c.name == name))


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
    last = _last(connection, table.c.number, table.c.study_id == study) or 0
    row = {
        "study_id": study,
        "number": last + 1,
        "toml": text,
        "sha256": protocol_hash(text),
        "reason": reason,
        "tool_version": __version__,
        "created_utc": stamp(now),
    }
    return int(_add(connection, table, row).id)


def has_begun(connection: Connection, version: int) -> bool:
    """Return whether there are runs of that version of a protocol."""
    run = schema.run.c
    return connection.execute(select(run.id).where(run.protocol_version_id == version).limit(1)).first() is not None


def subjects(connection: Connection, study: int) -> list[Found]:
    """Return the study's subjects in the order in which they were enrolled."""
    table = schema.subject
    return list(connection.execute(select(table).where(table.c.study_id == study).order_by(table.c.number)))


RENAMED = "renamed"
"""Kind of the event of another code; `before` is the former one."""


def codes(connection: Connection, study: int) -> dict[str, int]:
    """Return the codes that the study's subjects have or had, each with the subject's row."""
    event, subject = schema.event, schema.subject
    mine = event.join(subject, subject.c.id == event.c.subject_id)
    former = select(event.c.before, subject.c.id).select_from(mine)
    former = former.where(subject.c.study_id == study, event.c.kind == RENAMED)
    known = {row.before: row.id for row in connection.execute(former)}
    return known | {row.code: row.id for row in subjects(connection, study)}


def rename_subject(connection: Connection, subject: Found, code: str) -> None:
    """Write another code of a subject, also where events have it as who acted."""
    event, session = schema.event, schema.session
    mine = event.c.session_id.in_(select(session.c.id).where(session.c.subject_id == subject.id))
    acted = mine & (event.c.who == f"subject {subject.code}")
    connection.execute(update(event).where(acted).values(who=f"subject {code}"))
    change_subject(connection, subject.id, code=code)


def add_subject(
    connection: Connection, study: int, new: SubjectPart, facts: Mapping[str, tuple[str, str]], now: datetime
) -> Found:
    """Store a subject under the next number and return the row; facts: (value, unit) of each demographic item."""
    last = _last(connection, schema.subject.c.number, schema.subject.c.study_id == study)
    row = {
        "study_id": study,
        "number": 0 if last is None else last + 1,
        "code": new.code,
        "subject_group": new.group,
        "participant_id": new.participant_id,
        "enrolled_utc": stamp(now),
    }
    subject = _add(connection, schema.subject, row)
    for name, (value, unit) in facts.items():
        set_fact(connection, subject.id, name, value, unit)
    return subject


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
    last = _last(connection, table.c.visit, table.c.subject_id == subject.id) or 0
    circumstances = dict(vars(protocol.circumstances))
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
    _add(connection, table, row)


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
    _change(connection, schema.session, session, **values)


def change_subject(connection: Connection, subject: int, **values: Any) -> None:
    """Write columns of a subject's row."""
    _change(connection, schema.subject, subject, **values)


def facts(connection: Connection, study: int) -> dict[int, dict[str, str]]:
    """Return the demographic items of the study's subjects by their row and the item's name."""
    fact, facts = schema.demographic, dict[int, dict[str, str]]()
    mine = (schema.subject.c.study_id == study, fact.c.value.is_not(None))
    query = select(fact).join(schema.subject).where(*mine).order_by(fact.c.id)
    for row in connection.execute(query):
        facts.setdefault(row.subject_id, {})[row.name] = row.value
    return facts


def set_fact(connection: Connection, subject: int, name: str, value: str | None, unit: str) -> None:
    """Write a demographic item of a subject; None: nothing is known any more."""
    fact = schema.demographic
    there = connection.execute(select(fact.c.id).where(fact.c.subject_id == subject, fact.c.name == name)).scalar()
    if there is not None:
        _change(connection, fact, there, value=value, unit=unit)
    elif value is not None:
        _add(connection, fact, {"subject_id": subject, "name": name, "value": value, "unit": unit})


@dataclass(frozen=True)
class Visit:
    """The respondent of a visit, and what of the stimuli they can see or hear, as stored with every run.

    respondent: person, simulated or script. shown: empty, or "seen" or "seen and heard" in a demonstration.
    """

    respondent: str = "person"
    shown: str = ""


def latest_runs(connection: Connection, session: int) -> list[Found]:
    """Return the last attempt at every position, in order."""
    query = (
        select(schema.run)
        .where(schema.run.c.session_id == session)
        .order_by(schema.run.c.position, schema.run.c.attempt)
    )
    return list({row.position: row for row in connection.execute(query)}.values())


def begin_run(
    connection: Connection,
    session: int,
    planned: PlannedRun,
    attempt: int,
    apparatus: Mapping[str, Any],
    visit: Visit,
    version: int,
    now: datetime,
) -> int:
    """Store a new attempt at a planned run under that version of the protocol, and return its id.

    apparatus: columns of the run that describe what plays it.
    """
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
        "protocol_version_id": version,
        **apparatus,
        **vars(visit),
    }
    return int(_add(connection, schema.run, row).id)


def end_run(connection: Connection, run: int, state: str, now: datetime) -> None:
    """Store that a run is done, restarted or stopped."""
    _change(connection, schema.run, run, state=state, ended_utc=stamp(now))


@dataclass(frozen=True)
class Change:
    """A value that was replaced; item: its name, as the exports' columns have it. None: no value before, or now."""

    item: str
    before: str | None
    after: str | None


CONSENT_NAME = "consent-name"
"""Kind of the event with the name of who consented; in no export."""


def note(
    connection: Connection,
    session: int | None,
    kind: str,
    detail: str,
    now: datetime,
    who: str,
    trials: int | None = None,
    subject: int | None = None,
    change: Change | None = None,
) -> None:
    """Store an event. who: whose doing; subject: whose it is, where of no session; change: what it replaced."""
    row = {"session_id": session, "at_utc": stamp(now), "who": who, "kind": kind, "detail": detail, "trials": trials}
    _add(connection, schema.event, row | {"subject_id": subject, **(vars(change) if change is not None else {})})


def last_break(connection: Connection, session: int) -> int:
    """Return the number of trials that the session had when its last break ended; 0 if there was none."""
    event = schema.event.c
    return int(_last(connection, event.trials, event.session_id == session, event.kind == "break") or 0)


def answers(connection: Connection, run: int) -> list[Found]:
    """Return every trial of a run with its response, in order."""
    query = (
        select(schema.trial, schema.response)
        .join(schema.response, schema.response.c.trial_id == schema.trial.c.id)
        .where(schema.trial.c.run_id == run)
        .order_by(schema.trial.c.number)
    )
    return list(connection.execute(query))


def tallies(connection: Connection, session: int) -> dict[int, Found]:
    """Return what is answered of a session's runs, given up ones included, by the run's row.

    answered, right: numbers of trials. last_utc: when the last response arrived.
    """
    response = schema.response.c
    columns = (
        func.count().label("answered"),
        func.sum(sql_cast(response.correct, Integer)).label("right"),
        func.max(response.server_received_utc).label("last_utc"),
    )
    query = (
        select(schema.run.c.id, *columns)
        .select_from(schema.run.join(schema.trial).join(schema.response))
        .where(schema.run.c.session_id == session)
        .group_by(schema.run.c.id)
    )
    return {int(row.id): row for row in connection.execute(query)}


def answer(connection: Connection, session: int, run: int, number: int) -> Found | None:
    """Return a trial of one of the session's runs with its response and the run's position, or None."""
    query = (
        select(schema.trial, schema.response, schema.run.c.position)
        .select_from(schema.response.join(schema.trial).join(schema.run))
        .where(schema.run.c.session_id == session, schema.trial.c.run_id == run, schema.trial.c.number == number)
    )
    return connection.execute(query).first()


@dataclass(frozen=True)
class Answer:
    """A response as it arrived.

    client_shown_ms, client_pressed_ms: by the client's own clock. client_lit_ms: when the client lit each interval's
    visual cue, by the same clock. received_s: by the server's monotonic clock, where it was read as the response
    arrived.
    """

    response: str
    received: datetime
    client_shown_ms: float | None = None
    client_pressed_ms: float | None = None
    client_lit_ms: tuple[float | None, ...] = ()
    received_s: float | None = None


@dataclass(frozen=True)
class PlayedTrial:
    """A trial that has been played.

    frequency_hz, curve_level_db_re_1um: None where it is not at one frequency. presented, ended: its beginning and end
    by the server's clock (ended_s by its monotonic one). rig_tick: its beginning by the rig's clock. lasted_s: its
    duration there. presentations: how often it was played until then.
    """

    trial: Trial
    intervals: tuple[IntervalRecord, ...]
    presented: datetime
    frequency_hz: float | None = None
    curve_level_db_re_1um: float | None = None
    rig_tick: int | None = None
    lasted_s: float = 0.0
    ended: datetime | None = None
    ended_s: float | None = None
    presentations: int = 1


def save_answer(connection: Connection, run: int, played: PlayedTrial, answer: Answer) -> None:
    """Store the trial, its intervals and its response, all of them or, with the transaction, none."""
    trial, placement = played.trial, played.trial.placement
    row = {
        "run_id": run,
        "number": trial.number,
        "frequency_hz": played.frequency_hz,
        "level_db_sl": None if placement is None else placement.level_db_sl,
        "curve_level_db_re_1um": played.curve_level_db_re_1um,
        "correct_response": trial.correct,
        "presented_utc": stamp(played.presented),
        "ended_utc": None if played.ended is None else stamp(played.ended),
        "presentations": played.presentations,
        "rig_tick": played.rig_tick,
    }
    added = _add(connection, schema.trial, row)
    lit = [*answer.client_lit_ms, *([None] * len(played.intervals))]
    rows = [
        {"trial_id": added.id, "position": index, **vars(interval), "client_lit_ms": lit[index]}
        for index, interval in enumerate(played.intervals)
    ]
    connection.execute(insert(schema.interval), rows)
    ended_s, received_s = played.ended_s, answer.received_s
    values = {
        "trial_id": added.id,
        "response": trial.as_stored(answer.response),
        "correct": trial.judge(answer.response),
        "client_shown_ms": answer.client_shown_ms,
        "client_pressed_ms": answer.client_pressed_ms,
        "server_received_utc": stamp(answer.received),
        "server_after_end_s": None if received_s is None or ended_s is None else received_s - ended_s,
    }
    connection.execute(insert(schema.response), values)
