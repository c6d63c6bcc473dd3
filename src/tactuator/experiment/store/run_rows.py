"""Trials and intervals of a store as rows of the exports, one run after the other: a store of any size is read in the
memory of its longest run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, FromClause, Select, func, select

from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Found
from tactuator.experiment.store.stored_runs import COLUMNS, INTERVALS, TRIALS, plain_rows, selected
from tactuator.experiment.store.voids import void_reasons

Cells = Sequence[Any]

AT_ONCE = 2000
"""Trials that are held at a time; a run with more is held whole."""
_ABOUT = ("study", "subject", "visit", "run", "paradigm", "respondent", "rig_simulated")
_PLAYED = ("stimulus", "commanded_db_sl", "measured_db_sl")


@dataclass(frozen=True, eq=False)
class RunRows:
    """Answered trials of a run and their intervals.

    about: its study, subject, visit, run, paradigm, respondent and rig_simulated, as the columns of trials are named.
    trials, intervals: cells in the order of COLUMNS.
    """

    about: Found
    trials: list[Cells]
    intervals: list[Cells]

    def table(self, name: Literal["trials", "intervals"]) -> list[dict[str, Any]]:
        """Return the rows of one of the two tables by the names of their columns."""
        names = [column.name for column in COLUMNS[name]]
        return [dict(zip(names, row, strict=True)) for row in getattr(self, name)]


def runs_in_order(connection: Connection, usable: schema.Usable) -> list[Found]:
    """Return every run with answered trials, by study, subject and visit: as `RunRows.about`, and how many trials."""
    run = schema.run.c.id
    count = select(func.count()).select_from(schema.trial.join(schema.response)).where(schema.trial.c.run_id == run)
    answered = count.where(usable.trials).scalar_subquery().label("trials")
    query: Select[Any] = select(*selected("trials", *_ABOUT), answered).select_from(schema.RUNS).where(usable.runs)
    order = (schema.study.c.id, schema.subject.c.number, schema.session.c.visit, run)
    return [row for row in connection.execute(query.order_by(*order)) if row.trials]


def rows_of_runs(connection: Connection, runs: Sequence[Found], usable: schema.Usable) -> Iterator[RunRows]:
    """Yield the rows of runs of `runs_in_order`, reading some of them at a time."""
    reasons = void_reasons(connection)
    for part in _parts(runs):
        trials = _read(connection, "trials", TRIALS, part, usable.trials)
        intervals = _read(connection, "intervals", INTERVALS, part, usable.trials)
        for about in part:
            played = intervals.pop(about.run, [])
            rows = _with_played(trials.pop(about.run, []), played)
            yield RunRows(about, _with_reasons(rows, about.run, reasons) if reasons else rows, played)


def _parts(runs: Sequence[Found]) -> Iterator[list[Found]]:
    part, trials = list[Found](), 0
    for run in runs:
        if part and trials + run.trials > AT_ONCE:
            yield part
            part, trials = [], 0
        part.append(run)
        trials += run.trials
    if part:
        yield part


def _read(
    connection: Connection, table: str, source: FromClause, runs: Sequence[Found], where: ColumnElement[bool]
) -> dict[int, list[Cells]]:
    """Return the rows of some runs by run, in order of trials and intervals."""
    run, order = schema.run.c.id, [schema.trial.c.number]
    if table == "intervals":
        order.append(schema.interval.c.position)
    wanted = run.in_([each.run for each in runs])
    query = select(*selected(table)).select_from(source).where(where, wanted).order_by(run, *order)
    return {each: [*rows] for each, rows in groupby(plain_rows(connection, query), itemgetter(_place(table, "run")))}


def _place(table: str, name: str) -> int:
    return next(index for index, column in enumerate(COLUMNS[table]) if column.name == name)


def _with_played(trials: list[Cells], intervals: list[Cells]) -> list[Cells]:
    """Return the trials with what their intervals played, and the level at the sensor where something was commanded."""
    stimuli, measured = _place("trials", "stimuli"), _place("trials", "measured_db_sl")
    number, of = _place("trials", "trial"), _place("intervals", "trial")
    label, commanded, sensed = (_place("intervals", name) for name in _PLAYED)
    by_number = {trial[number]: [*trial] for trial in trials}
    for interval in intervals:
        trial = by_number[interval[of]]
        before = trial[stimuli]
        trial[stimuli] = f"{before}|{interval[label]}" if before else interval[label]
        if interval[commanded] is not None:
            trial[measured] = interval[sensed]
    return [*by_number.values()]


def _with_reasons(trials: list[Cells], run: int, reasons: Mapping[tuple[int, int | None], str]) -> list[Cells]:
    """Return the trials with why they are void, if they are, in the last column."""
    number, whole = _place("trials", "trial"), reasons.get((run, None))
    return [[*row[:-1], whole or reasons.get((run, row[number]))] for row in trials]
