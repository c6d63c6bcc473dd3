"""Exports of a store: tidy CSV, Psych-DS and BIDS behaviour; each a folder with its dictionary, whole or not at all.

Withdrawn data are left out.
"""

from __future__ import annotations

import csv
import json
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from itertools import count
from math import isfinite
from pathlib import Path
from typing import Any, get_args

from sqlalchemy import ColumnElement, Connection, FromClause, Select, func, select

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.recognition import Paradigm
from tactuator.experiment.protocol.study import FORCED_CHOICE, StudyProtocol
from tactuator.experiment.result.thresholds import fitted, refit_prior
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import CONSENT_NAME
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import (
    COLUMNS,
    INTERVALS,
    PROGRAMS,
    TRIALS,
    Column,
    StoredRun,
    detection_runs,
    selected,
    stored_protocols,
)
from tactuator.experiment.trial import typed_number
from tactuator.io.atomic import atomic_folder

TableRow = dict[str, Any]
_MISSING = "n/a"
_PLAIN_NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_EXECUTED, _UNSEEN_FIRST = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20"), " \u00a0\ufeff\u200b"
"""Signs that begin a formula, also of full width, and what programs pass over before them."""
_EXACT = 2**53


@dataclass(frozen=True)
class Exported:
    """The tables of a store by name, with their columns, and each version of each study's protocol by file name."""

    tables: Mapping[str, list[TableRow]]
    columns: Mapping[str, tuple[Column, ...]]
    settings: Mapping[str, Mapping[str, object]]

    def write(
        self, table: str, path: Path, separator: str = ",", missing: str = "", rows: Iterable[TableRow] | None = None
    ) -> None:
        """Write a table, or those of its rows, as separated values with a header."""
        names = [column.name for column in self.columns[table]]
        _write_rows(path, names, self.tables[table] if rows is None else rows, separator, missing)


def _write_rows(path: Path, names: Sequence[str], rows: Iterable[TableRow], separator: str, missing: str = "") -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, delimiter=separator, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([cell(row[name], missing) for name in names] for row in rows)


def cell(value: Any, missing: str = "") -> Any:
    """Return the value as a cell: text that a spreadsheet would execute begins with an apostrophe. A number is none."""
    if value is None or value == "":
        return missing
    if not isinstance(value, str) or _PLAIN_NUMBER.fullmatch(value):
        return value
    return f"'{value}" if value.lstrip(_UNSEEN_FIRST).startswith(_EXECUTED) or value[0] in "\t\r\n" else value


def exported(store: Store) -> Exported:
    """Read the whole store. Raises BadInput where it has no response that may be used."""
    study, subject, session, run, trial = schema.study, schema.subject, schema.session, schema.run, schema.trial
    event = schema.event
    order = (study.c.id, subject.c.number, session.c.visit, run.c.id, trial.c.number)
    with store.read() as connection:

        def read(table: str, key: Any, source: FromClause, where: ColumnElement[bool], *by: Any) -> list[TableRow]:
            query = select(*selected(table), key.label("key")).select_from(source).where(where).order_by(*by)
            return [{name: _plain(value) for name, value in row._mapping.items()} for row in connection.execute(query)]

        trials = read("trials", trial.c.id, TRIALS, schema.KEPT, *order)
        if not trials:
            raise BadInput(f"store {store.name} has no response", "one with at least one")
        intervals = read("intervals", trial.c.id, INTERVALS, schema.KEPT, *order, schema.interval.c.position)
        _add_played(trials, intervals)
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
    tables = {"trials": trials, "intervals": intervals, "events": events, "subjects": subjects}
    described = {**COLUMNS, "subjects": (*COLUMNS["subjects"], *items)}
    return Exported(tables | {"thresholds": _thresholds(store)}, described, settings)


def _plain(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return None if isinstance(value, float) and not isfinite(value) else value


def _add_played(trials: list[TableRow], intervals: list[TableRow]) -> None:
    """Add to every trial what its intervals played, and the level at the sensor where something was commanded."""
    by_key = {trial["key"]: trial for trial in trials}
    for interval in intervals:
        trial = by_key[interval["key"]]
        trial["stimuli"] = f"{trial['stimuli']}|{interval['stimulus']}" if trial["stimuli"] else interval["stimulus"]
        if interval["commanded_db_sl"] is not None:
            trial["measured_db_sl"] = interval["measured_db_sl"]


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
    try:
        runs = detection_runs(store)
    except BadInput:
        return []
    with store.read() as connection:
        studies = {row.id: row.name for row in connection.execute(select(schema.study))}
        versions = {row.id: row.number for row in connection.execute(select(schema.protocol_version))}
    by_run, names = {run.run.id: run for run in runs}, [column.name for column in COLUMNS["thresholds"]]
    of_runs, order = fitted(runs), {run.run.id: place for place, run in enumerate(runs)}
    found = [(by_run[threshold.run], asdict(threshold)) for threshold in of_runs.thresholds]
    found += [(run, _without_refit(run)) for run, _ in of_runs.refused]
    rows = []
    for of_run, threshold in sorted(found, key=lambda each: order[each[0].run.id]):
        session, run = of_run.session, of_run.run
        row = threshold | {name: getattr(run, name) for name in ("respondent", "rig_simulated", "shown")}
        row |= {"study": studies[session.study_id], "visit": session.visit, "flags": "|".join(threshold["flags"])}
        row["protocol_version"] = versions[run.protocol_version_id]
        row["group"] = "simulated" if run.respondent in PROGRAMS else session.subject_group
        rows.append({name: _plain(row.get(name)) for name in names})
    return rows


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


def _task(row: TableRow) -> str:
    paradigm = str(row["paradigm"])
    if paradigm in get_args(Paradigm):
        return "recognition"
    return "detection" if paradigm == FORCED_CHOICE else label(paradigm)


def _tasks(rows: Iterable[TableRow]) -> list[str]:
    return sorted({_task(row) for row in rows})


def _of(rows: Iterable[TableRow], **values: object) -> list[TableRow]:
    return [row for row in rows if all(row[name] == value for name, value in values.items())]


def participants(data: Exported) -> dict[str, TableRow]:
    """Return study and subject of everybody with trials, by a label of letters and digits that nobody else has.

    Codes that two studies share, or that a file system takes for one, get the study's name and, if need be, a number.
    """
    each = sorted({(str(row["study"]), str(row["subject"])) for row in data.tables["trials"]})
    codes = Counter(label(subject).casefold() for _, subject in each)
    people: dict[str, TableRow] = {}
    for study, subject in each:
        name = label(subject) if codes[label(subject).casefold()] == 1 else label(study) + label(subject)
        taken = {known.casefold() for known in people}
        tried = (name if number == 1 else f"{name}n{number}" for number in count(1))
        people[next(each for each in tried if each.casefold() not in taken)] = {"study": study, "subject": subject}
    return people


def _description(data: Exported) -> tuple[str, str]:
    """Return the studies' names, and a sentence on the data that calls simulated data simulated."""
    trials = data.tables["trials"]
    text = f"Vibrotactile {' and '.join(_tasks(trials))}, one row for each answered trial."
    if any(row["respondent"] in PROGRAMS for row in trials):
        text += " Simulated subjects answered; see the column respondent."
    elif any(row["rig_simulated"] == 1 for row in trials):
        text += " The display was simulated: nothing could be felt; see the columns rig_simulated and shown."
    return "; ".join(sorted({str(row["study"]) for row in trials})), text


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
    data = exported(store)
    names = {label(str(row["subject"])) for row in data.tables["subjects"]} | participants(data).keys()
    with atomic_folder(folder, _OWN_NAMES | {f"sub-{name}" for name in names}) as beside:
        FORMS[form](data, beside)
    return len(data.tables["trials"])


def _write_json(path: Path, document: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _write_settings(data: Exported, folder: Path) -> None:
    for name, settings in data.settings.items():
        _write_json(folder / f"{name}.json", settings)


def _write_tidy(data: Exported, folder: Path) -> None:
    rows = []
    for name in data.tables:
        data.write(name, folder / f"{name}.csv")
        rows += [column._asdict() | {"column": column.name} for column in data.columns[name]]
    _write_rows(folder / "dictionary.csv", ("table", "column", "description", "unit"), rows, ",")
    _write_settings(data, folder / "settings")


def _write_psych_ds(data: Exported, folder: Path) -> None:
    name, text = _description(data)
    variables: dict[str, Column] = {}
    for column in (column for table, rows in data.tables.items() if rows for column in data.columns[table]):
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
    for person, who in participants(data).items():
        mine = _of(data.tables["trials"], **who)
        for task in _tasks(mine):
            runs = {row["run"] for row in mine if _task(row) == task}
            for table in ("trials", "intervals"):
                path = within / f"subject-{person}_task-{task}_description-{table}_data.csv"
                data.write(table, path, rows=[row for row in data.tables[table] if row["run"] in runs])
    _write_settings(data, folder / "analysis")


def _write_read_me(data: Exported, folder: Path) -> None:
    (folder / "README.md").write_text("# {}\n\n{}\n".format(*_description(data)), encoding="utf-8")


def _write_bids(data: Exported, folder: Path) -> None:
    about = {"Name": _description(data)[0], "BIDSVersion": "1.10.0"}
    by = {"GeneratedBy": [{"Name": "tactuator", "Version": __version__}]}
    _write_json(folder / "dataset_description.json", {**about, "DatasetType": "raw", **by})
    _write_read_me(data, folder)
    # the ids that others know the subjects by stay in the laboratory
    kept = [column for column in data.columns["subjects"] if column.name not in ("study", "subject", "outside_id")]
    people = [
        row | {"participant_id": f"sub-{person}"}
        for person, who in participants(data).items()
        for row in _of(data.tables["subjects"], **who)
    ]
    names = ["participant_id", *(column.name for column in kept)]
    _write_rows(folder / "participants.tsv", names, people, "\t", _MISSING)
    _write_json(folder / "participants.json", _described(kept))
    visits = any(int(row["visit"] or 1) > 1 for row in data.tables["trials"])
    for person, who in participants(data).items():
        mine = _of(data.tables["trials"], **who)
        for visit in sorted({int(row["visit"] or 1) for row in mine}):
            entities = [f"sub-{person}", *([f"ses-{visit:02d}"] if visits else [])]
            _write_session(data, _of(mine, visit=visit), folder.joinpath(*entities, "beh"), "_".join(entities))
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


def _write_session(data: Exported, trials: list[TableRow], place: Path, entities: str) -> None:
    asks, columns = "Judgement of tones; as in the protocol's table [task]", COLUMNS["bids-events"]
    for task in _tasks(trials):
        asked = [row for row in trials if _task(row) == task]
        for number, run in enumerate(dict.fromkeys(row["run"] for row in asked), start=1):
            stem = place / f"{entities}_task-{task}_run-{number:02d}"
            about = {"TaskName": task, "TaskDescription": _QUESTIONS.get(task, asks)}
            _write_json(Path(f"{stem}_beh.json"), about | _described(data.columns["trials"]))
            rows, played = _of(asked, run=run), _of(data.tables["intervals"], run=run)
            data.write("trials", Path(f"{stem}_beh.tsv"), "\t", _MISSING, rows)
            if all(row["onset_s"] is not None for row in played):
                names = [column.name for column in columns]
                _write_rows(Path(f"{stem}_events.tsv"), names, _bids_events(rows, played), "\t", _MISSING)
                _write_json(Path(f"{stem}_events.json"), _described(columns[2:]))


def _bids_events(trials: list[TableRow], played: list[TableRow]) -> list[TableRow]:
    began = {row["trial"]: datetime.fromisoformat(str(row["presented_utc"])) for row in trials}
    first = min(began.values())
    for row in played:
        since_s = (began[row["trial"]] - first).total_seconds()
        row |= {"onset": round(since_s + row["onset_s"], 6), "duration": row["duration_s"]}
    return sorted(played, key=lambda row: float(row["onset"]))


FORMS: dict[str, Callable[[Exported, Path], None]] = {
    "tidy": _write_tidy, "psych-ds": _write_psych_ds, "bids": _write_bids,
}  # fmt: skip
"""Names of the formats, and the functions that write them."""
