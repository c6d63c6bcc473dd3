"""Exports: tidy CSV, Psych-DS and BIDS behaviour; each a folder with its data dictionary, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.experiment.export.dictionary import Meaning, dictionary
from tactuator.experiment.export.rows import (
    Exported,
    ExportTable,
    TableRow,
    Value,
    cell,
    described,
    description,
    exported,
    label,
    lines,
    participants,
    runs_of,
    study_names,
    table_text,
    task_name,
    task_names,
    write_json,
)
from tactuator.experiment.store.store import Store
from tactuator.io.atomic import atomic_folder


def write_psych_ds(found: Exported, folder: Path) -> None:
    """Write the dataset: trials and intervals of each subject and task, and the tables of all of them."""
    variables: dict[str, Meaning] = {}
    for table in found.tables.values():
        for one in table.columns if table.rows else ():
            variables.setdefault(one.name, one)
    write_json(
        folder / "dataset_description.json",
        {
            "@context": "https://schema.org/",
            "@type": "Dataset",
            "name": study_names(found),
            "description": description(found),
            "schemaVersion": "Psych-DS 1.0.0",
            "variableMeasured": [_property(one) for one in variables.values()],
        },
    )
    (folder / "README.md").write_text(f"# {study_names(found)}\n\n{description(found)}\n", encoding="utf-8")
    data = folder / "data"
    data.mkdir()
    for name in ("events", "subjects", "thresholds"):
        table = found.tables[name]
        if table.rows:
            (data / f"description-{name}_data.csv").write_text(table_text(table), encoding="utf-8")
    for person in participants(found):
        mine = [row for row in found.trials.rows if person.has(row)]
        for task in task_names(mine):
            trials = [row for row in mine if task_name(row) == task]
            _write(data, f"subject-{person.label}_task-{task}", "trials", found.trials, trials)
            runs = {row["run"] for row in trials}
            intervals = [row for row in found.intervals.rows if row["run"] in runs]
            _write(data, f"subject-{person.label}_task-{task}", "intervals", found.intervals, intervals)
    (folder / "analysis").mkdir()
    for name, settings in found.settings.items():
        write_json(folder / "analysis" / f"{name}.json", settings)


def _write(folder: Path, stem: str, what: str, table: ExportTable, rows: list[TableRow]) -> None:
    (folder / f"{stem}_description-{what}_data.csv").write_text(table_text(table, rows=rows), encoding="utf-8")


def _property(one: Meaning) -> dict[str, str]:
    unit = {"unitText": one.unit} if one.unit else {}
    return {"@type": "PropertyValue", "name": one.name, "description": one.description, **unit}


_VERSION, _MISSING = "1.10.0", "n/a"
_QUESTIONS = {
    "detection": "Which interval carries the vibration?",
    "recognition": "Which item was it? (ABX: A or B?)",
}
_EVENTS = (
    Meaning("onset", "Onset of the interval, from the presentation of the run's first trial", "s"),
    Meaning("duration", "Duration of the interval, by the rig's own clock", "s"),
    Meaning("trial", "Number of the trial in its run, from 0"),
    Meaning("interval", "Place of the interval in the trial, from 1"),
    Meaning("stimulus", "Label of what it played; blank: nothing"),
    Meaning("commanded_db_sl", "Commanded level", "dB re the threshold curve"),
    Meaning("measured_db_sl", "Level at the sensor", "dB re the threshold curve"),
)


def write_bids(found: Exported, folder: Path) -> None:
    """Write the dataset into the folder."""
    about = {"Name": study_names(found), "BIDSVersion": _VERSION}
    made_by = [{"Name": "tactuator", "Version": __version__}]
    write_json(folder / "dataset_description.json", {**about, "DatasetType": "raw", "GeneratedBy": made_by})
    (folder / "README.md").write_text(f"# {study_names(found)}\n\n{description(found)}\n", encoding="utf-8")
    _participants(found, folder)
    visits = any(int(row["visit"] or 1) > 1 for row in found.trials.rows)
    for one in participants(found):
        mine = [row for row in found.trials.rows if one.has(row)]
        for visit in sorted({int(row["visit"] or 1) for row in mine}):
            entities = [f"sub-{one.label}", *([f"ses-{visit:02d}"] if visits else [])]
            place = folder.joinpath(*entities, "beh")
            place.mkdir(parents=True)
            _session(found, [row for row in mine if row["visit"] == visit], place, "_".join(entities))
    _derivatives(found, folder / "derivatives" / "tactuator", {**about, "GeneratedBy": made_by})


def _participants(found: Exported, folder: Path) -> None:
    """Write the subjects with their demographics; the ids that others know them by stay in the laboratory."""
    extra = [one for one in found.subjects.columns if one.name not in ("study", "subject", "outside_id")]
    rows = [
        (f"sub-{one.label}", *(cell(row[column.name], _MISSING) for column in extra))
        for one in participants(found)
        for row in found.subjects.rows
        if one.has(row)
    ]
    names = [("participant_id", *(one.name for one in extra))]
    (folder / "participants.tsv").write_text(lines([*names, *rows], "\t"), encoding="utf-8")
    write_json(folder / "participants.json", described(extra))


def _session(found: Exported, trials: list[TableRow], place: Path, entities: str) -> None:
    for task in task_names(trials):
        asked = [row for row in trials if task_name(row) == task]
        for number, run in enumerate(runs_of(asked), start=1):
            stem = f"{entities}_task-{task}_run-{number:02d}"
            rows = [row for row in asked if row["run"] == run]
            table = table_text(found.trials, "\t", _MISSING, rows)
            (place / f"{stem}_beh.tsv").write_text(table, encoding="utf-8")
            write_json(place / f"{stem}_beh.json", {**_sidecar(task), **described(found.trials.columns)})
            played = [row for row in found.intervals.rows if row["run"] == run]
            if all(row["onset_s"] is not None for row in played):
                (place / f"{stem}_events.tsv").write_text(_events(rows, played), encoding="utf-8")
                write_json(place / f"{stem}_events.json", described(_EVENTS[2:]))


def _sidecar(task: str) -> dict[str, str]:
    return {"TaskName": task, "TaskDescription": _QUESTIONS[task]}


def _events(trials: list[TableRow], played: list[TableRow]) -> str:
    """Return every interval of a run, in the order of time, as separated values."""
    began = {row["trial"]: datetime.fromisoformat(str(row["presented_utc"])) for row in trials}
    first = min(began.values())
    rows: list[list[Value]] = []
    for row in played:
        assert isinstance(row["onset_s"], float)
        onset = (began[row["trial"]] - first).total_seconds() + row["onset_s"]
        others = [cell(row[one.name], _MISSING) for one in _EVENTS[2:]]
        rows.append([round(onset, 6), cell(row["duration_s"], _MISSING), *others])
    rows.sort(key=lambda row: float(row[0] or 0.0))
    return lines([[one.name for one in _EVENTS], *rows], "\t")


def _derivatives(found: Exported, folder: Path, about: dict[str, object]) -> None:
    """Write thresholds, events and settings as a dataset of its own."""
    folder.mkdir(parents=True)
    write_json(folder / "dataset_description.json", {**about, "DatasetType": "derivative"})
    for name in ("thresholds", "events"):
        table = found.tables[name]
        (folder / f"{name}.tsv").write_text(table_text(table, "\t", _MISSING), encoding="utf-8")
        write_json(folder / f"{name}.json", described(table.columns))
    for name, settings in found.settings.items():
        write_json(folder / f"{name}.json", settings)


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
        raise BadInput(f"format {form!r}", f"{', '.join(FORMS)}")
    all_of_it = exported(store)
    names = {label(str(row["subject"])) for row in all_of_it.subjects.rows}
    own = _OWN_NAMES | {f"sub-{one}" for one in names | {one.label for one in participants(all_of_it)}}
    with atomic_folder(folder, frozenset(own)) as beside:
        FORMS[form](all_of_it, beside)
    return len(all_of_it.trials.rows)


def _tidy(found: Exported, folder: Path) -> None:
    """Write a CSV for each table, dictionary.csv for all of them, and the protocols' settings."""
    for name, table in found.tables.items():
        (folder / f"{name}.csv").write_text(table_text(table), encoding="utf-8")
    meanings = dictionary((name, table.columns) for name, table in found.tables.items())
    header = ("table", "column", "description", "unit")
    (folder / "dictionary.csv").write_text(lines([header, *meanings], ","), encoding="utf-8")
    (folder / "settings").mkdir()
    for name, settings in found.settings.items():
        write_json(folder / "settings" / f"{name}.json", settings)


FORMS: dict[str, Callable[[Exported, Path], None]] = {"tidy": _tidy, "psych-ds": write_psych_ds, "bids": write_bids}
"""Names of the formats, and the functions that write them."""
