"""Exports: tidy CSV, Psych-DS and BIDS behaviour; each a folder with its data dictionary, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.experiment.export.bids import write_bids
from tactuator.experiment.export.dictionary import dictionary
from tactuator.experiment.export.psych_ds import write_psych_ds
from tactuator.experiment.export.rows import Exported, exported
from tactuator.experiment.export.tasks import participants
from tactuator.experiment.export.writing import label, lines, table_text, write_json
from tactuator.experiment.store.store import Store
from tactuator.io.atomic import atomic_folder

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
