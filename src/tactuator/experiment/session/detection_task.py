"""Detection as a session's task: runs placed by a procedure, each trial a tone in one of m intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.language.words import Words, shipped_words
from tactuator.experiment.procedure.practice import Practice
from tactuator.experiment.procedure.procedure import Procedure
from tactuator.experiment.procedure.up_down import UpDown
from tactuator.experiment.protocol.plan import PlannedRun, plan_runs, run_seed
from tactuator.experiment.protocol.protocol import Protocol
from tactuator.experiment.result.tables import ResultTable, threshold_table
from tactuator.experiment.result.thresholds import thresholds
from tactuator.experiment.session.apparatus import Station
from tactuator.experiment.session.task import (
    NOTHING_DB_SL,
    SHAPE_STEP_S,
    Choice,
    Picture,
    Question,
    Rules,
    Shape,
    Stagehand,
    key_codes,
)
from tactuator.experiment.store.records import Played
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import detection_runs
from tactuator.experiment.trial.detection_run import Detection
from tactuator.experiment.trial.presenter import Presenter
from tactuator.experiment.trial.trial import BLANK, Trial
from tactuator.signals.stimuli import ramps

_TRIALS_A_REVERSAL, _TRIALS = 5.3, 80.0
"""Of the paper's procedure (facts of its simulation: 79 trials for 15 reversals); of one that says nothing."""


@dataclass(frozen=True)
class DetectionTask:
    """A detection protocol at a station. Raises BadInput where the display has no such finger, or cannot play it."""

    protocol: Protocol
    station: Station
    words: Words = field(default_factory=lambda: shipped_words("en"))

    def __post_init__(self) -> None:
        protocol, rig = self.protocol, self.station.rig
        for finger in protocol.conditions.fingers:
            low, high = self.station.channel(finger).threshold.band_hz
            for frequency in protocol.conditions.frequencies_hz:
                if not low <= frequency <= high:
                    raise BadInput(f"{frequency:g} Hz on finger {finger!r}; allowed: {low:g} to {high:g} Hz")
        if protocol.marks is not None:
            protocol.marks.build().end(rig.rate_hz, rig.channels)
        if protocol.masker is not None and protocol.masker.channel not in (None, *rig.channels):
            raise BadInput(f"masker: channel {protocol.masker.channel!r}; allowed: {', '.join(rig.channels)}")

    @property
    def question(self) -> Question:
        """One key for each interval."""
        responses = self.protocol.forced_choice().responses
        choices = tuple(Choice(response, (response,), key_codes(response)) for response in responses)
        return Question(self.words("prompt.detection"), choices, responses)

    @property
    def rules(self) -> Rules:
        """As the protocol has them."""
        session = self.protocol.session
        return Rules(
            feedback_s=self.protocol.timing.feedback_s,
            break_after_trials=session.break_after_trials,
            break_between_runs=session.break_between_runs,
            break_s=session.break_s,
            resume_within_s=session.resume_within_s,
        )

    def enrol(self, connection: Connection, study: int) -> None:
        """A detection study has nothing besides its subjects and sessions."""

    def runs(self, subject: int, visit: int = 1) -> tuple[PlannedRun, ...]:
        """Practice, then every condition in the subject's order."""
        return plan_runs(self.protocol, subject, visit, self.words)

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        """How many trials a run has, about, and how many seconds one of them plays."""
        protocol = self.protocol
        procedure = protocol.procedure.build(protocol.forced_choice(), self.station.band_hz)
        if planned.practice:
            trials = float(protocol.session.practice_trials)
        elif isinstance(procedure, UpDown):
            trials = _TRIALS_A_REVERSAL * procedure.rule.reversals
        else:
            trials = float(getattr(protocol.procedure, "trials", _TRIALS))
        timing, intervals = protocol.timing.build(), protocol.paradigm.intervals
        frequency = planned.frequency_hz or math.sqrt(self.station.band_hz[0] * self.station.band_hz[1])
        played_s = timing.lead_s + intervals * timing.duration_s(frequency) + (intervals - 1) * timing.gap_s
        marks = 0.0 if protocol.marks is None else protocol.marks.build().duration_s(intervals)
        return trials, played_s + marks + timing.feedback_s

    def course(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> DetectionCourse:
        """A fresh procedure."""
        protocol = self.protocol
        if planned.practice:
            procedure: Procedure = protocol.practice(planned.frequency_hz or 100.0)
        else:
            procedure = protocol.procedure.build(protocol.forced_choice(), self.station.band_hz)
        seed = run_seed(protocol, subject, planned.position, attempt, visit)
        return DetectionCourse(self, planned, procedure, seed)

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """The thresholds of the runs that are done."""
        found = thresholds([run for run in detection_runs(store) if run.session.id == session])
        if not found:
            raise BadInput("the session has no run that is done; allowed: results after the first")
        return (threshold_table(found),)


@dataclass
class DetectionCourse:
    """One run: its procedure, and what became of its trials."""

    task: DetectionTask
    planned: PlannedRun
    procedure: Procedure
    seed: tuple[int, ...]
    _outcomes: list[tuple[float, bool]] = field(init=False, default_factory=list)

    @property
    def trials(self) -> int:
        """Answered so far."""
        return self.procedure.trials

    @property
    def progress(self) -> float:
        """The procedure's."""
        return self.procedure.progress

    @property
    def passed(self) -> bool:
        """False for practice that has not met its criterion."""
        return not isinstance(self.procedure, Practice) or self.procedure.passed

    def trial(self) -> Trial | None:
        """The trial where the procedure puts it, at the run's frequency unless the procedure chooses that too."""
        placement = self.procedure.placement()
        if placement is None:
            return None
        if placement.frequency_hz is None:
            placement = replace(placement, frequency_hz=self.planned.frequency_hz)
        return self.task.protocol.forced_choice().trial(self.procedure.trials, placement, self.seed)

    def play(self, trial: Trial, stage: Stagehand, presented: datetime) -> Played:
        """Play the trial's intervals on the channel of the run's finger."""
        assert trial.placement is not None
        assert trial.placement.frequency_hz is not None
        frequency, protocol = trial.placement.frequency_hz, self.task.protocol
        channel = self.task.station.channel(self.planned.finger)
        marks = None if protocol.marks is None else protocol.marks.build()
        presenter = Presenter(self.task.station.rig, channel.name, stage.watch, stage.halted, marks)
        masker = None if protocol.masker is None else protocol.masker.build()
        detection = Detection(presenter, channel, protocol.timing.build(), protocol.forced_choice(), masker)
        intervals, shown = detection.play(trial, frequency, self.seed)
        level = float(channel.threshold.curve.level_db_re_1um_at(frequency))
        return Played(trial, intervals, presented, frequency, level, shown.rig_tick, shown.lasted_s)

    def shape(self, trial: Trial, interval: int) -> Shape:
        """A tone between its ramps, or nothing."""
        assert trial.placement is not None
        assert trial.placement.frequency_hz is not None
        frequency, timing = trial.placement.frequency_hz, self.task.protocol.timing.build()
        count = max(1, round(timing.duration_s(frequency) / SHAPE_STEP_S))
        if trial.stimuli[interval] == BLANK:
            return Shape((NOTHING_DB_SL,) * count, SHAPE_STEP_S, frequency)
        rise = ramps(count, 1.0 / SHAPE_STEP_S, timing.ramp_at_s(frequency))
        levels = trial.placement.level_db_sl + 20.0 * np.log10(np.maximum(rise, 1e-3))
        return Shape(tuple(np.round(levels, 1).tolist()), SHAPE_STEP_S, frequency)

    def record(self, response: str) -> None:
        """Right or wrong moves the procedure on."""
        trial = self.trial()
        if trial is None or trial.placement is None:
            raise BadInput("the run is over; allowed: a response to a trial that stands")
        correct = trial.judge(response)
        self._outcomes.append((trial.placement.level_db_sl, correct))
        self.procedure.record(correct)

    def picture(self) -> Picture:
        """Level and outcome of every trial."""
        words, about = self.task.words, {"title": self.planned.title, "trials": self.trials}
        if isinstance(self.procedure, UpDown):
            title = words("run.so_far_reversals", **about, reversals=len(self.procedure.reversal_levels))
        else:
            title = words("run.so_far", **about)
        return {
            "kind": "track",
            "title": title,
            "levels_db_sl": [level for level, _ in self._outcomes],
            "correct": [correct for _, correct in self._outcomes],
        }
