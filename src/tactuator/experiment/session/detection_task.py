"""Detection as a session's task: runs placed by a procedure, each trial a tone in one of m intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from sqlalchemy import Connection, select

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Playable, Runs
from tactuator.experiment.protocol.detection import Protocol, plan_runs
from tactuator.experiment.protocol.study import PlannedRun, run_seed
from tactuator.experiment.result.confusion import threshold_table
from tactuator.experiment.result.thresholds import thresholds
from tactuator.experiment.session.judging_task import ToneCourse, ToneTask
from tactuator.experiment.session.task import Envelope, OfferedResponse, Picture, Question, Rules
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import detection_runs
from tactuator.experiment.task.task_keys import JudgedTone
from tactuator.experiment.trial import BLANK, LOUD, SIGNAL, Timing, Trial, trial_rng
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.signals.excitation import ramps
from tactuator.signals.spectra import nearest_mains
from tactuator.table import ResultTable


def keep_off_mains(frequency_hz: float, at: Playable, timing: Timing) -> None:
    """Raise BadInput for a frequency at which hum would be felt with the stimulus, within its own bandwidth."""

    def line_near(hertz: float) -> float | None:
        line = float(nearest_mains(hertz, at.mains_hz)) if at.mains_hz else math.inf
        return line if abs(hertz - line) < timing.clearance_hz(hertz) else None

    line = line_near(frequency_hz)
    if line is not None:
        clearance, (low, high) = timing.clearance_hz(frequency_hz), at.band_hz
        sides = math.floor(10.0 * (line - clearance)) / 10.0, math.ceil(10.0 * (line + clearance)) / 10.0
        free = [f"{side:g} Hz" for side in sides if low <= side <= high and line_near(side) is None]
        raise BadInput(
            f"{frequency_hz:g} Hz is {abs(frequency_hz - line):.3g} Hz from the mains line at {line:g} Hz",
            f"{' or '.join(free) or 'one'}, {clearance:.3g} Hz away, the bandwidth of "
            f"{timing.duration_s(frequency_hz):g} s",
        )


@dataclass(frozen=True)
class DetectionTask(ToneTask):
    """A detection protocol at an apparatus. Raises BadInput where the display has no such finger, or cannot play it."""

    protocol: Protocol

    def __post_init__(self) -> None:
        super().__post_init__()
        protocol, rig = self.protocol, self.apparatus.rig
        for finger in protocol.conditions.fingers:
            low, high = self.apparatus.channel(finger).threshold.band_hz
            for frequency in protocol.conditions.frequencies_hz:
                if not low <= frequency <= high:
                    raise BadInput(f"{frequency:g} Hz on finger {finger!r}", f"{low:g} to {high:g} Hz")
        if protocol.masker is not None and protocol.masker.channel not in (None, *rig.channels):
            raise BadInput(f"masker: channel {protocol.masker.channel!r}", f"{', '.join(rig.channels)}")

    @property
    def question(self) -> Question:
        """Return the question of every trial, with one key for each interval."""
        responses = self.protocol.paradigm.responses
        choices = tuple(OfferedResponse(response, (response,)) for response in responses)
        if self.protocol.paradigm.yes_no:
            return Question(self.words("prompt.yes_no"), choices)
        return Question(self.words("prompt.detection"), choices, responses)

    @property
    def rules(self) -> Rules:
        """Return the rules of a session, as the protocol has them."""
        return Rules.of(self.protocol.session, self.protocol.timing.feedback_s)

    def enrol(self, connection: Connection, study: int) -> None:
        """Refuse a new study that would measure at the mains; one that has begun goes on, and its runs are flagged."""
        begun = select(schema.run.c.id).join(schema.session).where(schema.session.c.study_id == study).limit(1)
        if connection.execute(begun).first() is None:
            timing = self.protocol.timing
            for frequency in self.protocol.conditions.frequencies_hz:
                keep_off_mains(frequency, self.apparatus.playable(timing), timing)

    def runs(self, subject: int, visit: int = 1) -> tuple[PlannedRun, ...]:
        """Return practice, then every condition in the subject's order."""
        return plan_runs(self.protocol, subject, visit, self.words)

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        """Return the approximate number of trials of a run, and how many seconds one of them plays."""
        trials, intervals = self.protocol.procedure.typical_trials, self.protocol.paradigm.intervals
        return self._expected(planned, trials, intervals, self.rules.feedback_s)

    def course(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> DetectionCourse:
        """Return the course of a run, with a fresh procedure."""
        protocol = self.protocol
        playable = self.apparatus.playable(protocol.timing)
        procedure = protocol.practice() if planned.practice else protocol.begin(playable)
        seed = run_seed(protocol, subject, planned.position, attempt, visit)
        return DetectionCourse(self, planned, seed, procedure)

    def tones(self, planned: PlannedRun, trial: Trial) -> Sequence[Sequence[JudgedTone]]:
        """Return the tone of every interval, of -inf dB SL where nothing is played."""
        at = trial.placement
        assert at is not None
        assert at.frequency_hz is not None
        levels = [-math.inf if label == BLANK else at.level_db_sl for label in trial.stimuli]
        return [
            (JudgedTone(label, planned.finger, at.frequency_hz, level),)
            for label, level in zip(trial.stimuli, levels, strict=True)
        ]

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """Return the thresholds of the runs that are done. Raises BadInput where there is none."""
        return (threshold_table(thresholds(detection_runs(store, session=session)), self.words),)


@dataclass
class DetectionCourse(ToneCourse):
    """Course of one run, placed by its procedure: each trial's frequency is the run's unless that chooses it too."""

    task: DetectionTask
    procedure: Runs

    @property
    def progress(self) -> float:
        """Return the progress of the procedure."""
        return self.procedure.progress()

    @property
    def passed(self) -> bool:
        """Return False for practice that has not met its criterion, True otherwise."""
        return self.procedure.passed

    def _draw(self) -> Trial | None:
        placement = self.procedure.placement()
        if placement is None:
            return None
        if placement.frequency_hz is None:
            placement = replace(placement, frequency_hz=self.planned.frequency_hz)
        label = self._label()
        if label == LOUD:
            louder = placement.level_db_sl + self.task.protocol.catch.above_db
            placement = replace(placement, level_db_sl=min(louder, COMFORT_DB_SL))
        return self.task.protocol.paradigm.trial(self.trials, placement, self.seed, label)

    def _label(self) -> str:
        """Return the kind of the trial that stands: the procedure's, or a catch trial by the lot of its number."""
        catch = self.task.protocol.catch
        if self.planned.practice:
            return SIGNAL
        lot = float(trial_rng((*self.seed, 9), self.trials).random())
        return LOUD if lot < catch.loud_share else BLANK if lot < catch.loud_share + catch.blank_share else SIGNAL

    def _reference(self, trial: Trial, interval: int, tones: Sequence[JudgedTone]) -> FloatArray:
        reference, masker = super()._reference(trial, interval, tones), self.task.protocol.masker
        if masker is not None:
            rng, rig = trial_rng((*self.seed, 2, interval), trial.number), self.task.apparatus.rig
            ramp_s = tones[0].ramp_s(self.task.protocol.timing)
            channel = masker.channel or self.task.apparatus.channel(self.planned.finger).name
            reference[:, rig.channels.index(channel)] += masker.wave(len(reference), rig.rate_hz, ramp_s, rng)
        return reference

    def shape(self, trial: Trial, interval: int) -> Envelope:
        """Return the envelope of an interval: a tone between its ramps, or nothing."""
        (tone,), timing = self.task.tones(self.planned, trial)[interval], self.task.protocol.timing
        count = max(1, round(tone.lasts_s(timing) / Envelope.STEP_S))
        rise = ramps(count, 1.0 / Envelope.STEP_S, tone.ramp_s(timing))
        levels = tone.level_db_sl + 20.0 * np.log10(np.maximum(rise, 1e-3))
        silent = trial.stimuli[interval] == BLANK
        return Envelope.of(np.full(count, Envelope.SILENT_DB_SL) if silent else levels, tone.frequency_hz)

    def _learn(self, trial: Trial, response: str, correct: bool) -> None:
        if SIGNAL in trial.stimuli:
            self.procedure.record(correct)

    def picture(self) -> Picture:
        """Return the level and outcome of every trial, or what else the procedure draws."""
        return {**super().picture(), **self.procedure.picture()}
