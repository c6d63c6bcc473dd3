"""The plants that one controller has to hold for: every load, and every model that identification cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.model.description import Channel
from tactuator.model.plant import Load
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.systems import ContinuousSystem, SampledSystem

UNLOADED = "none"


@dataclass(frozen=True)
class Member:
    """One plant of a family: the load on it ("none", or its name), which model (0 is the nominal one), and the plant
    as the processor sees it, computing delay included."""

    load: str
    model: int
    continuous: ContinuousSystem
    sampled: SampledSystem

    @property
    def name(self) -> str:
        """Return the member's name as a person reads it: `finger`, or `finger, model 2`."""
        return self.load if self.model == 0 else f"{self.load}, model {self.model}"


def plant_family(channel: Channel, rate_hz: float, delay_samples: int) -> tuple[Member, ...]:
    """Return every model of the channel, without and under each load; the nominal unloaded plant first."""
    loads: tuple[Load | None, ...] = (None, *channel.loads)
    members = []
    for model, plant in enumerate((channel.plant, *channel.family)):
        for load in loads:
            loaded = plant if load is None else load.applied_to(plant, channel.quantity)
            sampled = zero_order_hold(loaded, rate_hz, delay_samples)
            members.append(Member(UNLOADED if load is None else load.name, model, loaded, sampled))
    return tuple(members)


_AT_ONE = 1e-9


def bears_any_lower_gain(family: Sequence[Member]) -> bool:
    """Tell whether a loop with one integrator around each plant can be stable at every lower gain, and so has to be: no
    pole lies outside the unit circle, and no two at rest. A command at its limit is a loop of lower gain.
    """
    poles = [member.sampled.poles for member in family]
    bounded = all(np.all(np.abs(of) <= 1.0 + _AT_ONE) for of in poles)
    return bounded and all(np.sum(np.abs(of - 1.0) < _AT_ONE) < 2 for of in poles)
