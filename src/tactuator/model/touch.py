"""Touch: what a display does about a finger on it, and the model from which it feeds forward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tactuator.errors import BadInput

PREVIEW_MAX = 16
"""Samples from the command to the reading that the core's model can look ahead."""


@dataclass(frozen=True)
class Touch:
    """Table [touch] of a display file. adaptive: feed forward what the finger takes, learnt while it plays."""

    adaptive: bool = False


@dataclass(frozen=True)
class FeedForward:
    """Model of a channel's motor and of the finger it was designed for, and how the finger's weights are learnt.

    gain, damping, stiffness: the plant gain/(s^2 + damping s + stiffness). load: mass, damping and stiffness of the
    finger, in the plant's units. delay_samples: from a command to the reading it acts on. turns: it learns in every
    turns-th sample. corner_hz: of three poles through which it looks; slow_hz: below it is not looked at. forgetting_s:
    the shortest memory. gate_v, ridge_v: rms of the pushes (volts of command) at which the memory is twice as long, and
    at which zero weighs as much as what is heard. shape: the lean towards the designed finger's proportions.
    fading_s: the weights' decay while there is nothing to learn from. slew_s: the least time for a change of one.
    weight_max: of either weight. push_max_v: the greatest command that is fed forward. hum_hz, hum_band_hz: mains lines
    that are told from the finger, and the width of what is taken for them. mass_fed: the share of what the learnt mass
    takes that is fed forward.
    """

    gain: float
    damping: float
    stiffness: float
    load: tuple[float, float, float]
    delay_samples: int
    turns: int
    corner_hz: float
    slow_hz: float
    forgetting_s: float
    gate_v: float
    ridge_v: float
    shape: float
    fading_s: float
    slew_s: float
    weight_max: float
    push_max_v: float
    hum_hz: tuple[float, ...] = ()
    hum_band_hz: float = 0.4
    mass_fed: float = 1.0

    def __post_init__(self) -> None:
        positive = ("gain", "turns", "corner_hz", "forgetting_s", "gate_v", "ridge_v", "fading_s", "slew_s")
        for name in (*positive, "slow_hz", "shape", "weight_max", "push_max_v", "hum_band_hz", "mass_fed"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0) or (value == 0.0 and name in positive):
                least = "above zero" if name in positive else "zero or more"
                raise BadInput(f"touch: {name} is {value:g}", f"{least}")
        if not 1 <= self.delay_samples <= PREVIEW_MAX:
            raise BadInput(f"touch: delay_samples is {self.delay_samples}", f"1 to {PREVIEW_MAX}")
        if not np.all(np.isfinite([self.damping, self.stiffness, *self.load, *self.hum_hz])):
            raise BadInput("touch: a figure of the plant, the load or the hum is not finite", "finite ones")

    def document(self) -> dict[str, Any]:
        """Return the figures as a plain table."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    @classmethod
    def from_document(cls, table: Mapping[str, Any]) -> FeedForward:
        """Return the model of a plain table. Raises TypeError or ValueError for one that is not."""
        given = dict(table)
        mass, damping, stiffness = (float(value) for value in given.pop("load"))
        lines = tuple(float(value) for value in given.pop("hum_hz"))
        whole = {name: int(given.pop(name)) for name in ("delay_samples", "turns")}
        rest = {name: float(value) for name, value in given.items()}
        return cls(load=(mass, damping, stiffness), hum_hz=lines, **whole, **rest)  # type: ignore[arg-type]
