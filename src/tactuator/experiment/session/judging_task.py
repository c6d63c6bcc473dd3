"""Judging as a session's task: any task of `tactuator.tasks`, its tones on the fingers of the display."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from sqlalchemy import Connection

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.presenter import PlayedInterval, Presenter, Watch, amplitude
from tactuator.experiment.protocol.file import JudgingProtocol, plan_judging
from tactuator.experiment.protocol.study import PlannedRun, run_seed
from tactuator.experiment.session.task import Apparatus, Envelope, OfferedResponse, Picture, Question, Rules, track
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import answered_runs
from tactuator.experiment.task.task_keys import JudgedTone, Judgement, Place, TaskRun
from tactuator.experiment.trial import IntervalRecord, Timing, Trial
from tactuator.experiment.words import Words, shipped_words
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import db, from_db
from tactuator.signals.excitation import tone as tone_wave
from tactuator.table import ResultTable

_LEAST_PEAK_V = 1e-12


@dataclass(frozen=True)
class JudgingTask:
    """A protocol with a task at an apparatus. Raises BadInput where the display has no such finger."""

    protocol: JudgingProtocol
    apparatus: Apparatus
    words: Words = field(default_factory=lambda: shipped_words("en"))

    def __post_init__(self) -> None:
        for finger in self.protocol.task.fingers_used():
            self.apparatus.channel(finger)
        for index in range(len(self.protocol.task.plans(self.words))):
            self.protocol.task.begin(index, self.place, (0,)).trial(0)
        if self.protocol.marks is not None:
            self.protocol.marks.end(self.apparatus.rig.rate_hz, self.apparatus.rig.channels)

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

    def enrol(self, connection: Connection, study: int) -> None:
        """Store nothing besides the sessions."""

    def runs(self, subject: int, visit: int = 1) -> tuple[PlannedRun, ...]:
        """Return practice, then the runs of the task in the subject's order."""
        return plan_judging(self.protocol, self.words, subject, visit)

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        """Return the approximate number of trials of a run, and how many seconds one of them plays."""
        protocol = self.protocol
        plan = protocol.task.plans(self.words)[planned.part]
        trials = protocol.session.practice_trials if planned.practice else plan.trials
        intervals = max(len(protocol.task.asked(self.words).intervals), 1)
        hertz = planned.frequency_hz or self.apparatus.middle_hz
        played_s = protocol.timing.played_s(hertz, intervals, protocol.marks)
        return float(trials), played_s + self.rules.feedback_s

    def course(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> JudgingCourse:
        """Return the course of a run from its beginning."""
        seed = run_seed(self.protocol, subject, planned.position, attempt, visit)
        return JudgingCourse(self, planned, self.protocol.task.begin(planned.part, self.place, seed), seed)

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """Return what the answers of the runs that are done come to. Raises BadInput where there is none."""
        runs = answered_runs(store, self.protocol.task.kind, session=session)
        notes = (self.words("results.simulated"),) if any(run.simulated for run in runs) else ()
        tables = self.protocol.task.results(runs, self.words)
        return tuple(replace(table, notes=(*notes, *table.notes)) for table in tables)


@dataclass
class JudgingCourse:
    """Course of one run: the task's state machine, and the level and outcome of its trials."""

    task: JudgingTask
    planned: PlannedRun
    run: TaskRun
    seed: tuple[int, ...]
    _outcomes: list[tuple[float, bool]] = field(init=False, default_factory=list)
    _standing: tuple[int, Judgement | None] = field(init=False, default=(-1, None))

    @property
    def trials(self) -> int:
        """Return the number of trials answered so far."""
        return len(self._outcomes)

    @property
    def _limit(self) -> float:
        return self.task.protocol.session.practice_trials if self.planned.practice else math.inf

    @property
    def progress(self) -> float:
        """Return how far the run is, from 0 to 1."""
        return min(1.0, self.trials / self._limit) if self.planned.practice else self.run.progress

    @property
    def passed(self) -> bool:
        """Return True: practice has no criterion."""
        return True

    def trial(self) -> Judgement | None:
        """Return the trial that stands, or None when the run is over. It is drawn once for each answer."""
        if self._standing[0] != self.trials:
            over = self.trials >= self._limit
            self._standing = (self.trials, None if over else self.run.trial(self.trials))
        return self._standing[1]

    def play(self, trial: Trial, watch: Watch, halted: Callable[[], bool], presented: datetime) -> PlayedTrial:
        """Play the trial's tones, each on the channel of its finger."""
        assert isinstance(trial, Judgement)
        timing, rig = self.task.protocol.timing, self.task.apparatus.rig
        presenter = Presenter(rig, rig.channels[0], watch, halted, self.task.protocol.marks)
        references = [self._reference(tones, rig, timing) for tones in trial.tones]
        shown = presenter.present(references, timing.lead_s, timing.gap_s)
        records = tuple(
            self._record(label, tones, at)
            for label, tones, at in zip(trial.stimuli, trial.tones, shown.intervals, strict=True)
        )
        hertz = None if trial.placement is None else trial.placement.frequency_hz
        curve = self.task.apparatus.channel(self.planned.finger).threshold.curve
        level = None if hertz is None else float(curve.level_db_re_1um_at(hertz))
        return PlayedTrial(trial, records, presented, hertz, level, shown.rig_tick, shown.lasted_s)

    def _reference(self, tones: tuple[JudgedTone, ...], rig: Rig, timing: Timing) -> FloatArray:
        """Return the reference of an interval, (n, channels), threshold units."""
        count = max(round((tone.onset_s + tone.lasts_s(timing)) * rig.rate_hz) for tone in tones)
        reference = np.zeros((count, len(rig.channels)))
        for tone in tones:
            column = rig.channels.index(self.task.apparatus.channel(tone.finger).name)
            amplitude_tu = float(from_db(tone.level_db_sl))
            wave = tone_wave(
                tone.frequency_hz, amplitude_tu, tone.lasts_s(timing), rig.rate_hz, ramp_s=tone.ramp_s(timing)
            )
            onset = min(round(tone.onset_s * rig.rate_hz), count - wave.size)
            reference[onset : onset + wave.size, column] += wave
        return reference

    def _record(self, label: str, tones: tuple[JudgedTone, ...], at: PlayedInterval) -> IntervalRecord:
        """Return the interval's record; levels where it had one tone."""
        times = (at.onset_s, at.duration_s, at.lamp_late_s)
        if len(tones) != 1:
            return IntervalRecord(label, None, None, bool(at.trace.saturated.any()), *times)
        tone, apparatus = tones[0], self.task.apparatus
        channel = apparatus.channel(tone.finger)
        column = apparatus.rig.channels.index(channel.name)
        ramp_s = tone.ramp_s(self.task.protocol.timing)
        peak_v = amplitude(at.trace.position_v[:, column], tone.frequency_hz, at.trace.rate_hz, ramp_s)
        measured = float(db(max(peak_v, _LEAST_PEAK_V) / float(channel.threshold_voltage(tone.frequency_hz))))
        return IntervalRecord(label, tone.level_db_sl, measured, bool(at.trace.saturated[:, column].any()), *times)

    def shape(self, trial: Trial, interval: int) -> Envelope:
        """Return the envelope of an interval: of its strongest tone in each step."""
        assert isinstance(trial, Judgement)
        tones, timing = trial.tones[interval], self.task.protocol.timing
        ends = [tone.onset_s + tone.lasts_s(timing) for tone in tones]
        times = np.arange(max(1, round(max(ends) / Envelope.STEP_S))) * Envelope.STEP_S
        levels = np.full(times.size, Envelope.SILENT_DB_SL)
        for tone, end_s in zip(tones, ends, strict=True):
            inside = (times >= tone.onset_s) & (times < end_s)
            levels[inside] = np.maximum(levels[inside], tone.level_db_sl)
        hertz = {tone.frequency_hz for tone in tones}
        return Envelope.of(levels, hertz.pop() if len(hertz) == 1 else None)

    def record(self, response: str) -> None:
        """Record the response to the trial that stands. Raises BadInput when the run is over, or for no response."""
        trial = self.trial()
        if trial is None:
            raise BadInput("the run is over", "a response to a trial that stands")
        yes = trial.judge(response)
        self._outcomes.append((0.0 if trial.placement is None else trial.placement.level_db_sl, yes))
        self.run.record(trial, response)

    def picture(self) -> Picture:
        """Return the level and outcome of every trial."""
        return track(self.task.words("run.so_far", title=self.planned.title, trials=self.trials), self._outcomes)
