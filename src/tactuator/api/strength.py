"""Subcommands of `experiment` on judging tasks: contours of a store's matches, and the results of any task."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tactuator import report
from tactuator.api.experiment import Voided
from tactuator.api.option import Argument, Option
from tactuator.api.parameters import Figures, Place
from tactuator.api.progress import working
from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.result.strength_results import ContourResults, contour_results, person_document
from tactuator.experiment.store.records import study_names
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import answered_runs, stored_tasks
from tactuator.experiment.task.matching import evidence_table, pairs_table
from tactuator.experiment.task.task import Task
from tactuator.experiment.words import shipped_words
from tactuator.io.csv_tables import resolve_curve, write_contours
from tactuator.perception.contours import Contours
from tactuator.result import NOBODY_FELT_IT, Chart, ChartLine, Column, Fact, Result, ResultTable, columns_of, found


@dataclass(frozen=True, eq=False, repr=False)
class StoreContours(Result):
    """Equal-strength contours of a store's people and of their group, and the balance between fingers."""

    results: ContourResults

    def facts(self) -> Sequence[Fact]:
        results, names = self.results, ("level_db_sl", "frequency_hz", "db_sl", "low_db_sl", "high_db_sl")
        balance = {
            f"balance_db of {each.finger}": f"{each.offset_db.value:+.1f} dB "
            f"({each.offset_db.low:+.1f} to {each.offset_db.high:+.1f}), {each.people} people"
            for each in results.balance
        }
        pairs = [
            {"subject": run.subject, "finger": run.finger, "frequency_hz": run.frequency_hz, **vars(equal)}
            for run, equal in results.pairs
        ]
        return [
            Fact("people", [person_document(person) for person in results.people]),
            Fact(
                "contours",
                [] if results.group is None else [dict(zip(names, row, strict=True)) for row in self._rows()],
            ),
            Fact("pairs", pairs),
            Fact("balance", list(results.balance)),
            found("people", len(results.people)),
            found("pairs", len(pairs)),
            *(found(person.subject, person.estimate.intensity_function) for person in results.people),
            *(found(name, words) for name, words in balance.items()),
            Fact("simulated", results.simulated),
            *([found("simulated", "nobody felt this")] if results.simulated else []),
        ]

    def _rows(self) -> list[tuple[float, ...]]:
        group, low, high = self._contours()
        return [
            (level, hertz, float(group.db_sl[row, column]), float(low[row, column]), float(high[row, column]))
            for row, level in enumerate(group.level_db_sl.tolist())
            for column, hertz in enumerate(group.frequency_hz.tolist())
        ]

    def _contours(self) -> tuple[Contours, FloatArray, FloatArray]:
        """Return the group's contours, and the ends of their bands."""
        group = self.results.group
        if group is None or group.low_db_sl is None or group.high_db_sl is None:
            raise BadInput("no matches on the standard's own finger", "contours of some")
        return group, group.low_db_sl, group.high_db_sl

    def table(self) -> Sequence[Column]:
        names = ("level_db_sl", "frequency_hz", "db_sl", "low_db_sl", "high_db_sl", "simulated")
        last = "simulated" if self.results.simulated else ""
        return columns_of(names, [(*row, last) for row in self._rows()])

    def chart(self) -> Chart:
        group, low, high = self._contours()
        curves = [
            ChartLine(
                f"{level:g} dB SL", group.frequency_hz, group.db_sl[row], half=0.5 * (high[row] - low[row]), colour=row
            )
            for row, level in enumerate(group.level_db_sl.tolist())
        ]
        axes = ("frequency (Hz)", f"as strong as {group.reference_hz:g} Hz (dB SL)")
        return Chart(*axes, curves, log_x=True, simulated=self.results.simulated)

    def tables(self) -> Sequence[ResultTable | str]:
        words, lines = shipped_words("en"), list[ResultTable | str]()
        for person in self.results.people:
            lines += [f"{person.subject}: {person.contours.source}", evidence_table(person.estimate, words)]
        if self.results.pairs:
            lines.append(pairs_table(self.results.pairs, words))
        notes = (NOBODY_FELT_IT,) if self.results.simulated else ()
        noted = [
            replace(line, notes=(*notes, *line.notes)) if isinstance(line, ResultTable) else line for line in lines
        ]
        return [*noted, *notes]


def contours(
    store: Annotated[Place, Argument("Database of the experiment (SQLite).", metavar="STORE", file=True)],
    group: Annotated[str | None, Option("Only subjects of this group.")] = None,
    subject: Annotated[str | None, Option("Write the contours of this subject, not the group's.")] = None,
    curve: Annotated[
        str | None, Option("Curve (name or CSV) to which the contours' dB SL refer; default: the display's.")
    ] = None,
    out: Annotated[Place | None, Option("Write the contours (CSV) for a display file.", writes="contours")] = None,
    figures: Figures = None,
    voided: Voided = False,
) -> StoreContours:
    """Estimate equal-strength contours from matches. Gives the intensity function, biases and JND, too.

    With the threshold curve of the person who matched, they go with a display that is designed for that curve. Raises
    BadInput where there are no finished matching runs, or no such subject.
    """
    basis = None if curve is None else resolve_curve(curve)
    with working("fitting the matches"):
        results = contour_results(Path(store), group, basis, voided)
    result = StoreContours(results)
    if out is not None:
        people = {person.subject: person.contours for person in results.people}
        if subject is not None and subject not in people:
            raise BadInput(f"subject {subject!r} has no matches", ", ".join(people) or "one who has")
        write_contours(Path(out), result._contours()[0] if subject is None else people[subject])
    if figures is not None and results.group is not None:
        drawn = report.chart.chart_figure(result.chart(), "contours", results.group.source)
        report.figure.save_figures([drawn], Path(figures))
    return result


@dataclass(frozen=True, eq=False, repr=False)
class StoreJudged(Result):
    """What the answers to a task come to.

    runs: their number. results: the task's own tables. simulated: nobody felt anything.
    """

    task: str
    runs: int
    results: Sequence[ResultTable]
    drawn: Chart | None
    simulated: bool

    def facts(self) -> Sequence[Fact]:
        tables = [{"caption": each.caption, "columns": each.columns, "rows": each.rows} for each in self.results]
        return [
            Fact("task", self.task, "task", summary=True),
            Fact("runs", self.runs, "runs", summary=True),
            Fact("tables", tables),
            Fact("simulated", self.simulated),
            *([found("simulated", "nobody felt this")] if self.simulated else []),
        ]

    def chart(self) -> Chart:
        return super().chart() if self.drawn is None else replace(self.drawn, simulated=self.simulated)

    def tables(self) -> Sequence[ResultTable | str]:
        notes = (NOBODY_FELT_IT,) if self.simulated else ()
        return [*(replace(table, notes=(*notes, *table.notes)) for table in self.results), *notes]


def judged(
    store: Annotated[Place, Argument("Database of the experiment (SQLite).", metavar="STORE", file=True)],
    task: Annotated[str | None, Option("Kind of the task; default: the store's only one.")] = None,
    group: Annotated[str | None, Option("Only subjects of this group.")] = None,
    figures: Figures = None,
    voided: Voided = False,
) -> StoreJudged:
    """Summarise the results of a judging task. Magnitudes with their exponents, just-noticeable differences, matches.

    Raises BadInput where the store has no finished run of such a task, or several tasks and none is named.
    """
    words = shipped_words("en")
    with closing(Store(Path(store), must_exist=True, voided=voided)) as opened:
        kinds = {keys.kind: keys for keys in stored_tasks(opened, Task)}
        if not kinds:
            with opened.read() as connection:
                got = f"the store holds {', '.join(study_names(connection)) or 'no study'}"
            raise BadInput(got, "a study in which tones are judged (others: `experiment thresholds`)")
        if task is None and len(kinds) != 1:
            raise BadInput(f"the store has {len(kinds)} tasks", f"`task` with one of: {', '.join(kinds)}")
        kind = next(iter(kinds)) if task is None else task
        runs = answered_runs(opened, kind, group=group)
    keys, simulated = kinds[kind], any(run.simulated for run in runs)
    result = StoreJudged(kind, len(runs), keys.results(runs, words), keys.chart(runs, words), simulated)
    if figures is not None:
        drawn = report.chart.chart_figure(result.chart(), kind, f"{len(runs)} runs")
        report.figure.save_figures([drawn], Path(figures))
    return result
