"""A simulated subject's finger on the display, which feels through the finger port what the loop plays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.experiment.simulated.observer import Observer
from tactuator.experiment.trial.matched_filter import amplitude
from tactuator.experiment.trial.timing import Timing
from tactuator.experiment.trial.trial import IntervalRecord, Trial, trial_rng
from tactuator.rig.touchable import TouchableRig
from tactuator.signals.decibels import db

_UM_PER_MM = 1000.0


@dataclass
class ObserverAtRig:
    """An observer whose finger is on `channel`, with that load.

    It judges each interval by the peak displacement at the stimulus's frequency, hum, noise and friction included. A
    matched filter takes it from the stretches that the records of the intervals name.
    """

    observer: Observer
    rig: TouchableRig
    channel: str
    timing: Timing
    seed: tuple[int, ...]
    load: str | None = None
    _felt: list[FloatArray] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        port = self.rig.finger(self.channel)
        port.touch(self.load)
        port.attach(self.feel)

    def feel(self, displacement_mm: FloatArray) -> None:
        """Keep the displacement of one block, shape (n,), in millimetres."""
        self._felt.append(displacement_mm)

    def levels_db_re_1um(self, frequency_hz: float, intervals: Sequence[IntervalRecord], lasted_s: float) -> FloatArray:
        """Return the level felt in each interval, shape (m,), of a trial that took the last lasted_s seconds."""
        felt, rate_hz = np.concatenate(self._felt), self.rig.rate_hz
        begins = felt.size - round(lasted_s * rate_hz)
        ramp_s, peaks_mm = self.timing.ramp_at_s(frequency_hz), []
        for one in intervals:
            assert one.onset_s is not None
            assert one.duration_s is not None
            onset = begins + round(one.onset_s * rate_hz)
            stretch = felt[onset : onset + round(one.duration_s * rate_hz)]
            peaks_mm.append(amplitude(stretch, frequency_hz, rate_hz, ramp_s))
        return db(np.maximum(np.array(peaks_mm), 1e-12) * _UM_PER_MM)

    def answer(self, trial: Trial, frequency_hz: float, intervals: Sequence[IntervalRecord], lasted_s: float) -> str:
        """Return the interval picked, as a response, and forget what was felt so far."""
        rng = trial_rng((*self.seed, 1), trial.number)
        levels = self.levels_db_re_1um(frequency_hz, intervals, lasted_s)
        self._felt.clear()
        return trial.responses[self.observer.respond(levels, frequency_hz, trial.number, rng)]

    def leave(self) -> None:
        """Take the finger off the display."""
        port = self.rig.finger(self.channel)
        port.detach(self.feel)
        port.touch(None)
