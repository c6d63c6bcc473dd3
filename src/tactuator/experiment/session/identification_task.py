"""Identification as a session's task: blocks of trials, each answered with the label of what was felt, or A or B."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.protocol.identification import IdentificationProtocol
from tactuator.experiment.protocol.plan import PlannedRun
from tactuator.experiment.result.confusion import session_results
from tactuator.experiment.result.tables import ResultTable, abx_table, information_table, matrix_table
from tactuator.experiment.session.apparatus import Station
from tactuator.experiment.session.identification_items import LoadedItem, keep_items, load_items
from tactuator.experiment.session.identification_plan import ABX_RESPONSES, block_seed, block_trials, plan_blocks
from tactuator.experiment.session.task import Choice, Picture, Question, Rules
from tactuator.experiment.store.records import Played
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial.presenter import Presenter, Watch
from tactuator.experiment.trial.trial import IntervalRecord, Trial

_PROMPTS = {
    "identification": "Which one was it?",
    "middle-of-three": "Which one was in the middle?",
    "abx": "Was X like A or like B?",
}


@dataclass(frozen=True)
class IdentificationTask:
    """An identification protocol with its items, at a station."""

    protocol: IdentificationProtocol
    items: Mapping[str, LoadedItem]
    station: Station

    @classmethod
    def load(cls, protocol: IdentificationProtocol, beside: Path, station: Station) -> IdentificationTask:
        """The task with its items read, whose files lie in `beside`. Raises BadInput as `load_items` does."""
        return cls(protocol, load_items(protocol, beside, station.rig), station)

    @property
    def question(self) -> Question:
        """Labels with the protocol's keys; A, B and X are told apart as they play, other items are not."""
        paradigm = self.protocol.identification.paradigm
        if paradigm == "abx":
            pairs = zip(ABX_RESPONSES, "12", strict=True)
            choices = tuple(Choice(name, (name.lower(), name, digit)) for name, digit in pairs)
            return Question(_PROMPTS[paradigm], choices, (*ABX_RESPONSES, "X"))
        return Question(_PROMPTS[paradigm], tuple(Choice(item.label, (item.key,)) for item in self.protocol.item))

    @property
    def rules(self) -> Rules:
        """As the protocol has them; a block that was interrupted goes on, however long ago."""
        session = self.protocol.session
        return Rules(
            feedback_s=self.protocol.identification.feedback_s,
            break_after_trials=session.break_after_trials,
            break_between_runs=session.break_between_blocks,
            break_s=session.break_s,
        )

    def enrol(self, connection: Connection, study: int) -> None:
        """Keep the items; BadInput where they are not those that the study began with."""
        keep_items(connection, study, self.protocol, self.items)

    def runs(self, subject: int) -> tuple[PlannedRun, ...]:
        """Every block."""
        return plan_blocks(self.protocol)

    def course(self, planned: PlannedRun, subject: int, attempt: int) -> BlockCourse:
        """A block from its first trial."""
        seed = block_seed(self.protocol, subject, planned.position)
        return BlockCourse(self, planned, block_trials(self.protocol, subject, planned.position), seed)

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """Confusion matrix and information transfer of the test blocks; of ABX, the share of right answers."""
        rng = np.random.default_rng(self.protocol.study.seed)
        matrices, abx = session_results(store, self.protocol, session, rng)
        if not matrices and not abx:
            raise BadInput("the session's test blocks have no answers yet; allowed: results after some")
        tables = [(matrix_table(one), information_table("Information transfer", one.information)) for one in matrices]
        return (*(table for pair in tables for table in pair), *map(abx_table, abx))

    def play(self, trial: Trial, watch: Watch) -> tuple[IntervalRecord, ...]:
        """Play the items of a trial on every channel.

        A trial always takes as long as the longest items would, and in ABX so does each of its intervals: how long
        something takes on the subject's page says nothing of what it was.
        """
        asking, rig = self.protocol.identification, self.station.rig
        longest = max(len(item.reference) for item in self.items.values())
        references = [self.items[label].reference for label in trial.stimuli]
        if asking.paradigm == "abx":
            references = [_filled(reference, longest) for reference in references]
        presenter = Presenter(rig, rig.channels[0], watch)
        traces = presenter.present(references, asking.lead_s, asking.gap_s)
        left = longest * len(references) - sum(len(reference) for reference in references)
        presenter.silence(left / rig.rate_hz)
        return tuple(
            IntervalRecord(label, None, None, bool(trace.saturated.any()))
            for label, trace in zip(trial.stimuli, traces, strict=True)
        )


def _filled(reference: NDArray[np.float64], length: int) -> NDArray[np.float64]:
    return np.concatenate([reference, np.zeros((length - len(reference), reference.shape[1]))])


@dataclass
class BlockCourse:
    """One block: its trials, and the responses to those that are answered."""

    task: IdentificationTask
    planned: PlannedRun
    planned_trials: tuple[Trial, ...]
    seed: tuple[int, ...]
    _responses: list[str] = field(init=False, default_factory=list)

    @property
    def trials(self) -> int:
        """Answered so far."""
        return len(self._responses)

    @property
    def progress(self) -> float:
        """Share of the block's trials."""
        return self.trials / len(self.planned_trials)

    def trial(self) -> Trial | None:
        """The next that is planned."""
        return None if self.trials == len(self.planned_trials) else self.planned_trials[self.trials]

    def play(self, trial: Trial, watch: Watch, presented: datetime) -> Played:
        """Play the trial's items."""
        return Played(trial, self.task.play(trial, watch), presented)

    def record(self, response: str) -> None:
        """Keep the response to the trial that stands."""
        trial = self.trial()
        if trial is None:
            raise BadInput("the block is over; allowed: a response to a trial that stands")
        trial.judge(response)
        self._responses.append(response)

    def picture(self) -> Picture:
        """The block's confusion matrix so far."""
        labels = [choice.response for choice in self.task.question.choices]
        counts = np.zeros((len(labels), len(labels)), dtype=np.int64)
        for trial, response in zip(self.planned_trials, self._responses, strict=False):
            counts[labels.index(trial.correct), labels.index(response)] += 1
        title = f"{self.planned.title}, {self.trials} of {len(self.planned_trials)} trials"
        return {"kind": "confusion", "title": title, "labels": labels, "counts": counts.tolist()}
