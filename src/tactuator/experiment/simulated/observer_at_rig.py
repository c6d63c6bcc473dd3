"""A simulated subject's finger on the display: it feels what the loop makes of the stimulus, by the finger port."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactuator.experiment.simulated.observer import Observer
from tactuator.experiment.trial.matched_filter import amplitude
from tactuator.experiment.trial.timing import Timing
from tactuator.experiment.trial.trial import Trial, trial_rng
from tactuator.rig.touchable import TouchableRig
from tactuator.signals.decibels import db

_UM_PER_MM = 1000.0


@dataclass
class ObserverAtRig:
    """An observer whose finger is on `channel`.

    It judges each interval by the peak displacement at the stimulus's frequency, drawn out by a matched filter, hum and
    noise and friction included: the displacement of blocks played while an interval is on.
    """

    observer: Observer
    rig: TouchableRig
    channel: str
    timing: Timing
    seed: tuple[int, ...]
    load: str | None = None
    _felt: dict[int, list[NDArray[np.float64]]] = field(init=False, default_factory=dict)
    _interval: int | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        port = self.rig.finger(self.channel)
        port.touch(self.load)
        port.attach(self.feel)

    def feel(self, displacement_mm: NDArray[np.float64]) -> None:
        """Displacement of one block, shape (n,)."""
        if self._interval is not None:
            self._felt[self._interval].append(displacement_mm)

    def begins(self, interval: int, begins: bool) -> None:
        """Attend to an interval, or to none."""
        self._interval = interval if begins else None
        if begins:
            if interval == 0:
                self._felt.clear()
            self._felt[interval] = []

    def levels_db_re_1um(self, frequency_hz: float) -> NDArray[np.float64]:
        """Level felt in each interval, shape (m,)."""
        ramp_s = self.timing.ramp_at_s(frequency_hz)
        peaks_mm = [
            amplitude(np.concatenate(blocks), frequency_hz, self.rig.rate_hz, ramp_s) for blocks in self._felt.values()
        ]
        return db(np.maximum(np.array(peaks_mm), 1e-12) * _UM_PER_MM)

    def answer(self, trial: Trial, frequency_hz: float) -> str:
        """The interval picked, as a response."""
        rng = trial_rng((*self.seed, 1), trial.number)
        picked = self.observer.respond(self.levels_db_re_1um(frequency_hz), frequency_hz, trial.number, rng)
        return trial.responses[picked]

    def leave(self) -> None:
        """Take the finger off."""
        port = self.rig.finger(self.channel)
        port.detach(self.feel)
        port.touch(None)
