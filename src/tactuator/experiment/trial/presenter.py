"""Plays the intervals of a trial on a rig, one after the other, and reads back what the sensor saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.rig.rig import Rig
from tactuator.rig.trace import Trace

Watch = Callable[[int, bool], None]
"""Told (interval from 0, True) as an interval begins and (interval, False) as it ends."""


def _nobody(interval: int, begins: bool) -> None:
    """Nobody watches."""


@dataclass
class Presenter:
    """rig with its controller loaded; channel: the one that stimuli are played on."""

    rig: Rig
    channel: str
    watch: Watch = field(default=_nobody)

    def __post_init__(self) -> None:
        if self.channel not in self.rig.channels:
            raise BadInput(f"channel {self.channel!r} is not on the rig; allowed: {', '.join(self.rig.channels)}")

    @property
    def column(self) -> int:
        """The channel's place among the rig's."""
        return self.rig.channels.index(self.channel)

    def on_channel(self, wave: NDArray[np.float64]) -> NDArray[np.float64]:
        """A reference of every channel, (n, channels), from the wave of one, (n,)."""
        reference = np.zeros((wave.size, len(self.rig.channels)))
        reference[:, self.column] = wave
        return reference

    def present(self, references: Sequence[NDArray[np.float64]], lead_s: float, gap_s: float) -> tuple[Trace, ...]:
        """Play silence of lead_s, then every reference (n, channels) with silence of gap_s between; the traces of each.

        BadInput where a reference has other channels than the rig.
        """
        traces = []
        for interval, reference in enumerate(references):
            if reference.ndim != 2 or reference.shape[1] != len(self.rig.channels):
                raise BadInput(f"reference of shape {reference.shape}; allowed: (samples, {len(self.rig.channels)})")
            self.silence(lead_s if interval == 0 else gap_s)
            self.watch(interval, True)
            traces.append(self.rig.play(reference))
            self.watch(interval, False)
        return tuple(traces)

    def silence(self, duration_s: float) -> None:
        """Play nothing: the loop goes on holding its place."""
        count = round(duration_s * self.rig.rate_hz)
        if count:
            self.rig.play(np.zeros((count, len(self.rig.channels))))
