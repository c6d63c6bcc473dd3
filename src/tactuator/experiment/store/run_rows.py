"""Trials and intervals of a store as rows of the exports, one run after the other: a store of any size is read in the
memory of its longest run.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, FromClause, Select, func, select

from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Found
from tactuator.experiment.store.stored_runs import plain_rows, selected
from tactuator.experiment.store.voids import void_reasons
from tactuator.experiment.words import COLUMNS

Cells = Sequence[Any]

AT_ONCE = 2000
"""Trials that are held at a time; a run with more is held whole."""
_ABOUT = ("study", "subject", "visit", "run", "paradigm", "respondent", "rig_simulated")
_PLAYED = ("stimulus", "commanded_db_sl", "measured_db_sl")
_OF_TRIALS = re.compile(r"\b(trial|response|interval)\b|NULL")
"""What the SQL of a column has that is not the same for all trials of a run."""
_RUNS = schema.RUNS.outerjoin(schema.protocol_version, schema.run.c.protocol_version_id == schema.protocol_version.c.id)
_ANSWERED = schema.trial.join(schema.response)


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
        trials = _read(connection, "trials", _ANSWERED, part, usable.trials)
        intervals = _read(connection, "intervals", _ANSWERED.join(schema.interval), part, usable.trials)
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
    """Return the rows of some runs by run, in order of trials and intervals.

    What holds of a whole run is read once for each: looked up for every row, it took longer than the rows.
    """
    names = [column.name for column in COLUMNS[table]]
    of_run = [column.name for column in COLUMNS[table] if not _OF_TRIALS.search(column.source)]
    of_row = [name for name in names if name not in of_run]
    run, order = schema.trial.c.run_id, [schema.trial.c.number]
    if table == "intervals":
        order.append(schema.interval.c.position)
    wanted = [each.run for each in runs]
    about = plain_rows(
        connection, select(*selected(table, *of_run)).select_from(_RUNS).where(schema.run.c.id.in_(wanted))
    )
    shared = {row[of_run.index("run")]: row for row in about}
    query = select(run, *selected(table, *of_row)).select_from(source).where(where, run.in_(wanted))
    in_order = itemgetter(*(([*of_run, "", *of_row]).index(name) for name in names))
    rows = groupby(plain_rows(connection, query.order_by(run, *order)), itemgetter(0))
    return {each: [in_order((*shared[each], *row)) for row in of_each] for each, of_each in rows}


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
