"""Psych-DS 1.0: dataset_description.json in the words of schema.org, and data/*_data.csv."""

from __future__ import annotations

from pathlib import Path

from tactuator.experiment.export.dictionary import Meaning
from tactuator.experiment.export.rows import Exported, ExportTable, TableRow
from tactuator.experiment.export.tasks import description, participants, study_names, task_name, task_names
from tactuator.experiment.export.writing import table_text, write_json


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
