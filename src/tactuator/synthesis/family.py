"""The plants for which one controller must hold: every load, and every model that fits the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactuator.model.description import Channel
from tactuator.model.plant import Load
from tactuator.signals.discretise import discretise
from tactuator.signals.systems import ContinuousSystem, SampledSystem

UNLOADED = "none"


@dataclass(frozen=True)
class Member:
    """One plant of a family: the load on it ("none", or its name), which model (0 is the nominal one), and the plant
    as the processor sees it, computing delay included. measured: whose plant it is, where several were measured;
    variant: which of the models that fit the record."""

    load: str
    model: int
    continuous: ContinuousSystem
    sampled: SampledSystem
    measured: str = ""
    variant: int = 0

    @property
    def name(self) -> str:
        """Return the member's name as a person reads it: `finger`, `finger, model 2`, or `finger, hot, model 2`."""
        return ", ".join(filter(None, (self.load, self.measured, f"model {self.variant}" if self.variant else "")))


@lru_cache(maxsize=32)
def plant_family(channel: Channel, rate_hz: float, delay_samples: int) -> tuple[Member, ...]:
    """Return every model of the channel, without and under each load; the nominal unloaded plant first."""
    loads: tuple[Load | None, ...] = (None, *channel.loads)
    members = []
    for model, plant in enumerate((channel.plant, *channel.family)):
        name, variant = _fit(channel, model)
        for load in loads:
            loaded = channel.under(load, plant)
            sampled = discretise(loaded, rate_hz, "zoh", delay_samples)
            on = UNLOADED if load is None else load.name
            members.append(Member(on, model, loaded, sampled, name, variant))
    return tuple(members)


def _fit(channel: Channel, model: int) -> tuple[str, int]:
    """Return whose plant a model is, where several are named, and which of the fits of its record."""
    name = channel.models[model] if channel.models else ""
    return name, model - (channel.models.index(name) if channel.models else 0)


def fit_words(channel: Channel, model: int) -> str:
    """Return which of its channel's models one is, in brackets: ` (hot, fit 2 of the record)`; empty for the first."""
    name, variant = _fit(channel, model)
    words = ", ".join(filter(None, (name, f"fit {variant} of the record" if variant else "")))
    return f" ({words})" if words else ""


_AT_ONE = 1e-9
"""Distance of a root from one, or from the unit circle, that rounding explains."""


def can_be_unconditionally_stable(family: Sequence[Member]) -> bool:
    """Return whether a loop with one integrator around each plant can be stable at every lower gain, and is required to
    be: no pole outside the unit circle, at most one at z = 1. A clipped command acts like a loop of lower gain.
    """
    poles = [member.sampled.poles for member in family]
    bounded = all(np.all(np.abs(of) <= 1.0 + _AT_ONE) for of in poles)
    return bounded and all(np.sum(np.abs(of - 1.0) < _AT_ONE) < 2 for of in poles)
