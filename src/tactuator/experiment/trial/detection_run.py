"""Detection trials played on one channel of a rig, with what its sensor saw of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.experiment.trial.matched_filter import amplitude
from tactuator.experiment.trial.presenter import PlayedInterval, Presentation, Presenter
from tactuator.experiment.trial.stimulus import Masker, ToneInterval
from tactuator.experiment.trial.timing import Timing
from tactuator.experiment.trial.trial import ForcedChoice, IntervalRecord, Trial, trial_rng
from tactuator.model.description import Channel
from tactuator.signals.decibels import db


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
