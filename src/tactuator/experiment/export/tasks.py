"""Grouping of trials into files, for formats that have a file for each subject and task."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

from tactuator.experiment.export.rows import Exported, TableRow, Value
from tactuator.experiment.export.writing import label
from tactuator.experiment.protocol.plan import FORCED_CHOICE


def task_name(row: TableRow) -> str:
    """Return the task of a trial: detection or recognition."""
    return "detection" if row["paradigm"] == FORCED_CHOICE else "recognition"


def task_names(rows: Sequence[TableRow]) -> list[str]:
    """Return the tasks of the trials, each once."""
    return sorted({task_name(row) for row in rows})


def study_names(found: Exported) -> str:
    """Return the names of the studies, joined."""
    return "; ".join(sorted({str(row["study"]) for row in found.trials.rows}))


@dataclass(frozen=True)
class Participant:
    """A subject of one study. label: the name in files, letters and digits, that no other participant has."""

    study: Value
    subject: Value
    label: str

    def has(self, row: TableRow) -> bool:
        """Tell whether a row of a table is of this participant."""
        return (row["study"], row["subject"]) == (self.study, self.subject)


def participants(found: Exported) -> list[Participant]:
    """Return the participants with trials, by study and code.

    A code that two studies of the store have, or two codes that a file system may take for one, are told apart: the
    name of the study stands before the code and, if that is not enough, a number follows.
    """
    each = sorted({(str(row["study"]), str(row["subject"])) for row in found.trials.rows})
    codes = Counter(label(subject).casefold() for _, subject in each)
    taken: set[str] = set()
    all_of_them = []
    for study, subject in each:
        name = label(subject) if codes[label(subject).casefold()] == 1 else label(study) + label(subject)
        numbered = (name if number == 1 else f"{name}n{number}" for number in count(1))
        free = next(one for one in numbered if one.casefold() not in taken)
        taken.add(free.casefold())
        all_of_them.append(Participant(study, subject, free))
    return all_of_them


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
