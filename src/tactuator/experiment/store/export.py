"""Exports: tidy CSV, Psych-DS and BIDS behaviour; each a folder with its data dictionary, whole or not at all."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.experiment.protocol.plan import FORCED_CHOICE
from tactuator.experiment.store.dictionary import TRIAL_COLUMNS
from tactuator.experiment.store.export_rows import TrialRow, trial_rows
from tactuator.experiment.store.store import Store
from tactuator.files.atomic import atomic_folder

_DESCRIPTION, _DICTIONARY = "dataset_description.json", "trials_dictionary.csv"
_OWN = frozenset(["trials.csv", _DICTIONARY, _DESCRIPTION, "data", "README", "participants.tsv", "participants.json"])
_NAMES = [one.name for one in TRIAL_COLUMNS]


def export(store: Store, folder: Path, form: str) -> int:
    """Write every answered trial; how many there were. Raises BadInput for another form or an empty store."""
    if form not in FORMS:
        raise BadInput(f"format {form!r}; allowed: {', '.join(FORMS)}")
    rows = trial_rows(store)
    own = _OWN | {f"sub-{_label(subject)}" for subject in _subjects(rows)}
    with atomic_folder(folder, own) as beside:
        FORMS[form](rows, beside)
    return len(rows)


def _tidy(rows: Sequence[TrialRow], folder: Path) -> None:
    """trials.csv and trials_dictionary.csv."""
    (folder / "trials.csv").write_text(_table(rows, ",", ""), encoding="utf-8")
    meanings = ((one.name, one.description, one.unit) for one in TRIAL_COLUMNS)
    (folder / _DICTIONARY).write_text(_lines([("column", "description", "unit"), *meanings], ","), encoding="utf-8")


def _psych_ds(rows: Sequence[TrialRow], folder: Path) -> None:
    """Psych-DS 1.0: dataset_description.json (schema.org) and data/*_data.csv."""
    described = [
        {
            "@type": "PropertyValue",
            "name": one.name,
            "description": one.description,
            **({"unitText": one.unit} if one.unit else {}),
        }
        for one in TRIAL_COLUMNS
    ]
    _json(
        folder / _DESCRIPTION,
        {
            "@context": "https://schema.org/",
            "@type": "Dataset",
            "name": _study(rows),
            "description": f"Vibrotactile {' and '.join(_tasks(rows))}, one row for each answered trial.",
            "schemaVersion": "Psych-DS 1.0.0",
            "variableMeasured": described,
        },
    )
    data = folder / "data"
    data.mkdir()
    for subject in _subjects(rows):
        mine = [row for row in rows if row["subject"] == subject]
        for task in _tasks(mine):
            table = _table([row for row in mine if _task(row) == task], ",", "")
            (data / f"subject-{_label(subject)}_task-{task}_data.csv").write_text(table, encoding="utf-8")


def _bids(rows: Sequence[TrialRow], folder: Path) -> None:
    """BIDS 1.10: sub-*/beh/*_beh.tsv with a sidecar each, participants.tsv."""
    _json(
        folder / _DESCRIPTION,
        {
            "Name": _study(rows),
            "BIDSVersion": "1.10.0",
            "DatasetType": "raw",
            "GeneratedBy": [{"Name": "tactuator", "Version": __version__}],
        },
    )
    what = f"Vibrotactile {' and '.join(_tasks(rows))}; one row of a beh.tsv for each answered trial.\n"
    (folder / "README").write_text(what, "utf-8")
    groups = {str(row["subject"]): row["subject_group"] for row in rows}
    people = [("participant_id", "group"), *((f"sub-{_label(who)}", group) for who, group in groups.items())]
    (folder / "participants.tsv").write_text(_lines(people, "\t"), encoding="utf-8")
    _json(folder / "participants.json", {"group": {"Description": "hearing, hearing-impaired, simulated or unknown"}})
    for subject in _subjects(rows):
        place = folder / f"sub-{_label(subject)}" / "beh"
        place.mkdir(parents=True)
        mine = [row for row in rows if row["subject"] == subject]
        for task in _tasks(mine):
            asked = [row for row in mine if _task(row) == task]
            for number, run in enumerate(sorted({int(row["run"] or 0) for row in asked}), start=1):
                stem = f"sub-{_label(subject)}_task-{task}_run-{number:02d}_beh"
                table = _table([row for row in asked if row["run"] == run], "\t", "n/a")
                (place / f"{stem}.tsv").write_text(table, encoding="utf-8")
                _json(place / f"{stem}.json", _sidecar(task))


_ASKED = {"detection": "Which interval carries the vibration?", "identification": "Which item was it? (ABX: A or B?)"}


def _sidecar(task: str) -> dict[str, object]:
    """What a BIDS sidecar says of a run of that task and of its columns."""
    columns = {
        one.name: {"Description": one.description, **({"Units": one.unit} if one.unit else {})} for one in TRIAL_COLUMNS
    }
    return {"TaskName": task, "TaskDescription": _ASKED[task], **columns}


def _task(row: TrialRow) -> str:
    return "detection" if row["paradigm"] == FORCED_CHOICE else "identification"


def _tasks(rows: Sequence[TrialRow]) -> list[str]:
    return sorted({_task(row) for row in rows})


FORMS: dict[str, Callable[[Sequence[TrialRow], Path], None]] = {"tidy": _tidy, "psych-ds": _psych_ds, "bids": _bids}
"""Name of each format, and what writes it."""


def _table(rows: Sequence[TrialRow], separator: str, missing: str) -> str:
    cells = ([missing if row[name] is None or row[name] == "" else row[name] for name in _NAMES] for row in rows)
    return _lines([_NAMES, *cells], separator)


def _lines(rows: Iterable[Sequence[object]], separator: str) -> str:
    stream = io.StringIO()
    csv.writer(stream, delimiter=separator, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def _json(path: Path, document: object) -> None:
    path.write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _study(rows: Sequence[TrialRow]) -> str:
    return "; ".join(sorted({str(row["study"]) for row in rows}))


def _subjects(rows: Sequence[TrialRow]) -> list[str]:
    return sorted({str(row["subject"]) for row in rows})


def _label(text: str) -> str:
    """As a file name's label may be: letters and digits."""
    return re.sub(r"[^A-Za-z0-9]", "", text)
