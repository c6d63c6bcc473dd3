"""Reading of a store: tables of the exports' dictionary, runs with their trials, answers to tasks, protocols."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, groupby
from operator import attrgetter
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Connection, Integer, Select, literal_column, select

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
from tactuator.experiment.words import COLUMNS

_P = TypeVar("_P", bound=StudyProtocol)
_Task = TypeVar("_Task", bound=Task)


PROGRAMS = ("simulated", "script")
"""Respondents that are programs."""
TRIALS = schema.ANSWERED.outerjoin(
    schema.protocol_version, schema.run.c.protocol_version_id == schema.protocol_version.c.id
)
"""What columns of `trials` are read from."""
INTERVALS = schema.ANSWERED.join(schema.interval, schema.interval.c.trial_id == schema.trial.c.id)
"""What columns of `intervals` are read from, beside which those of their trials may be."""


def selected(table: str, *names: str) -> list[ColumnElement[Any]]:
    """Return columns of a table of the dictionary as SQL under their names, by default all of them."""
    by_name = {column.name: column.source for column in COLUMNS[table]}
    return [literal_column(by_name[name]).label(name) for name in names or by_name]


def plain_rows(connection: Connection, query: Select[Any]) -> Iterator[Sequence[Any]]:
    """Yield the rows as the driver's own cursor has them: a Row for each of millions took as long as SQLite."""
    return iter(cast(Iterable[Sequence[Any]], connection.execute(query).cursor))


def stored_protocols(connection: Connection, form: type[_P]) -> dict[int, _P]:
    """Return the protocols of that form by the row of their version, the oldest first; form: StudyProtocol for all.

    One that cannot be read here, of another release or of a package that is not installed, is left out: it keeps
    nobody from the other studies of the store.
    """
    return {row: protocol for row, protocol in _protocols(connection).items() if isinstance(protocol, form)}


def _protocols(connection: Connection) -> dict[int, StudyProtocol | BadInput]:
    """Return every protocol by the row of its version, or why it cannot be read here."""
    version, study = schema.protocol_version, schema.study
    query = select(version, study.c.name.label("study")).join(study).order_by(version.c.id)
    every: dict[int, StudyProtocol | BadInput] = {}
    for row in connection.execute(query):
        try:
            every[row.id] = parse_protocol(row.toml, StudyProtocol)
        except BadInput as error:
            every[row.id] = error.within(f"study {row.study!r}, version {row.number}")
    return every


RUNS_AT_ONCE = 1024
"""Runs whose trials are played through anew before any of them is let go: a million trials would take up 100 MB."""
_RUNS = 256
"""Runs that are read at once."""
TONE, LOUD_TONE, SATURATED = 1, 2, 4
_CATCH_KINDS = np.array(["blank", "", "loud", "loud"])
"""Kinds of trials whose intervals have neither, TONE, LOUD_TONE, or both."""


@dataclass(frozen=True, eq=False)
class StoredIntervals:
    """Intervals of all trials of a run, as many of each; arrays (intervals,).

    kind: bits of what each had: TONE and LOUD_TONE, a stimulus of that label; SATURATED, a saturated converter.
    commanded_db_sl, measured_db_sl: NaN without one.
    """

    kind: NDArray[np.uint8]
    commanded_db_sl: FloatArray
    measured_db_sl: FloatArray


NO_INTERVALS = StoredIntervals(np.zeros(0, np.uint8), np.zeros(0), np.zeros(0))
"""Those of a run that has none, or whose intervals are not needed any more."""


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A stored run with its trials.

    session, run: their rows. stored_protocol: its protocol, or why that cannot be read. frequency_hz, levels_db_sl,
    curve_level_db_re_1um, correct: (trials,). intervals: of all. void: the run, or trials of it, are not to be used.
    void_included: they are here all the same.
    """

    session: Found
    run: Found
    stored_protocol: Protocol | BadInput
    frequency_hz: FloatArray
    levels_db_sl: FloatArray
    curve_level_db_re_1um: FloatArray
    correct: NDArray[np.bool_]
    intervals: StoredIntervals
    void: bool = False
    void_included: bool = False

    @property
    def protocol(self) -> Protocol:
        """Return the run's protocol. Raises BadInput where it cannot be read here."""
        if isinstance(self.stored_protocol, BadInput):
            raise self.stored_protocol
        return self.stored_protocol

    @property
    def whole(self) -> bool:
        """Return whether every trial is there, so that its procedure can be replayed."""
        return self.void_included or not self.void

    @cached_property
    def catch_kinds(self) -> NDArray[np.str_]:
        """Return the kind of each trial, shape (trials,): "loud", "blank", or "" where the procedure placed it."""
        trials, kind = self.correct.size, self.intervals.kind
        each = kind.size // max(trials, 1)
        if each == 0:
            return np.full(trials, "", dtype="<U5")
        of_trials = np.bitwise_or.reduce(kind[: trials * each].reshape(trials, each), axis=1)
        return np.asarray(_CATCH_KINDS[of_trials & (TONE | LOUD_TONE)])


def detection_runs(store: Store, session: int | None = None, group: str | None = None) -> list[StoredRun]:
    """Return the runs that are done in all the store's studies, or in one session or group of subjects, in order.

    Practice and what may not be used are left out. Raises BadInput without any.
    """
    return sorted((run for part in required_parts(store, session, group) for run in part), key=in_order)


def required_parts(store: Store, session: int | None = None, group: str | None = None) -> Iterator[list[StoredRun]]:
    """Yield `detection_parts`. Raises BadInput without any."""
    part = None
    for part in detection_parts(store, session, group):
        yield part
    if part is None:
        raise _none(store, session, group, "done run")


def in_order(run: StoredRun) -> tuple[int, int, int]:
    """Return what runs are ordered by."""
    return run.run.session_id, run.run.position, run.run.attempt


def detection_parts(store: Store, session: int | None = None, group: str | None = None) -> Iterator[list[StoredRun]]:
    """Yield what `detection_runs` returns in parts that are fitted at once, each of one protocol at one display."""
    with store.read() as connection:
        every = _protocols(connection).items()
        protocols = {row: protocol for row, protocol in every if isinstance(protocol, Protocol | BadInput)}
        sessions = {row.id: row for row in connection.execute(session_query())}
        wanted = _done(store, FORCED_CHOICE, session, group)
        done = select(schema.run).select_from(schema.RUNS).where(*wanted).order_by(*_IN_ORDER)
        void = {*connection.execute(schema.VOID_RUNS).scalars()}
        alike: dict[tuple[int, float, float], list[Found]] = {}
        for row in connection.execute(done):
            if row.protocol_version_id in protocols:
                key = (row.protocol_version_id, row.band_low_hz, row.band_high_hz)
                alike.setdefault(key, []).append(row)
        for (version, *_), rows in alike.items():
            for first in range(0, len(rows), RUNS_AT_ONCE):
                part = rows[first : first + RUNS_AT_ONCE]
                yield [
                    StoredRun(
                        sessions[row.session_id], row, protocols[version], *answered, row.id in void, store.voided
                    )
                    for row, answered in _trials_of(connection, part, store.usable)
                ]


_Answered = tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_], StoredIntervals]


def _trials_of(
    connection: Connection, runs: Sequence[Found], usable: schema.Usable
) -> Iterator[tuple[Found, _Answered]]:
    """Yield each run that has trials, with those."""
    for first in range(0, len(runs), _RUNS):
        part = runs[first : first + _RUNS]
        trials, intervals = (read(connection, part, usable) for read in (_trials, _intervals))
        for row, (frequency_hz, level, base, correct), seen in zip(part, trials, intervals, strict=True):
            if correct.size:
                yield row, (frequency_hz, level, base, correct, StoredIntervals(*seen))


def _done(store: Store, paradigm: str, session: int | None, group: str | None) -> list[ColumnElement[bool]]:
    """Return what holds of the runs that are done, practice and what may not be used left out."""
    run = schema.run.c
    wanted = [store.usable.runs, run.state == "done", run.practice.is_(False), run.paradigm == paradigm]
    of_session = [] if session is None else [run.session_id == session]
    return [*wanted, *of_session, *([] if group is None else [schema.subject.c.subject_group == group])]


_IN_ORDER = (schema.run.c.session_id, schema.run.c.position, schema.run.c.attempt)


def _none(store: Store, session: int | None, group: str | None, what: str) -> BadInput:
    of_group = "" if group is None else f" of group {group!r}"
    where = f"store {store.name}" if session is None else "the session"
    return BadInput(f"{where} has no {what}{of_group}", "one with at least one")


_Columns = Iterator[tuple[NDArray[Any], ...]]


def _trials(connection: Connection, runs: Sequence[Found], usable: schema.Usable) -> _Columns:
    """Yield, of each run, its answered trials: frequency, level, the curve's level, and whether it was right."""
    wanted = selected("trials", "frequency_hz", "level_db_sl", "curve_level_db_re_1um", "correct")
    query = select(_RUN, *wanted).select_from(_ANSWERED).where(usable.trials)
    run, *levels, correct = _read(connection, query, runs)
    return _by_run(runs, run, (*levels, correct.astype(np.bool_)))


def _intervals(connection: Connection, runs: Sequence[Found], usable: schema.Usable) -> _Columns:
    """Yield, of each run, the columns of StoredIntervals."""
    names = ("stimulus", "saturated", "commanded_db_sl", "measured_db_sl")
    stimulus, saturated, *levels = selected("intervals", *names)
    kind = (
        TONE * (stimulus == SIGNAL).cast(Integer)
        + LOUD_TONE * (stimulus == LOUD).cast(Integer)
        + SATURATED * saturated.cast(Integer)
    )
    query = select(_RUN, kind, *levels).select_from(_ANSWERED.join(schema.interval)).where(usable.trials)
    run, kinds, *levels_db_sl = _read(connection, query, runs, schema.interval.c.position)
    return _by_run(runs, run, (kinds.astype(np.uint8), *levels_db_sl))


def _read(
    connection: Connection, query: Select[Any], runs: Sequence[Found], *by: ColumnElement[Any]
) -> list[FloatArray]:
    """Return the query's columns of numbers, (rows,), of these runs by run and trial; NaN: without a value."""
    wanted = query.where(_RUN.in_([row.id for row in runs])).order_by(_RUN, schema.trial.c.number, *by)
    cells = np.fromiter(chain.from_iterable(plain_rows(connection, wanted)), np.float64)
    return [column.copy() for column in cells.reshape(-1, len(query.selected_columns)).T]


def _by_run(runs: Sequence[Found], run: FloatArray, columns: Sequence[NDArray[Any]]) -> _Columns:
    """Yield, of each run, its part of the columns, (rows,); run: that of each row, in order."""
    wanted = np.array([row.id for row in runs])
    ends = (np.searchsorted(run, wanted, side).tolist() for side in ("left", "right"))
    for first, after in zip(*ends, strict=True):
        yield tuple(column[first:after] for column in columns)


_RUN = schema.trial.c.run_id
_ANSWERED = schema.trial.join(schema.response)
"""Without what the run is of: to look that up for every trial took longer than the trials."""


def answered_runs(
    store: Store, kind: str, session: int | None = None, group: str | None = None
) -> tuple[AnsweredRun, ...]:
    """Return the runs of that task that are done in all the store's studies, or in one session or group of subjects.

    Practice and what was withdrawn are left out. A subject is named by `names_of`. Raises BadInput without any.
    """
    of_trials = ("subject", "finger", "trial", "level_db_sl", "frequency_hz", "curve_level_db_re_1um", "response")
    cells = [
        *selected("intervals", "run", "stimulus", "commanded_db_sl", "measured_db_sl", "simulated"),
        *selected("trials", *of_trials, "correct"),
        schema.run.c.frequency_hz.label("run_hz"),
        schema.session.c.study_id,
    ]
    query = (
        select(*cells)
        .select_from(INTERVALS)
        .where(*_done(store, kind, session, group), store.usable.trials)
        .order_by(*_IN_ORDER, schema.trial.c.number, schema.interval.c.position)
    )
    with store.read() as connection:
        rows = list(connection.execute(query))
    if not rows:
        raise _none(store, session, group, f"done run of {kind}")
    names = names_of((row.study_id, row.subject) for row in rows)
    return tuple(_answered_run(list(of_run), names) for _, of_run in groupby(rows, key=attrgetter("run")))


def names_of(people: Iterable[tuple[int, str]]) -> dict[tuple[int, str], str]:
    """Return what to call each person, by study and code: the code, or `CODE-STUDY` where several studies have it."""
    each = sorted(set(people))
    codes = Counter(code for _, code in each)
    return {(study, code): code if codes[code] == 1 else f"{code}-{study}" for study, code in each}


def _answered_run(rows: Sequence[Found], names: Mapping[tuple[int, str], str]) -> AnsweredRun:
    trials = tuple(_answered(list(of_trial)) for _, of_trial in groupby(rows, key=attrgetter("trial")))
    first = rows[0]
    name = names[first.study_id, first.subject]
    return AnsweredRun(name, first.finger, first.run_hz, trials, bool(first.simulated))


def _answered(intervals: Sequence[Found]) -> Answered:
    tones = tuple(_tone(row.stimulus, row.commanded_db_sl, row.measured_db_sl) for row in intervals)
    trial = intervals[0]
    point = trial.frequency_hz, trial.curve_level_db_re_1um
    return Answered(tones, trial.level_db_sl, trial.response, bool(trial.correct), None if None in point else point)


def stored_tasks(store: Store, form: type[_Task]) -> tuple[_Task, ...]:
    """Return the tables [task] of that form that the store's protocols have, the newest last; form: Task for all."""
    with store.read() as connection:
        tasks = [protocol.task for protocol in stored_protocols(connection, JudgingProtocol).values()]
    return tuple(task for task in tasks if isinstance(task, form))


def _tone(label: str, level_db_sl: float | None, measured_db_sl: float | None) -> Tone | None:
    if level_db_sl is None:
        return None
    role, _, rest = label.partition(":")
    finger, _, hertz = rest.rpartition(":")
    return Tone(role, finger, float(hertz), level_db_sl, measured_db_sl=measured_db_sl)
