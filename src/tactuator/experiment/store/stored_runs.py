"""Runs with their trials, and answers to tasks, as they are in the store, ready for analysis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, groupby
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray
from sqlalchemy import Connection, Integer, Select, select

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.protocol.judging import JudgingProtocol
from tactuator.experiment.protocol.study import FORCED_CHOICE, StudyProtocol
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Found, session_query
from tactuator.experiment.store.store import Store
from tactuator.experiment.task.task import Answered, AnsweredRun, Task
from tactuator.experiment.trial import LOUD, SIGNAL, Tone

_RUNS = 256
"""Runs that are read at once."""
_TONE, _LOUD, _SATURATED = 1, 2, 4


@dataclass(frozen=True, eq=False)
class StoredIntervals:
    """Intervals of all trials of a run, as many of each; arrays (intervals,).

    is_tone, is_loud: True where a stimulus of that label was. commanded_db_sl, measured_db_sl: NaN where there is none.
    saturated: True where a converter was.
    """

    is_tone: NDArray[np.bool_]
    is_loud: NDArray[np.bool_]
    commanded_db_sl: FloatArray
    measured_db_sl: FloatArray
    saturated: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A stored run with its trials.

    session, run: their rows. frequency_hz, levels_db_sl, curve_level_db_re_1um, correct: (trials,). intervals: of all.
    """

    session: Found
    run: Found
    protocol: Protocol
    frequency_hz: FloatArray
    levels_db_sl: FloatArray
    curve_level_db_re_1um: FloatArray
    correct: NDArray[np.bool_]
    intervals: StoredIntervals


def detection_runs(store: Store, session: int | None = None) -> list[StoredRun]:
    """Return the runs that are done in all the store's studies, or in one session, practice left out.

    Raises BadInput without any.
    """
    with store.read() as connection:
        versions = select(schema.protocol_version)
        every = {row.id: parse_protocol(row.toml, StudyProtocol) for row in connection.execute(versions)}
        protocols = {row: protocol for row, protocol in every.items() if isinstance(protocol, Protocol)}
        sessions = {row.id: row for row in connection.execute(session_query().where(schema.KEPT))}
        rows = _done(connection, FORCED_CHOICE, session, sessions)
        runs = []
        for first in range(0, len(rows), _RUNS):
            part = rows[first : first + _RUNS]
            trials, intervals = (read(connection, part) for read in (_trials, _intervals))
            for row in part:
                kind, commanded, measured = intervals.of(row.id)
                tone, loud, saturated = ((kind & bit) != 0 for bit in (_TONE, _LOUD, _SATURATED))
                seen = StoredIntervals(tone, loud, commanded, measured, saturated)
                about = (sessions[row.session_id], row, protocols[row.protocol_version_id])
                frequency_hz, level, base, correct = trials.of(row.id)
                runs.append(StoredRun(*about, frequency_hz, level, base, correct, seen))
    if not rows:
        raise _none(store.name, session, "done run")
    return runs


def _done(connection: Connection, paradigm: str, session: int | None, sessions: Mapping[int, Found]) -> list[Found]:
    run = schema.run.c
    wanted = [run.state == "done", run.practice.is_(False), run.paradigm == paradigm]
    if session is not None:
        wanted.append(run.session_id == session)
    query = select(schema.run).where(*wanted).order_by(run.session_id, run.position, run.attempt)
    return [row for row in connection.execute(query) if row.session_id in sessions]


def _none(store: str, session: int | None, what: str) -> BadInput:
    return BadInput(f"{f'store {store}' if session is None else 'the session'} has no {what}", "one with at least one")


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of many runs, sorted by run: its id in each row, and columns (rows,)."""

    run: NDArray[np.int64]
    columns: tuple[NDArray[Any], ...]

    @classmethod
    def read(cls, connection: Connection, query: Select[Any], types: Sequence[DTypeLike]) -> _Rows:
        """Read the query's rows of numbers, the run's id first; a cell without a value is NaN.

        They come as plain tuples from the driver's own cursor: a Row for each of millions took as long as SQLite.
        """
        cursor = connection.execute(query).cursor
        assert cursor is not None
        cells = np.fromiter(chain.from_iterable(cursor.fetchall()), np.float64).reshape(-1, 1 + len(types))
        columns = (cells[:, place].astype(of) for place, of in enumerate((np.int64, *types)))
        run, *others = columns
        return cls(run, tuple(others))

    def of(self, run: int) -> tuple[NDArray[Any], ...]:
        mine = slice(*np.searchsorted(self.run, [run, run + 1]))
        return tuple(column[mine] for column in self.columns)


def _trials(connection: Connection, runs: Sequence[Found]) -> _Rows:
    """Return the runs' trials that were answered: frequency, level, the curve's level, and whether it was right."""
    trial, response = schema.trial, schema.response
    columns = (trial.c.frequency_hz, trial.c.level_db_sl, trial.c.curve_level_db_re_1um, response.c.correct)
    query = (
        select(trial.c.run_id, *columns)
        .join_from(trial, response, response.c.trial_id == trial.c.id)
        .where(trial.c.run_id.in_([run.id for run in runs]))
        .order_by(trial.c.run_id, trial.c.number)
    )
    return _Rows.read(connection, query, (np.float64, np.float64, np.float64, np.bool_))


def _intervals(connection: Connection, runs: Sequence[Found]) -> _Rows:
    """Return the intervals of the runs' trials: bits of what each was, commanded and measured level."""
    trial, interval = schema.trial, schema.interval
    kind = (
        _TONE * (interval.c.stimulus == SIGNAL).cast(Integer)
        + _LOUD * (interval.c.stimulus == LOUD).cast(Integer)
        + _SATURATED * interval.c.saturated.cast(Integer)
    )
    query = (
        select(trial.c.run_id, kind, interval.c.commanded_db_sl, interval.c.measured_db_sl)
        .join_from(trial, interval, interval.c.trial_id == trial.c.id)
        .where(trial.c.run_id.in_([run.id for run in runs]))
        .order_by(trial.c.run_id, trial.c.number, interval.c.position)
    )
    return _Rows.read(connection, query, (np.uint8, np.float64, np.float64))


def answered_runs(
    store: Store, kind: str, session: int | None = None, group: str | None = None
) -> tuple[AnsweredRun, ...]:
    """Return the runs of that task that are done in all the store's studies, or in one session or group of subjects.

    Practice and what was withdrawn are left out. Raises BadInput without any.
    """
    with store.read() as connection:
        sessions = {row.id: row for row in connection.execute(session_query().where(schema.KEPT))}
        rows = _done(connection, kind, session, sessions)
        if group is not None:
            rows = [row for row in rows if sessions[row.session_id].subject_group == group]
        trials = _answered(connection, [row.id for row in rows])
    if not rows:
        raise _none(str(store.path), session, f"done run of {kind}")
    return tuple(_run(sessions[row.session_id], row, trials.get(row.id, ())) for row in rows)


def stored_tasks(store: Store, kind: str | None = None) -> tuple[Task, ...]:
    """Return the tables [task] that the store's protocols have, the newest last. kind: only of that kind."""
    with store.read() as connection:
        texts = connection.execute(select(schema.protocol_version.c.toml).order_by(schema.protocol_version.c.id))
        protocols = [parse_protocol(text, StudyProtocol) for text in texts.scalars()]
    tasks = [protocol.task for protocol in protocols if isinstance(protocol, JudgingProtocol)]
    return tuple(task for task in tasks if kind in (None, task.kind))


def _run(session: Found, run: Found, trials: Sequence[Answered]) -> AnsweredRun:
    simulated = run.respondent in ("simulated", "script") or bool(run.rig_simulated)
    return AnsweredRun(session.subject_code, run.finger, run.frequency_hz, tuple(trials), simulated)


def _answered(connection: Connection, runs: Sequence[int]) -> dict[int, tuple[Answered, ...]]:
    trial, response, interval = schema.trial.c, schema.response.c, schema.interval.c
    tables = schema.trial.join(schema.response).join(schema.interval, interval.trial_id == trial.id)
    columns = (
        *(trial.run_id, trial.id, trial.level_db_sl, trial.frequency_hz, trial.curve_level_db_re_1um),
        *(response.response, response.correct),
    )
    query = (
        select(*columns, interval.stimulus, interval.commanded_db_sl, interval.measured_db_sl)
        .select_from(tables)
        .where(trial.run_id.in_(runs))
        .order_by(trial.run_id, trial.number, interval.position)
    )
    answers: dict[int, list[Answered]] = {}
    for (run, *_), rows in groupby(connection.execute(query), key=lambda row: (row.run_id, row.id)):
        intervals = list(rows)
        tones = tuple(_tone(row.stimulus, row.commanded_db_sl, row.measured_db_sl) for row in intervals)
        first = intervals[0]
        about = first.level_db_sl, first.response, bool(first.correct)
        point = first.frequency_hz, first.curve_level_db_re_1um
        answers.setdefault(run, []).append(Answered(tones, *about, None if None in point else point))
    return {run: tuple(trials) for run, trials in answers.items()}


def _tone(label: str, level_db_sl: float | None, measured_db_sl: float | None) -> Tone | None:
    if level_db_sl is None:
        return None
    role, _, rest = label.partition(":")
    finger, _, hertz = rest.rpartition(":")
    return Tone(role, finger, float(hertz), level_db_sl, measured_db_sl=measured_db_sl)
