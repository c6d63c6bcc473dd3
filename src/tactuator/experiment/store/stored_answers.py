"""Answers to tasks as they are in the store, ready for analysis."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from sqlalchemy import Connection, select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_any_protocol
from tactuator.experiment.protocol.judging import JudgingProtocol
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Found, session_query
from tactuator.experiment.store.store import Store
from tactuator.experiment.task.task_keys import Answered, AnsweredRun, JudgedTone, TaskKeys


def answered_runs(
    store: Store, kind: str, session: int | None = None, group: str | None = None, state: str = "done"
) -> tuple[AnsweredRun, ...]:
    """Return the runs of that task and state in all the store's studies, or of one session or group of subjects.

    Practice and what was withdrawn are left out. Raises BadInput without any.
    """
    run = schema.run.c
    with store.read() as connection:
        sessions = {row.id: row for row in connection.execute(session_query().where(schema.KEPT))}
        wanted = [run.state == state, run.practice.is_(False), run.paradigm == kind]
        if session is not None:
            wanted.append(run.session_id == session)
        query = select(schema.run).where(*wanted).order_by(run.session_id, run.position, run.attempt)
        rows = [row for row in connection.execute(query) if row.session_id in sessions]
        if group is not None:
            rows = [row for row in rows if sessions[row.session_id].subject_group == group]
        trials = _trials(connection, [row.id for row in rows])
    if not rows:
        where = f"store {store.path}" if session is None else "the session"
        raise BadInput(f"{where} has no {state} run of {kind}", "one with at least one")
    return tuple(_run(sessions[row.session_id], row, trials.get(row.id, ())) for row in rows)


def task_keys(store: Store, kind: str | None = None) -> tuple[TaskKeys, ...]:
    """Return the tables [task] that the store's protocols have, the newest last. kind: only of that kind."""
    with store.read() as connection:
        texts = connection.execute(select(schema.protocol_version.c.toml).order_by(schema.protocol_version.c.id))
        protocols = [parse_any_protocol(text) for text in texts.scalars()]
    tasks = [protocol.task for protocol in protocols if isinstance(protocol, JudgingProtocol)]
    return tuple(task for task in tasks if kind in (None, task.kind))


def _run(session: Found, run: Found, trials: Sequence[Answered]) -> AnsweredRun:
    simulated = run.respondent in ("simulated", "script") or bool(run.rig_simulated)
    return AnsweredRun(session.subject_code, run.finger, run.frequency_hz, tuple(trials), simulated)


def _trials(connection: Connection, runs: Sequence[int]) -> dict[int, tuple[Answered, ...]]:
    """Return the answered trials of runs, by run."""
    trial, response, interval = schema.trial.c, schema.response.c, schema.interval.c
    tables = schema.trial.join(schema.response).join(schema.interval, interval.trial_id == trial.id)
    columns = (
        *(trial.run_id, trial.id, trial.level_db_sl, trial.frequency_hz, trial.curve_level_db_re_1um),
        *(response.response, response.correct),
    )
    query = (
        select(*columns, interval.stimulus, interval.commanded_db_sl)
        .select_from(tables)
        .where(trial.run_id.in_(runs))
        .order_by(trial.run_id, trial.number, interval.position)
    )
    answers: dict[int, list[Answered]] = {}
    for (run, *_), rows in groupby(connection.execute(query), key=lambda row: (row.run_id, row.id)):
        intervals = list(rows)
        tones = tuple(_tone(row.stimulus, row.commanded_db_sl) for row in intervals)
        first = intervals[0]
        about = first.level_db_sl, first.response, bool(first.correct)
        point = first.frequency_hz, first.curve_level_db_re_1um
        answers.setdefault(run, []).append(Answered(tones, *about, None if None in point else point))
    return {run: tuple(trials) for run, trials in answers.items()}


def _tone(label: str, level_db_sl: float | None) -> JudgedTone | None:
    """Return the tone of an interval that had just one."""
    if level_db_sl is None:
        return None
    role, _, rest = label.partition(":")
    finger, _, hertz = rest.rpartition(":")
    return JudgedTone(role, finger, float(hertz), level_db_sl)
