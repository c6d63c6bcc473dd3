"""Grouping of trials into files, for formats that have a file for each subject and task."""

from __future__ import annotations

from collections.abc import Sequence

from tactuator.experiment.export.rows import Exported, TableRow, Value
from tactuator.experiment.protocol.plan import FORCED_CHOICE


def task_name(row: TableRow) -> str:
    """Return the task of a trial: detection or identification."""
    return "detection" if row["paradigm"] == FORCED_CHOICE else "identification"


def task_names(rows: Sequence[TableRow]) -> list[str]:
    """Return the tasks of the trials, each once."""
    return sorted({task_name(row) for row in rows})


def study_names(found: Exported) -> str:
    """Return the names of the studies, joined."""
    return "; ".join(sorted({str(row["study"]) for row in found.trials.rows}))


def subject_codes(found: Exported) -> list[str]:
    """Return the subjects with trials, each once."""
    return sorted({str(row["subject"]) for row in found.trials.rows})


def runs_of(rows: Sequence[TableRow]) -> list[Value]:
    """Return the runs of the trials, each once, in the order of the store."""
    return list(dict.fromkeys(row["run"] for row in rows))


def description(found: Exported) -> str:
    """Return a description of the data in a sentence or two, which calls simulated data simulated."""
    text = f"Vibrotactile {' and '.join(task_names(found.trials.rows))}, one row for each answered trial."
    simulated = {row["respondent"] for row in found.trials.rows} & {"simulated", "script"}
    if simulated:
        text += " Simulated subjects answered; see the column respondent."
    elif any(row["rig_simulated"] == 1 for row in found.trials.rows):
        text += " The display was simulated: nothing could be felt; see the columns rig_simulated and shown."
    return text
