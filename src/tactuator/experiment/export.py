"""Exports of a store: tidy CSV, Psych-DS and BIDS behaviour; each a folder with its dictionary, whole or not at all.

Answers that a subject took back are left out.
"""

from __future__ import annotations

import csv
import json
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from itertools import count, groupby
from math import isfinite
from operator import itemgetter
from pathlib import Path
from types import NoneType
from typing import Any, get_args

from sqlalchemy import ColumnElement, Connection, FromClause, Select, func, select

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.recognition import Paradigm
from tactuator.experiment.protocol.study import FORCED_CHOICE, StudyProtocol
from tactuator.experiment.result.thresholds import fitted, refit_prior
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import CONSENT_NAME, Found
from tactuator.experiment.store.run_rows import RunRows, rows_of_runs, runs_in_order
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import (
    PROGRAMS,
    StoredRun,
    detection_parts,
    in_order,
    selected,
    stored_protocols,
)
from tactuator.experiment.trial import typed_number
from tactuator.experiment.words import COLUMNS, Column
from tactuator.io.atomic import atomic_folder
from tactuator.io.csv_text import cell

TableRow = dict[str, Any]
_MISSING = "n/a"
_EXACT = 2**53


@dataclass(frozen=True)
class Exported:
    """A store to be exported, while its transaction is open.

    runs: every run with answered trials. connection: reads their rows as they are written. usable: what holds of them.
    tables: events, subjects and thresholds. columns: of each table, those of the trials and intervals too. settings:
    each version of each study's protocol, by file name.
    """

    connection: Connection
    usable: schema.Usable
    runs: list[Found]
    tables: Mapping[str, list[TableRow]]
    columns: Mapping[str, tuple[Column, ...]]
    settings: Mapping[str, Mapping[str, object]]

    def rows(self) -> Iterator[RunRows]:
        """Yield trials and intervals, a run at a time."""
        return rows_of_runs(self.connection, self.runs, self.usable)

    def write(self, table: str, path: Path, separator: str = ",", missing: str = "") -> None:
        """Write one of the tables as separated values with a header."""
        names = [column.name for column in self.columns[table]]
        _write_rows(path, names, self.tables[table], separator, missing)

    def write_runs(self, places: Callable[[Found], tuple[Path, Path]]) -> None:
        """Write trials and intervals of every run to the two files that `places` has for it."""
        for (trials, intervals), runs in groupby(self.rows(), key=lambda run: places(run.about)):
            with self._appended("trials", trials) as of_trials, self._appended("intervals", intervals) as of_intervals:
                for run in runs:
                    of_trials.writerows(_cells(run.trials))
                    of_intervals.writerows(_cells(run.intervals))

    @contextmanager
    def _appended(self, table: str, path: Path) -> Iterator[Any]:
        """Open a file to append rows of a table to; a new one has a header."""
        is_new = not path.exists()
        with path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            if is_new:
                writer.writerow([column.name for column in self.columns[table]])
            yield writer


def _cells(rows: Iterable[Sequence[Any]], missing: str = "") -> Iterator[tuple[Any, ...]]:
    """Yield rows as cells. They are made by column, each distinct text once: most of a run's cells are alike."""
    return zip(*(_column(values, missing) for values in zip(*rows, strict=True)), strict=True)


def _column(values: Sequence[Any], missing: str) -> Sequence[Any]:
    kinds = set(map(type, values))
    if kinds <= {str, NoneType}:
        cells = {value: cell(value, missing) for value in set(values)}
        return [cells[value] for value in values]
    if not missing and kinds <= {int, float, NoneType} and isfinite(sum(filter(None, values))):
        return values  # all are finite; None is an empty cell
    return [cell(_plain(value), missing) for value in values]


def _write_rows(path: Path, names: Sequence[str], rows: Iterable[TableRow], separator: str, missing: str = "") -> None:
    _write_cells(path, names, ([row[name] for name in names] for row in rows), separator, missing)


def _write_cells(
    path: Path, names: Sequence[str], rows: Iterable[Sequence[Any]], separator: str, missing: str = ""
) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, delimiter=separator, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(_cells(rows, missing))


@contextmanager
def exported(store: Store) -> Iterator[Exported]:
    """Open the whole store for an export. Raises BadInput where it has no response that may be used."""
    study, subject, session, event = schema.study, schema.subject, schema.session, schema.event
    with store.read() as connection:

        def read(table: str, key: Any, source: FromClause, where: ColumnElement[bool], *by: Any) -> list[TableRow]:
            query = select(*selected(table), key.label("key")).select_from(source).where(where).order_by(*by)
            return [dict(row._mapping) for row in connection.execute(query)]

        runs = runs_in_order(connection, store.usable)
        if not runs:
            raise BadInput(f"store {store.name} has no response", "one with at least one")
        happened = (
            event.outerjoin(session, session.c.id == event.c.session_id)
            .outerjoin(subject, subject.c.id == func.coalesce(session.c.subject_id, event.c.subject_id))
            .outerjoin(study, study.c.id == subject.c.study_id)
        )
        correction = event.c.item.is_(None) | event.c.subject_id.not_in(_discarded())  # a change is data of the subject
        events = read("events", event.c.id, happened, (event.c.kind != CONSENT_NAME) & correction, event.c.id)
        kept = subject.c.id.not_in(_discarded())
        subjects = read("subjects", subject.c.id, subject.join(study), kept, study.c.id, subject.c.number)
        items = _add_facts(connection, subjects)
        settings = _settings(connection)
        tables = {"events": events, "subjects": subjects, "thresholds": _thresholds(store)}
        described = {**COLUMNS, "subjects": (*COLUMNS["subjects"], *items)}
        yield Exported(connection, store.usable, runs, tables, described, settings)


def _plain(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return None if isinstance(value, float) and not isfinite(value) else value


def _add_facts(connection: Connection, subjects: list[TableRow]) -> list[Column]:
    """Add the demographic items to the subjects and return their columns."""
    items: dict[str, Column] = {}
    fact, facts = schema.demographic, dict[int, TableRow]()
    for row in connection.execute(select(fact).where(fact.c.value.is_not(None)).order_by(fact.c.id)):
        facts.setdefault(row.subject_id, {})[row.name] = row.value
        items.setdefault(row.name, Column("subjects", row.name, "", row.unit, "As the laboratory defines it"))
    numbers: set[tuple[object, str]] = set()
    for protocol in stored_protocols(connection, StudyProtocol).values():
        for item in protocol.demographic:
            items[item.name] = Column("subjects", item.name, "", item.unit, item.label)
            if item.kind == "number":
                numbers.add((protocol.study.name, item.name))
    for subject in subjects:
        mine = facts.get(subject["key"], {})
        read = {name: _number(text) if (subject["study"], name) in numbers else text for name, text in mine.items()}
        subject.update(dict.fromkeys(items) | read)
    return list(items.values())


def _number(text: str) -> float | int | str:
    """Return the number of a fact, which earlier releases stored as it was typed; the text where it is none."""
    try:
        number = typed_number(text)
    except BadInput:
        return text
    return int(number) if number.is_integer() and abs(number) < _EXACT else number


def _discarded() -> Select[Any]:
    """Select the subjects who left with all of their answers, so that nothing of theirs may be used."""
    session = schema.session
    kept = select(session.c.subject_id).where(schema.KEPT, session.c.consented_utc.is_not(None))
    return select(session.c.subject_id).where(session.c.ended == "withdrawn-discard", session.c.subject_id.not_in(kept))


def _thresholds(store: Store) -> list[TableRow]:
    """Return every threshold, a part of the runs after the other: the trials of all of them would fill the memory."""
    with store.read() as connection:
        studies = {row.id: row.name for row in connection.execute(select(schema.study))}
        versions = {row.id: row.number for row in connection.execute(select(schema.protocol_version))}
    names, rows = [column.name for column in COLUMNS["thresholds"]], []
    for part in detection_parts(store):
        of_runs, by_run = fitted(part), {run.run.id: run for run in part}
        found = [(by_run[threshold.run], vars(threshold)) for threshold in of_runs.thresholds]
        for of_run, threshold in [*found, *((run, _without_refit(run)) for run, _ in of_runs.refused)]:
            session, run = of_run.session, of_run.run
            row = threshold | {name: getattr(run, name) for name in ("respondent", "rig_simulated", "shown")}
            row |= {"study": studies[session.study_id], "visit": session.visit, "flags": "|".join(threshold["flags"])}
            row["protocol_version"] = versions[run.protocol_version_id]
            row["group"] = "simulated" if run.respondent in PROGRAMS else session.subject_group
            rows.append((in_order(of_run), {name: _plain(row.get(name)) for name in names}))
    return [row for _, row in sorted(rows, key=itemgetter(0))]


def _without_refit(run: StoredRun) -> TableRow:
    """Return what is known of the threshold of a run that cannot be refitted: that it is not known."""
    about = {"subject": run.session.subject_code, "trials": run.correct.size, "flags": ("no-refit",)}
    names = ("finger", "frequency_hz", "procedure", "curve")
    return about | {"run": run.run.id} | {name: getattr(run.run, name) for name in names}


def _settings(connection: Connection) -> dict[str, dict[str, object]]:
    version, study = schema.protocol_version, schema.study
    detection = stored_protocols(connection, Protocol)
    query = select(version, study.c.name.label("study")).join(study).order_by(version.c.study_id, version.c.number)
    return {
        f"protocol-{row.study_id}-{row.number}": {
            "study": row.study,
            "version": row.number,
            **{name: row._mapping[name] for name in ("reason", "sha256", "tool_version", "created_utc")},
            "protocol": _document(row.toml),
            **_refit_settings(detection.get(row.id)),
        }
        for row in connection.execute(query)
    }


def _document(toml: str) -> object:
    """Return a protocol as JSON has it; its text, where that is not TOML."""
    try:
        return json.loads(json.dumps(tomllib.loads(toml), default=str))
    except tomllib.TOMLDecodeError:
        return toml


def _refit_settings(protocol: Protocol | None) -> dict[str, object]:
    """Return what another program needs to refit the protocol's runs, or why they cannot be refitted."""
    if protocol is None or protocol.procedure.chooses_frequency:
        return {}
    try:
        return {"refit": refit_prior(protocol).settings()}
    except BadInput as error:
        return {"no_refit": str(error)}


def label(text: str) -> str:
    """Return the text as a file name may have it: letters and digits."""
    return re.sub(r"[^A-Za-z0-9]", "", text)


def _task(run: Found) -> str:
    paradigm = str(run.paradigm)
    if paradigm in get_args(Paradigm):
        return "recognition"
    return "detection" if paradigm == FORCED_CHOICE else label(paradigm)


def participants(data: Exported) -> dict[tuple[str, str], str]:
    """Return a label of letters and digits that nobody else has for everybody with trials, by study and subject.

    Codes that two studies share, or that a file system takes for one, get the study's name and, if need be, a number.
    """
    each = sorted({(str(run.study), str(run.subject)) for run in data.runs})
    codes = Counter(label(subject).casefold() for _, subject in each)
    people: dict[tuple[str, str], str] = {}
    for study, subject in each:
        name = label(subject) if codes[label(subject).casefold()] == 1 else label(study) + label(subject)
        taken = {known.casefold() for known in people.values()}
        tried = (name if number == 1 else f"{name}n{number}" for number in count(1))
        people[study, subject] = next(each for each in tried if each.casefold() not in taken)
    return people


def _description(data: Exported) -> tuple[str, str]:
    """Return the studies' names, and a sentence on the data that calls simulated data simulated."""
    tasks = sorted({_task(run) for run in data.runs})
    text = f"Vibrotactile {' and '.join(tasks)}, one row for each answered trial."
    if any(run.respondent in PROGRAMS for run in data.runs):
        text += " Simulated subjects answered; see the column respondent."
    elif any(run.rig_simulated for run in data.runs):
        text += " The display was simulated: nothing could be felt; see the columns rig_simulated and shown."
    return "; ".join(sorted({str(run.study) for run in data.runs})), text


_OWN_NAMES = frozenset(
    [
        "trials.csv", "intervals.csv", "events.csv", "subjects.csv", "thresholds.csv", "dictionary.csv", "settings",
        "trials_dictionary.csv", "dataset_description.json", "data", "README", "README.md", "participants.tsv",
        "participants.json", "derivatives", "analysis",
    ]
)  # fmt: skip


def export(store: Store, folder: Path, form: str) -> int:
    """Write every answered trial and what belongs to it, and return the number of trials.

    Raises BadInput for another form or a store without a response.
    """
    if form not in FORMS:
        raise BadInput(f"format {form!r}", ", ".join(FORMS))
    with exported(store) as data:
        names = {label(str(row["subject"])) for row in data.tables["subjects"]} | {*participants(data).values()}
        with atomic_folder(folder, _OWN_NAMES | {f"sub-{name}" for name in names}) as beside:
            FORMS[form](data, beside)
        return sum(run.trials for run in data.runs)


def _write_json(path: Path, document: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _write_settings(data: Exported, folder: Path) -> None:
    for name, settings in data.settings.items():
        _write_json(folder / f"{name}.json", settings)


def _write_tidy(data: Exported, folder: Path) -> None:
    data.write_runs(lambda run: (folder / "trials.csv", folder / "intervals.csv"))
    for name in data.tables:
        data.write(name, folder / f"{name}.csv")
    tables = ("trials", "intervals", *data.tables)
    rows = [column._asdict() | {"column": column.name} for name in tables for column in data.columns[name]]
    _write_rows(folder / "dictionary.csv", ("table", "column", "description", "unit"), rows, ",")
    _write_settings(data, folder / "settings")


def _write_psych_ds(data: Exported, folder: Path) -> None:
    name, text = _description(data)
    variables: dict[str, Column] = {}
    filled = ("trials", "intervals", *(table for table, rows in data.tables.items() if rows))
    for column in (column for table in filled for column in data.columns[table]):
        variables.setdefault(column.name, column)
    about = {"@context": "https://schema.org/", "@type": "Dataset", "name": name, "description": text}
    about |= {"schemaVersion": "Psych-DS 1.0.0"}
    measured = [
        {"@type": "PropertyValue", "name": column.name, "description": column.description}
        | ({"unitText": column.unit} if column.unit else {})
        for column in variables.values()
    ]
    _write_json(folder / "dataset_description.json", about | {"variableMeasured": measured})
    _write_read_me(data, folder)
    within = folder / "data"
    within.mkdir()
    for table in ("events", "subjects", "thresholds"):
        if data.tables[table]:
            data.write(table, within / f"description-{table}_data.csv")
    people = participants(data)

    def places(run: Found) -> tuple[Path, Path]:
        of_person = f"subject-{people[run.study, run.subject]}_task-{_task(run)}"
        trials, intervals = (f"{of_person}_description-{table}_data.csv" for table in ("trials", "intervals"))
        return within / trials, within / intervals

    data.write_runs(places)
    _write_settings(data, folder / "analysis")


def _write_read_me(data: Exported, folder: Path) -> None:
    (folder / "README.md").write_text("# {}\n\n{}\n".format(*_description(data)), encoding="utf-8")


def _write_bids(data: Exported, folder: Path) -> None:
    about = {"Name": _description(data)[0], "BIDSVersion": "1.10.0"}
    by = {"GeneratedBy": [{"Name": "tactuator", "Version": __version__}]}
    _write_json(folder / "dataset_description.json", {**about, "DatasetType": "raw", **by})
    _write_read_me(data, folder)
    # the ids that others know the subjects by stay in the laboratory
    private = ("study", "subject", "outside_id")
    kept = [column for column in data.columns["subjects"] if column.name not in private]
    columns = [*COLUMNS["bids-participants"], *kept]
    labels = participants(data)
    people = [
        row | {"participant_id": f"sub-{labels[row['study'], row['subject']]}"}
        for row in sorted(data.tables["subjects"], key=lambda row: (row["study"], row["subject"]))
        if (row["study"], row["subject"]) in labels
    ]
    _write_rows(folder / "participants.tsv", [column.name for column in columns], people, "\t", _MISSING)
    _write_json(folder / "participants.json", _described(columns))
    visits, numbers = any(run.visit > 1 for run in data.runs), Counter[tuple[object, ...]]()
    for run in data.rows():
        person, task = labels[run.about.study, run.about.subject], _task(run.about)
        numbers[person, run.about.visit, task] += 1
        entities = [f"sub-{person}", *([f"ses-{run.about.visit:02d}"] if visits else [])]
        named = f"{'_'.join(entities)}_task-{task}_run-{numbers[person, run.about.visit, task]:02d}"
        _write_run(data, run, folder.joinpath(*entities, "beh", named))
    derived = folder / "derivatives" / "tactuator"
    _write_json(derived / "dataset_description.json", {**about, **by, "DatasetType": "derivative"})
    for table in ("thresholds", "events"):
        data.write(table, derived / f"{table}.tsv", "\t", _MISSING)
        _write_json(derived / f"{table}.json", _described(data.columns[table]))
    _write_settings(data, derived)


def _described(columns: Iterable[Column]) -> dict[str, dict[str, str]]:
    return {
        column.name: {"Description": column.description} | ({"Units": column.unit} if column.unit else {})
        for column in columns
    }


_QUESTIONS = {"detection": "Which interval carries the vibration?", "recognition": "Which item was it? (ABX: A or B?)"}


def _write_run(data: Exported, run: RunRows, stem: Path) -> None:
    asks, task = "Judgement of tones; as in the protocol's table [task]", _task(run.about)
    about = {"TaskName": task, "TaskDescription": _QUESTIONS.get(task, asks)}
    _write_json(Path(f"{stem}_beh.json"), about | _described(data.columns["trials"]))
    names = [column.name for column in data.columns["trials"]]
    _write_cells(Path(f"{stem}_beh.tsv"), names, run.trials, "\t", _MISSING)
    began, played = {row["trial"]: row["presented_utc"] for row in run.table("trials")}, run.table("intervals")
    if all(row["onset_s"] is not None for row in played):
        columns = COLUMNS["bids-events"]
        rows = _bids_events(began, played)
        _write_rows(Path(f"{stem}_events.tsv"), [column.name for column in columns], rows, "\t", _MISSING)
        _write_json(Path(f"{stem}_events.json"), _described(columns[2:]))


def _bids_events(presented_utc: Mapping[int, str], played: list[TableRow]) -> list[TableRow]:
    began = {trial: datetime.fromisoformat(at) for trial, at in presented_utc.items()}
    first = min(began.values())
    for row in played:
        since_s = (began[row["trial"]] - first).total_seconds()
        row |= {"onset": round(since_s + row["onset_s"], 6), "duration": row["duration_s"]}
    return sorted(played, key=lambda row: float(row["onset"]))


FORMS: dict[str, Callable[[Exported, Path], None]] = {
    "tidy": _write_tidy, "psych-ds": _write_psych_ds, "bids": _write_bids,
}  # fmt: skip
"""Names of the formats, and the functions that write them."""
