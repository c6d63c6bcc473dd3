"""Exports: tidy CSV, Psych-DS and BIDS behaviour; each a folder with its data dictionary, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.experiment.dictionary import Meaning
from tactuator.experiment.export_rows import (
    Exported,
    TableRow,
    Value,
    cell,
    description,
    exported,
    label,
    lines,
    participants,
    study_names,
    task_name,
    task_names,
    write_json,
)
from tactuator.experiment.store.store import Store
from tactuator.io.atomic import atomic_folder

_MISSING = "n/a"
_QUESTIONS = {"detection": "Which interval carries the vibration?", "recognition": "Which item was it? (ABX: A or B?)"}
_EVENTS = (
    Meaning("onset", "Onset of the interval, from the presentation of the run's first trial", "s"),
    Meaning("duration", "Duration of the interval, by the rig's own clock", "s"),
    Meaning("trial", "Number of the trial in its run, from 0"),
    Meaning("interval", "Place of the interval in the trial, from 1"),
    Meaning("stimulus", "Label of what it played; blank: nothing"),
    Meaning("commanded_db_sl", "Commanded level", "dB re the threshold curve"),
    Meaning("measured_db_sl", "Level at the sensor", "dB re the threshold curve"),
    Meaning("simulated", "simulated: nobody felt it"),
)
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
    names = {label(str(row["subject"])) for row in data.tables["subjects"].rows}
    names |= {person.label for person in participants(data)}
    with atomic_folder(folder, _OWN_NAMES | {f"sub-{name}" for name in names}) as beside:
        FORMS[form](data, beside)
    return len(data.tables["trials"].rows)


def _write_tidy(data: Exported, folder: Path) -> None:
    meanings = [("table", "column", "description", "unit")]
    for name, table in data.tables.items():
        table.write(folder / f"{name}.csv")
        meanings += [(name, column.name, column.description, column.unit) for column in table.columns]
    (folder / "dictionary.csv").write_text(lines(meanings, ","), encoding="utf-8")
    _write_settings(data, folder / "settings")


def _write_settings(data: Exported, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for name, settings in data.settings.items():
        write_json(folder / f"{name}.json", settings)


def _write_read_me(data: Exported, folder: Path) -> None:
    (folder / "README.md").write_text(f"# {study_names(data)}\n\n{description(data)}\n", encoding="utf-8")


def _write_psych_ds(data: Exported, folder: Path) -> None:
    variables: dict[str, Meaning] = {}
    for column in (column for table in data.tables.values() if table.rows for column in table.columns):
        variables.setdefault(column.name, column)
    measured = [
        {"@type": "PropertyValue", "name": name, "description": about.description}
        | ({"unitText": about.unit} if about.unit else {})
        for name, about in variables.items()
    ]
    about = {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": study_names(data),
        "description": description(data),
        "schemaVersion": "Psych-DS 1.0.0",
        "variableMeasured": measured,
    }
    write_json(folder / "dataset_description.json", about)
    _write_read_me(data, folder)
    within = folder / "data"
    within.mkdir()
    for name in ("events", "subjects", "thresholds"):
        if data.tables[name].rows:
            data.tables[name].write(within / f"description-{name}_data.csv")
    for person in participants(data):
        mine = [row for row in data.tables["trials"].rows if person.has(row)]
        for task in task_names(mine):
            runs = {row["run"] for row in mine if task_name(row) == task}
            for name in ("trials", "intervals"):
                rows = [row for row in data.tables[name].rows if row["run"] in runs]
                path = within / f"subject-{person.label}_task-{task}_description-{name}_data.csv"
                data.tables[name].write(path, rows=rows)
    _write_settings(data, folder / "analysis")


def _write_bids(data: Exported, folder: Path) -> None:
    about = {"Name": study_names(data), "BIDSVersion": "1.10.0"}
    by = {"GeneratedBy": [{"Name": "tactuator", "Version": __version__}]}
    write_json(folder / "dataset_description.json", {**about, "DatasetType": "raw", **by})
    _write_read_me(data, folder)
    _write_participants(data, folder)
    trials = data.tables["trials"].rows
    visits = any(int(row["visit"] or 1) > 1 for row in trials)
    for person in participants(data):
        mine = [row for row in trials if person.has(row)]
        for visit in sorted({int(row["visit"] or 1) for row in mine}):
            entities = [f"sub-{person.label}", *([f"ses-{visit:02d}"] if visits else [])]
            place = folder.joinpath(*entities, "beh")
            place.mkdir(parents=True)
            _write_session(data, [row for row in mine if row["visit"] == visit], place, "_".join(entities))
    derived = folder / "derivatives" / "tactuator"
    derived.mkdir(parents=True)
    write_json(derived / "dataset_description.json", {**about, **by, "DatasetType": "derivative"})
    for name in ("thresholds", "events"):
        data.tables[name].write(derived / f"{name}.tsv", "\t", _MISSING)
        write_json(derived / f"{name}.json", _described(data.tables[name].columns))
    _write_settings(data, derived)


def _described(columns: tuple[Meaning, ...]) -> Mapping[str, Mapping[str, str]]:
    return {
        column.name: {"Description": column.description, **({"Units": column.unit} if column.unit else {})}
        for column in columns
    }


def _write_participants(data: Exported, folder: Path) -> None:
    """Write the subjects with their demographics; the ids that others know them by stay in the laboratory."""
    subjects = data.tables["subjects"]
    kept = tuple(column for column in subjects.columns if column.name not in ("study", "subject", "outside_id"))
    rows: list[tuple[Value, ...]] = [("participant_id", *(column.name for column in kept))]
    for person in participants(data):
        mine = (row for row in subjects.rows if person.has(row))
        rows += [(f"sub-{person.label}", *(cell(row[column.name], _MISSING) for column in kept)) for row in mine]
    (folder / "participants.tsv").write_text(lines(rows, "\t"), encoding="utf-8")
    write_json(folder / "participants.json", _described(kept))


def _write_session(data: Exported, trials: list[TableRow], place: Path, entities: str) -> None:
    table = data.tables["trials"]
    for task in task_names(trials):
        asked = [row for row in trials if task_name(row) == task]
        for number, run in enumerate(dict.fromkeys(row["run"] for row in asked), start=1):
            stem = f"{entities}_task-{task}_run-{number:02d}"
            rows = [row for row in asked if row["run"] == run]
            table.write(place / f"{stem}_beh.tsv", "\t", _MISSING, rows)
            asks = _QUESTIONS.get(task, "Judgement of tones; the protocol's table [task] tells it")
            sidecar = {"TaskName": task, "TaskDescription": asks, **_described(table.columns)}
            write_json(place / f"{stem}_beh.json", sidecar)
            played = [row for row in data.tables["intervals"].rows if row["run"] == run]
            if all(row["onset_s"] is not None for row in played):
                (place / f"{stem}_events.tsv").write_text(_events(rows, played), encoding="utf-8")
                write_json(place / f"{stem}_events.json", _described(_EVENTS[2:]))


def _events(trials: list[TableRow], played: list[TableRow]) -> str:
    began = {row["trial"]: datetime.fromisoformat(str(row["presented_utc"])) for row in trials}
    first = min(began.values())
    rows: list[list[Value]] = []
    for row in played:
        assert isinstance(row["onset_s"], float)
        onset = (began[row["trial"]] - first).total_seconds() + row["onset_s"]
        others = [cell(row[column.name], _MISSING) for column in _EVENTS[2:]]
        rows.append([round(onset, 6), cell(row["duration_s"], _MISSING), *others])
    rows.sort(key=lambda row: float(row[0] or 0.0))
    return lines([[column.name for column in _EVENTS], *rows], "\t")


FORMS: dict[str, Callable[[Exported, Path], None]] = {
    "tidy": _write_tidy,
    "psych-ds": _write_psych_ds,
    "bids": _write_bids,
}
"""Names of the formats, and the functions that write them."""
