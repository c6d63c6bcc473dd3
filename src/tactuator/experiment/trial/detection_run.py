"""A detection run: trials placed by a procedure, played on a rig, answered by a subject."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.procedure import Estimate, Procedure
from tactuator.experiment.procedure.refit import Refit, RefitPrior, refit
from tactuator.experiment.trial.matched_filter import amplitude
from tactuator.experiment.trial.presenter import PlayedInterval, Presentation, Presenter
from tactuator.experiment.trial.stimulus import Masker, ToneInterval
from tactuator.experiment.trial.timing import Timing
from tactuator.experiment.trial.trial import ForcedChoice, IntervalRecord, Trial, trial_rng
from tactuator.model.description import Channel
from tactuator.signals.decibels import db


class Subject(Protocol):
    """Someone who answers detection trials."""

    def answer(self, trial: Trial, frequency_hz: float, intervals: Sequence[IntervalRecord], lasted_s: float) -> str:
        """Return the response to the trial that was just played; intervals: when each was in its lasted_s seconds."""
        ...


@dataclass(frozen=True)
class TrialRecord:
    """A trial with its intervals as they were played and its answer."""

    trial: Trial
    frequency_hz: float
    response: str
    correct: bool
    intervals: tuple[IntervalRecord, ...]


@dataclass(frozen=True)
class Detection:
    """Settings of detection trials on one channel, and the presenter that plays them.

    channel: the display's description of the channel that the presenter plays on.
    """

    presenter: Presenter
    channel: Channel
    timing: Timing = field(default_factory=Timing)
    paradigm: ForcedChoice = field(default_factory=ForcedChoice)
    masker: Masker | None = None

    def play(
        self, trial: Trial, frequency_hz: float, seed: Sequence[int]
    ) -> tuple[tuple[IntervalRecord, ...], Presentation]:
        """Play a trial, and return the records of its intervals and the presentation."""
        tones = self.paradigm.tones(trial, frequency_hz)
        references = [
            self._reference(tone, trial_rng((*seed, 2, index), trial.number)) for index, tone in enumerate(tones)
        ]
        shown = self.presenter.present(references, self.timing.lead_s, self.timing.gap_s)
        records = tuple(
            self._record(label, tone, played)
            for label, tone, played in zip(trial.stimuli, tones, shown.intervals, strict=True)
        )
        return records, shown

    def _reference(self, tone: ToneInterval, rng: np.random.Generator) -> FloatArray:
        rate_hz = self.presenter.rig.rate_hz
        reference = self.presenter.on_channel(tone.wave(rate_hz, self.timing))
        if self.masker is not None:
            channel = self.masker.channel or self.presenter.channel
            ramp_s = self.timing.ramp_at_s(tone.frequency_hz)
            column = self.presenter.rig.channels.index(channel)
            reference[:, column] += self.masker.wave(len(reference), rate_hz, ramp_s, rng)
        return reference

    def _record(self, label: str, tone: ToneInterval, played: PlayedInterval) -> IntervalRecord:
        column, trace = self.presenter.column, played.trace
        ramp_s = self.timing.ramp_at_s(tone.frequency_hz)
        peak_v = amplitude(trace.position_v[:, column], tone.frequency_hz, trace.rate_hz, ramp_s)
        unit_v = float(self.channel.threshold_voltage(tone.frequency_hz))
        measured = float(db(max(peak_v, 1e-12) / unit_v))
        return IntervalRecord(
            label,
            tone.level_db_sl,
            measured,
            bool(trace.saturated[:, column].any()),
            played.onset_s,
            played.duration_s,
            played.lamp_late_s,
        )


@dataclass(frozen=True)
class RunRecord:
    """A run that is over.

    estimate: the procedure's own, dB SL commanded. flags: names of what a reader must know of the run.
    """

    frequency_hz: float
    trials: tuple[TrialRecord, ...]
    estimate: Estimate | None
    flags: tuple[str, ...]

    @property
    def levels_db_sl(self) -> FloatArray:
        """Return the commanded level of every trial, shape (trials,)."""
        return np.array([one.trial.placement.level_db_sl for one in self.trials if one.trial.placement is not None])

    @property
    def correct(self) -> NDArray[np.bool_]:
        """Return the outcome of every trial, shape (trials,)."""
        return np.array([one.correct for one in self.trials], dtype=np.bool_)

    def refit(self, prior: RefitPrior | None = None) -> Refit:
        """Return the Bayesian refit of the run's trials."""
        return refit(self.levels_db_sl, self.correct, prior)


def run_detection(
    detection: Detection, procedure: Procedure, subject: Subject, frequency_hz: float, seed: Sequence[int]
) -> RunRecord:
    """Run trials until the procedure ends.

    frequency_hz: of every trial, unless the procedure chooses frequencies itself. seed: determines every trial.
    """
    records: list[TrialRecord] = []
    while (placement := procedure.placement()) is not None:
        frequency = frequency_hz if placement.frequency_hz is None else placement.frequency_hz
        trial = detection.paradigm.trial(len(records), placement, seed)
        intervals, shown = detection.play(trial, frequency, seed)
        response = subject.answer(trial, frequency, intervals, shown.lasted_s)
        correct = trial.judge(response)
        procedure.record(correct)
        records.append(TrialRecord(trial, frequency, response, correct, intervals))
    return RunRecord(frequency_hz, tuple(records), procedure.estimate(), procedure.flags)
