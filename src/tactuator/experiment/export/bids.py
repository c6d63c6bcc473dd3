"""BIDS 1.10: sub-*/beh/*_beh.tsv, *_events.tsv and side-cars, participants.tsv, thresholds as a derivative."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from tactuator import __version__
from tactuator.experiment.export.dictionary import Meaning
from tactuator.experiment.export.rows import Exported, TableRow, Value
from tactuator.experiment.export.tasks import (
    description,
    participants,
    runs_of,
    study_names,
    task_name,
    task_names,
)
from tactuator.experiment.export.writing import cell, described, lines, table_text, write_json

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
