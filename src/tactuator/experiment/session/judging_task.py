"""Tasks whose trials play tones: what is played on which finger, its record and its envelope; and judging as such a
task, any of `tactuator.tasks`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.experiment.presenter import PlayedInterval, Presenter, Watch, amplitude
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import JudgingProtocol, plan_judging
from tactuator.experiment.protocol.study import PlannedRun, run_seed
from tactuator.experiment.session.task import (
    Apparatus,
    Course,
    Envelope,
    OfferedResponse,
    Question,
    Rules,
    SessionTask,
)
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import answered_runs
from tactuator.experiment.task.task_keys import JudgedTone, Judgement, Place, TaskRun
from tactuator.experiment.trial import IntervalRecord, Trial
from tactuator.experiment.words import Words, shipped_words
from tactuator.measure.error import reading_doubt_db
from tactuator.signals.decibels import db, from_db
from tactuator.signals.excitation import tone as tone_wave
from tactuator.table import ResultTable

_LEAST_PEAK_V, _HIDDEN_DB = 1e-12, 1.0
"""Least peak that is told, and what the A/D's steps may change of a reading that is told."""


@dataclass(frozen=True)
class ToneTask(SessionTask):
    """A protocol whose trials play tones, at an apparatus. Raises BadInput for marks on a channel that is not there."""

    protocol: Protocol | JudgingProtocol
    apparatus: Apparatus
    words: Words = field(default_factory=lambda: shipped_words("en"))

    def __post_init__(self) -> None:
        if self.protocol.marks is not None:
            self.protocol.marks.end(self.apparatus.rig.rate_hz, self.apparatus.rig.channels)

    def tones(self, planned: PlannedRun, trial: Trial) -> Sequence[Sequence[JudgedTone]]:
        """Return the tones of every interval; a tone of -inf dB SL is silence."""
        raise NotImplementedError

    def _expected(self, planned: PlannedRun, trials: float, intervals: int, feedback_s: float) -> tuple[float, float]:
        hertz, protocol = planned.frequency_hz or self.apparatus.middle_hz, self.protocol
        played_s = protocol.timing.played_s(hertz, intervals, protocol.marks)
        return float(protocol.session.practice_trials if planned.practice else trials), played_s + feedback_s


@dataclass
class ToneCourse(Course):
    """Course of one run whose trials play tones."""

    task: ToneTask

    def play(self, trial: Trial, watch: Watch, halted: Callable[[], bool], presented: datetime) -> PlayedTrial:
        """Play the trial's tones, each on the channel of its finger."""
        timing, apparatus = self.task.protocol.timing, self.task.apparatus
        presenter = Presenter(apparatus.rig, watch, halted, self.task.protocol.marks)
        tones = self.task.tones(self.planned, trial)
        references = [self._reference(trial, interval, of) for interval, of in enumerate(tones)]
        shown = presenter.present(references, timing.lead_s, timing.gap_s)
        records = tuple(map(self._record, trial.stimuli, tones, shown.intervals))
        hertz = None if trial.placement is None else trial.placement.frequency_hz
        curve = apparatus.channel(self.planned.finger).threshold.curve
        level = None if hertz is None else float(curve.level_db_re_1um_at(hertz))
        return PlayedTrial(trial, records, presented, hertz, level, shown.rig_tick, shown.lasted_s)

    def _reference(self, trial: Trial, interval: int, tones: Sequence[JudgedTone]) -> FloatArray:
        """Return the reference of an interval, (n, channels), threshold units."""
        timing, rig = self.task.protocol.timing, self.task.apparatus.rig
        count = max(round((tone.onset_s + tone.lasts_s(timing)) * rig.rate_hz) for tone in tones)
        reference = np.zeros((count, len(rig.channels)))
        for tone in tones:
            level, lasts_s = float(from_db(tone.level_db_sl)), tone.lasts_s(timing)
            wave = tone_wave(tone.frequency_hz, level, lasts_s, rig.rate_hz, ramp_s=tone.ramp_s(timing))
            onset = min(round(tone.onset_s * rig.rate_hz), count - wave.size)
            reference[onset : onset + wave.size, self.task.apparatus.column(tone.finger)] += wave
        return reference

    def _record(self, label: str, tones: Sequence[JudgedTone], at: PlayedInterval) -> IntervalRecord:
        """Return the interval's record; levels where it had one tone."""
        if len(tones) != 1:
            return at.record(label)
        tone, apparatus, trace = tones[0], self.task.apparatus, at.trace
        channel, column = apparatus.channel(tone.finger), apparatus.column(tone.finger)
        ramp_s = tone.ramp_s(self.task.protocol.timing)
        peak_v = amplitude(trace.position_v[:, column], tone.frequency_hz, trace.rate_hz, ramp_s)
        threshold_v = float(channel.threshold_voltage(tone.frequency_hz))
        measured = float(db(max(peak_v, _LEAST_PEAK_V) / threshold_v))
        if not np.isfinite(tone.level_db_sl):
            return at.record(label, None, measured, column)
        asked_v, hertz = np.array([threshold_v * from_db(tone.level_db_sl)]), np.array([tone.frequency_hz])
        hidden = reading_doubt_db(apparatus.controller, channel.name, hertz, asked_v)[0] > _HIDDEN_DB
        return at.record(label, tone.level_db_sl, None if hidden else measured, column)

    def shape(self, trial: Trial, interval: int) -> Envelope:
        """Return the envelope of an interval: of its strongest tone in each step."""
        tones, timing = self.task.tones(self.planned, trial)[interval], self.task.protocol.timing
        ends = [tone.onset_s + tone.lasts_s(timing) for tone in tones]
        times = np.arange(max(1, round(max(ends) / Envelope.STEP_S))) * Envelope.STEP_S
        levels = np.full(times.size, Envelope.SILENT_DB_SL)
        for tone, end_s in zip(tones, ends, strict=True):
            inside = (times >= tone.onset_s) & (times < end_s)
            levels[inside] = np.maximum(levels[inside], tone.level_db_sl)
        hertz = {tone.frequency_hz for tone in tones}
        return Envelope.of(levels, hertz.pop() if len(hertz) == 1 else None)


@dataclass(frozen=True)
class JudgingTask(ToneTask):
    """A protocol with a task at an apparatus. Raises BadInput where the display has no such finger."""

    protocol: JudgingProtocol

    def __post_init__(self) -> None:
        super().__post_init__()
        for finger in self.protocol.task.fingers_used():
            self.apparatus.channel(finger)
        for index in range(len(self.protocol.task.plans(self.words))):
            self.protocol.task.begin(index, self.place, (0,)).trial(0)

    @property
    def place(self) -> Place:
        """Return what the task's runs are played on."""
        timing = self.protocol.timing
        return Place(self.apparatus.playable(timing), timing)

    @property
    def question(self) -> Question:
        """Return the question of every trial."""
        asked = self.protocol.task.asked(self.words)
        choices = tuple(OfferedResponse(response, keys) for response, keys in asked.responses)
        return Question(asked.prompt, choices, asked.intervals)

    @property
    def rules(self) -> Rules:
        """Return the rules of a session, as the protocol has them."""
        session = self.protocol.session
        return Rules.of(session, self.protocol.timing.feedback_s if session.feedback else 0.0)

    def runs(self, subject: int, visit: int = 1) -> tuple[PlannedRun, ...]:
        """Return practice, then the runs of the task in the subject's order."""
        return plan_judging(self.protocol, self.words, subject, visit)

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        """Return the approximate number of trials of a run, and how many seconds one of them plays."""
        task = self.protocol.task
        intervals = max(len(task.asked(self.words).intervals), 1)
        return self._expected(planned, task.plans(self.words)[planned.part].trials, intervals, self.rules.feedback_s)

    def course(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> JudgingCourse:
        """Return the course of a run from its beginning."""
        seed = run_seed(self.protocol, subject, planned.position, attempt, visit)
        return JudgingCourse(self, planned, seed, self.protocol.task.begin(planned.part, self.place, seed))

    def tones(self, planned: PlannedRun, trial: Trial) -> Sequence[Sequence[JudgedTone]]:
        """Return the tones of every interval."""
        assert isinstance(trial, Judgement)
        return trial.tones

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """Return what the answers of the runs that are done come to. Raises BadInput where there is none."""
        runs = answered_runs(store, self.protocol.task.kind, session=session)
        notes = (self.words("results.simulated"),) if any(run.simulated for run in runs) else ()
        tables = self.protocol.task.results(runs, self.words)
        return tuple(replace(table, notes=(*notes, *table.notes)) for table in tables)


@dataclass
class JudgingCourse(ToneCourse):
    """Course of one run of the task's state machine."""

    task: JudgingTask
    run: TaskRun

    @property
    def _limit(self) -> float:
        return self.task.protocol.session.practice_trials if self.planned.practice else math.inf

    @property
    def progress(self) -> float:
        """Return how far the run is, from 0 to 1."""
        return min(1.0, self.trials / self._limit) if self.planned.practice else self.run.progress

    def _draw(self) -> Judgement | None:
        return None if self.trials >= self._limit else self.run.trial(self.trials)

    def _learn(self, trial: Trial, response: str, correct: bool) -> None:
        assert isinstance(trial, Judgement)
        self.run.record(trial, response)
