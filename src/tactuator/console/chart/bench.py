"""A channel on the console's bench: its plants, computed once, ready for one controller after another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.console.chart.transient import padded, states_of
from tactuator.model.description import Channel, Display
from tactuator.synthesis.family import Member, plant_family

_POINTS = 240
_AROUND = 17
_INSTANTS = 320
_STEP_S = 0.4


@dataclass(frozen=True)
class Bench:
    """Channel, family (the nominal plant first), frequencies (n,) in hertz, responses of the plants (members, n), and
    their states; every `stride`-th sample of a step is shown."""

    display: Display
    channel: Channel
    family: tuple[Member, ...]
    frequency_hz: FloatArray
    plants: ComplexArray
    states: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    stride: int

    @property
    def time_s(self) -> FloatArray:
        """Return the instants at which steps are shown, seconds."""
        return np.arange(_INSTANTS) * self.stride / self.display.rate_hz

    @property
    def shown(self) -> tuple[int, ...]:
        """Return the places of the members that have a curve of their own: the nominal model under every load."""
        return tuple(place for place, member in enumerate(self.family) if member.model == 0)


def bench(display: Display, channel: Channel) -> Bench:
    """Return the bench of one channel of a display."""
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    frequency = _grid_hz(display, channel, family)
    plants = np.array([member.sampled.response(frequency) for member in family])
    stride = max(1, round(_STEP_S * display.rate_hz / _INSTANTS))
    states = padded([states_of(member.sampled) for member in family])
    return Bench(display, channel, family, frequency, plants, states, stride)


def _grid_hz(display: Display, channel: Channel, family: tuple[Member, ...]) -> FloatArray:
    """Return frequencies up to half the rate, those of the limits among them, dense around light damping."""
    low = min(channel.threshold.band_hz[0], channel.feedback.rejection_band_hz[0]) / 2.0
    high = 0.499 * display.rate_hz
    asked = channel.feedback
    parts = [np.geomspace(low, high, _POINTS), np.array([*asked.rejection_hz, *asked.mains_hz])]
    for root in np.concatenate([np.append(member.continuous.poles, member.continuous.zeros) for member in family]):
        if root.imag > 3.0 * abs(root.real) > 0.0:
            parts.append((root.imag + abs(root.real) * np.linspace(-3.0, 3.0, _AROUND)) / (2.0 * np.pi))
    grid = np.unique(np.concatenate(parts))
    return np.asarray(grid[(grid >= low) & (grid <= high)])
