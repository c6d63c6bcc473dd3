"""Recognition as a session's task: items from rendered references, asked in blocks, each answered with its label."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Self

import numpy as np
from sqlalchemy import Connection, insert, select

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.presenter import Presenter, Watch
from tactuator.experiment.protocol.recognition import ABX_RESPONSES, RecognitionProtocol, block_trials
from tactuator.experiment.protocol.study import PlannedRun
from tactuator.experiment.result.confusion import abx_table, information_table, matrix_table, session_results
from tactuator.experiment.session.task import (
    Apparatus,
    Envelope,
    NextTrial,
    OfferedResponse,
    Question,
    Rules,
    SessionTask,
)
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.store.store import Store
from tactuator.experiment.task.task import Picture, TaskState
from tactuator.experiment.trial import Trial
from tactuator.experiment.words import Words, shipped_words
from tactuator.io.reference import content_sha256, open_reference
from tactuator.result import ResultTable
from tactuator.rig.player import check_reference
from tactuator.rig.rig import Rig

LONGEST_S = 60.0


@dataclass(frozen=True, eq=False)
class LoadedItem:
    """An item with its stimulus.

    reference: (n, channels) in the rig's order, threshold units. sha256: of the reference's samples.
    """

    label: str
    source: str
    reference: FloatArray
    duration_s: float
    sha256: str


def load_items(protocol: RecognitionProtocol, beside: Path, rig: Rig) -> Mapping[str, LoadedItem]:
    """Return every item of the protocol, by label; files lie beside the protocol.

    Raises BadInput for a file that is not a reference for this rig, is beyond comfort, or lasts over a minute.
    """
    items = {}
    for item in protocol.item:
        path = beside / item.file
        reference = open_reference(path)
        if not 0.0 < reference.duration_s <= LONGEST_S:
            raise BadInput(f"item {item.label!r}: {reference.duration_s:g} s", f"above 0, {LONGEST_S:g} at most")
        columns = check_reference(reference, rig)
        samples = np.concatenate(list(reference.blocks()))[:, columns]
        items[item.label] = LoadedItem(item.label, item.file, samples, reference.duration_s, content_sha256(path))
    return items


def keep_items(
    connection: Connection, study: int, protocol: RecognitionProtocol, items: Mapping[str, LoadedItem]
) -> None:
    """Store the items that are new to the study. Raises BadInput where one of them, or its key, has changed."""
    stored = list(connection.execute(select(schema.stimulus).where(schema.stimulus.c.study_id == study)))
    for row in stored:
        if row.label in items and items[row.label].sha256 != row.sha256:
            raise BadInput(
                f"item {row.label!r} is not what it was when the study began", "the same files, or a new study"
            )
    known = {row.label for row in stored}
    stimuli = [
        {"study_id": study, "label": i.label, "source": i.source, "sha256": i.sha256, "duration_s": i.duration_s}
        for i in items.values()
        if i.label not in known
    ]
    if not stimuli:
        return
    connection.execute(insert(schema.stimulus), stimuli)
    options = [
        {"study_id": study, "position": position, "label": item.label, "key": item.key}
        for position, item in enumerate(protocol.item)
        if item.label not in known
    ]
    _refuse_taken_keys(connection, study, [str(option["key"]) for option in options])
    connection.execute(insert(schema.response_option), options)


def _refuse_taken_keys(connection: Connection, study: int, keys: Sequence[str]) -> None:
    options = schema.response_option
    taken = set(connection.execute(select(options.c.key).where(options.c.study_id == study)).scalars())
    for key in keys:
        if key in taken:
            raise BadInput(f"key {key!r} is another item's of this study", "one that none has had")


@dataclass(frozen=True)
class RecognitionTask(SessionTask):
    """A recognition protocol with its items, at an apparatus."""

    protocol: RecognitionProtocol
    items: Mapping[str, LoadedItem] = field(default_factory=dict)

    @classmethod
    def load(
        cls, protocol: RecognitionProtocol, beside: Path, apparatus: Apparatus, words: Words | None = None
    ) -> Self:
        return cls(protocol, apparatus, words or shipped_words("en"), load_items(protocol, beside, apparatus.rig))

    @property
    def question(self) -> Question:
        """Return the question of every trial: labels with the protocol's keys.

        A, B and X are named as they play; other items are not.
        """
        paradigm = self.protocol.recognition.paradigm
        if paradigm == "abx":
            pairs = zip(ABX_RESPONSES, "12", strict=True)
            choices = tuple(OfferedResponse(name, (name.lower(), name, digit)) for name, digit in pairs)
            return Question(self.words(f"prompt.{paradigm}"), choices, (*ABX_RESPONSES, "X"))
        choices = tuple(OfferedResponse(item.label, (item.key,)) for item in self.protocol.item)
        return Question(self.words(f"prompt.{paradigm}"), choices)

    @property
    def rules(self) -> Rules:
        session = self.protocol.session
        return Rules(
            feedback_s=self.protocol.recognition.feedback_s,
            break_after_trials=session.break_after_trials,
            break_between_runs=session.break_between_blocks,
            break_s=session.break_s,
        )

    def enrol(self, connection: Connection, study: int) -> None:
        keep_items(connection, study, self.protocol, self.items)

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        asking, rate_hz = self.protocol.recognition, self.apparatus.rig.rate_hz
        intervals = 1 if asking.paradigm == "recognition" else 3
        longest_s = max(len(item.reference) for item in self.items.values()) / rate_hz
        played_s = asking.lead_s + intervals * longest_s + (intervals - 1) * asking.gap_s
        return planned.typical_trials, played_s + (asking.feedback_s if planned.feedback else 0.0)

    def begin(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> BlockState:
        which = (subject, planned.position, attempt, visit)
        labels = tuple(choice.response for choice in self.question.choices)
        criterion = self.protocol.block[planned.position].criterion
        return BlockState(self.protocol.run_seed(*which), labels, block_trials(self.protocol, *which), criterion)

    def play(self, following: NextTrial, watch: Watch, halted: Callable[[], bool], presented: datetime) -> PlayedTrial:
        """Play the items of the trial on every channel.

        A trial always takes as long as the longest items would, and in ABX so does each of its intervals: how long
        something takes on the subject's page then says nothing of what it was.
        """
        asking, rig, trial = self.protocol.recognition, self.apparatus.rig, following.trial
        longest = max(len(item.reference) for item in self.items.values())
        references = [self.items[label].reference for label in trial.stimuli]
        if asking.paradigm == "abx":
            references = [np.pad(reference, ((0, longest - len(reference)), (0, 0))) for reference in references]
        silent = longest * len(references) - sum(len(reference) for reference in references)
        presenter = Presenter(rig, watch, halted)
        shown = presenter.present(references, asking.lead_s, asking.gap_s, silent / rig.rate_hz)
        records = tuple(at.record(label) for label, at in zip(trial.stimuli, shown.intervals, strict=True))
        return PlayedTrial(trial, records, presented, rig_tick=shown.rig_tick, lasted_s=shown.lasted_s)

    def envelope(self, trial: Trial, interval: int) -> Envelope:
        reference = self.items[trial.stimuli[interval]].reference
        step = max(1, round(Envelope.STEP_S * self.apparatus.rig.rate_hz))
        peaks = np.maximum.reduceat(np.abs(reference).max(axis=1), np.arange(0, len(reference), step))
        levels = 20.0 * np.log10(np.maximum(peaks, 10.0 ** (Envelope.SILENT_DB_SL / 20.0)))
        return Envelope.of(levels)

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """Return confusion matrix and information transfer of the test blocks; of ABX, the share of right answers.

        Raises BadInput where they have no answers yet.
        """
        rng = np.random.default_rng(self.protocol.study.seed)
        matrices, abx = session_results(store, self.protocol, session, rng)
        if not matrices and not abx:
            raise BadInput("the session's test blocks have no answers yet", "results after some")
        words, tables = self.words, list[ResultTable]()
        for matrix in matrices:
            title = words("results.information")
            tables += [
                matrix_table(matrix, words),
                information_table(title, matrix.information, words, matrix.simulated),
            ]
        return (*tables, *(abx_table(result, words) for result in abx))


@dataclass
class BlockState(TaskState):
    """State of one block, whose trials are planned. criterion: share right that training has to reach."""

    labels: tuple[str, ...]
    planned_trials: tuple[Trial, ...]
    criterion: float | None

    @property
    def share_done(self) -> float:
        return self.trials / len(self.planned_trials)

    def draw(self, number: int) -> Trial | None:
        return None if number == len(self.planned_trials) else self.planned_trials[number]

    @property
    def passed(self) -> bool:
        right = sum(correct for *_, correct in self.answered)
        return self.criterion is None or not self.answered or right >= self.criterion * self.trials

    def picture(self) -> Picture:
        counts = np.zeros((len(self.labels), len(self.labels)), dtype=np.int64)
        for trial, response, _ in self.answered:
            counts[self.labels.index(trial.correct), self.labels.index(response)] += 1
        return {"kind": "confusion", "labels": list(self.labels), "counts": counts.tolist()}
