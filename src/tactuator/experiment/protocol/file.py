"""Protocol files (TOML) of any kind, whose tables say which kind it is; and those in which tones are judged, whose
table [task] says what is asked.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from pydantic import Field

from tactuator.errors import BadInput
from tactuator.experiment.protocol.detection import Protocol as Protocol  # also for the study of the paper
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.protocol.study import PlannedRun, RunRules, StudyProtocol, further
from tactuator.experiment.task.task import Task, parse_task
from tactuator.experiment.trial import Marks, Timing
from tactuator.experiment.words import Words
from tactuator.io.kinds import require_kind
from tactuator.io.text import parse_toml, read_text
from tactuator.parameters import Flag, Whole, from_table, kept_by, table


@table("[session]")
class JudgingRules(RunRules):
    """Keys of [session]: practice before the first run, breaks, and the longest interruption of a run."""

    practice_trials: Annotated[Whole, Field(ge=0, le=100, description="trials of practice")] = 5
    feedback: Annotated[Flag, Field(description="of discrimination: the right response is told")] = False


@table("protocol")
class JudgingProtocol(StudyProtocol):
    """The protocol file of a study whose table [task] names the task."""

    task: Annotated[Task, *kept_by(parse_task, "a kind of task, with its keys")]
    session: JudgingRules = JudgingRules()
    timing: Timing = Timing()
    marks: Marks | None = None


def plan_judging(protocol: JudgingProtocol, words: Words, subject: int, visit: int = 1) -> tuple[PlannedRun, ...]:
    """Return the runs of a visit of a subject: practice on the first, then every run of the task in an order of the
    subject's own. `part` names the plan of the task that each run is of.
    """
    plans = protocol.task.plans(words)
    rng = np.random.default_rng([protocol.study.seed, 13, subject, *further(visit)])
    order = [int(index) for index in rng.permutation(len(plans))]
    practice = order[:1] if protocol.session.practice_trials else []
    runs = []
    for position, part in enumerate([*practice, *order]):
        practises, plan = position < len(practice), plans[part]
        title = words("run.title", finger=plan.finger, what=plan.what)
        runs.append(
            PlannedRun(
                position,
                plan.finger,
                plan.frequency_hz,
                practises,
                protocol.task.kind,
                "fixed" if practises else protocol.task.kind,
                protocol.session.feedback,
                words("run.practice", title=title) if practises else title,
                words("run.practice_plain") if practises else "",
                part=part,
            )
        )
    return tuple(runs)


_P = TypeVar("_P", bound=StudyProtocol)
_RECOGNITION_TABLES = {"recognition", "item", "block"}
_KINDS: dict[type[StudyProtocol], str] = {
    Protocol: "a detection protocol (tables procedure, conditions)",
    RecognitionProtocol: "a recognition protocol (tables item, block)",
    JudgingProtocol: "a protocol with a task (table task)",
}


def read_protocol(path: str | Path, form: type[_P]) -> tuple[_P, str]:
    """Return the protocol, of one of the kinds of `_KINDS`, and the file's own text. form: StudyProtocol for any kind.

    Raises BadInput, in one line that names the key, for a file that is missing, not TOML, says what is not allowed, or
    is of another kind.
    """
    require_kind(Path(path), "protocol")
    try:
        text = read_text(Path(path))
    except BadInput as error:
        raise BadInput(f"protocol {path}: {error}", "a TOML file that can be read") from None
    return parse_protocol(text, form, str(path)), text


def parse_protocol(text: str, form: type[_P], where: str = "protocol") -> _P:
    """Return the protocol that the text describes. Raises BadInput as `read_protocol`."""
    try:
        document = parse_toml(text)
    except BadInput as error:
        raise BadInput(f"protocol {where}: {error}", "TOML") from None
    kind: type[StudyProtocol] = RecognitionProtocol if _RECOGNITION_TABLES & set(document) else Protocol
    if "task" in document:
        kind = JudgingProtocol
    if not issubclass(kind, form):
        raise BadInput(f"protocol {where} has the tables {', '.join(document) or 'none'}", _KINDS[form])
    return from_table(kind, document, f"protocol {where}")


def protocol_hash(text: str) -> str:
    """Return the SHA-256 (hex) of the file's text."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
