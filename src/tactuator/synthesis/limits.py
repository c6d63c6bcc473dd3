"""Limits of a loop, each with the distance of a value from it, and the task of keeping them on given plants.

Limits differ in unit. To compare them, how far off a figure is has a common scale: dB beyond the limit, where five
degrees of phase count as one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.requirements import FeedbackRequirements
from tactuator.synthesis.family import Member, can_be_unconditionally_stable

Quantity = Literal[
    "|T|", "|S|", "sensitivity_peak", "phase_margin_deg", "command_noise_gain_max", "resonance_peak", "least_gain"
]
DB = 20.0 / np.log(10.0)
"""Decibels of a change of one in a natural logarithm (8.686)."""
DEGREES_PER_DB = 5.0
"""Degrees of phase margin that count as one decibel of a peak."""
_UNITS: Mapping[Quantity, str] = {"|T|": "dB", "|S|": "dB", "phase_margin_deg": "deg"}


@dataclass(frozen=True)
class Limit:
    """A limit on one figure of a loop: a phase margin of at least `asked`, or anything else of at most that.

    asked: in `unit`. frequency_hz: the point at which |T| or |S| is limited; None: the figure is one of the whole loop.
    load: the plant of a family whose loop is meant (`Member.name`); None: every one.
    """

    quantity: Quantity
    asked: float
    frequency_hz: float | None = None
    load: str | None = None

    @property
    def unit(self) -> str:
        """Return the unit of the figure: "dB", "deg", or "1" for a ratio."""
        return _UNITS.get(self.quantity, "1")

    @property
    def relaxable(self) -> bool:
        """Return whether the limit may be loosened; stability at every lower gain may not."""
        return self.quantity != "least_gain"

    @property
    def name(self) -> str:
        """Return the limit's name as a person reads it: `sensitivity_peak`, or `|T| dB at 60 Hz`."""
        at = "" if self.frequency_hz is None else f" {self.unit} at {self.frequency_hz:g} Hz"
        return f"{self.quantity}{at}"

    def __str__(self) -> str:
        return f"{self.name} {self.asked:.4g}"

    def under(self, load: str | None) -> Limit:
        """Return the same limit for one plant of the family, or for every one (None)."""
        return replace(self, load=load)

    def excess(self, figure: FloatArray | float) -> FloatArray:
        """Return by how much figures of any shape pass the limit, in its own unit; negative where kept."""
        beyond = np.asarray(figure, dtype=np.float64) - self.asked
        return np.asarray(-beyond if self.unit == "deg" else beyond)

    def kept(self, figure: float) -> bool:
        """Return whether a value keeps the limit."""
        return not self.excess(figure) > 0.0

    def excess_db(self, figure: FloatArray | float) -> FloatArray:
        """Return by how much figures of any shape pass the limit on the common scale, dB; negative where kept."""
        if not self.relaxable:
            return np.asarray(DB * np.log1p(figure))
        if self.unit == "1":
            return np.asarray(DB * np.log(np.asarray(figure, dtype=np.float64) / self.asked))
        return self.excess(figure) / (DEGREES_PER_DB if self.unit == "deg" else 1.0)

    def figure_at(self, excess_db: float) -> float:
        """Return the figure that passes the limit by so much on the common scale."""
        if not self.relaxable:
            return float(np.expm1(excess_db / DB))
        if self.unit == "1":
            return self.asked * float(np.exp(excess_db / DB))
        return self.asked - excess_db * DEGREES_PER_DB if self.unit == "deg" else self.asked + excess_db

    def loosened(self, excess_db: float) -> Limit | None:
        """Return the limit that gives way by so much, with four digits, rounded to the looser side; None where that is
        no looser limit, or none at all.
        """
        if not self.relaxable:
            return None
        value = self.figure_at(excess_db)
        if value != 0.0:
            step = 10.0 ** (np.floor(np.log10(abs(value))) - 3.0)
            whole = np.floor(value / step) if self.unit == "deg" else np.ceil(value / step)
            value = float(f"{whole * step:.4g}")
        is_looser = 0.0 < value < self.asked if self.unit == "deg" else value > self.asked
        return replace(self, asked=value) if is_looser else None


def loop_limits(
    requirements: FeedbackRequirements, resonance_peak: float | None = None, bears_less: bool = False
) -> tuple[Limit, ...]:
    """Return the limits of a display's [feedback], then that on max|T|, if any: first the lines of |T| and of |S|.

    bears_less: the loop has to be stable at every lower gain, which is the last limit
    (`family.can_be_unconditionally_stable`).
    """
    hum = zip(requirements.mains_hz, requirements.mains_max_db, strict=True)
    rejection = zip(requirements.rejection_hz, requirements.rejection_max_db, strict=True)
    whole: dict[Quantity, float | None] = {
        "sensitivity_peak": requirements.sensitivity_peak,
        "phase_margin_deg": requirements.phase_margin_deg,
        "command_noise_gain_max": requirements.command_noise_gain_max,
        "resonance_peak": resonance_peak,
        "least_gain": 0.0 if bears_less else None,
    }
    return (
        *(Limit("|T|", level_db, frequency) for frequency, level_db in hum),
        *(Limit("|S|", level_db, frequency) for frequency, level_db in rejection),
        *(Limit(quantity, asked) for quantity, asked in whole.items() if asked is not None),
    )


@dataclass(frozen=True)
class Task:
    """Task of a synthesis: the family of plants, what the loop must keep on each of them (with a limit on max|T|), the
    band over which the mean |S| in dB is to be least, and the rate.
    """

    family: tuple[Member, ...]
    limits: tuple[Limit, ...]
    rejection_band_hz: tuple[float, float]
    rate_hz: float

    @classmethod
    def of(
        cls, family: Sequence[Member], requirements: FeedbackRequirements, rate_hz: float, resonance_peak: float
    ) -> Task:
        """Return the task of a display's [feedback] and its resonance objective."""
        limits = loop_limits(requirements, resonance_peak, can_be_unconditionally_stable(family))
        return cls(tuple(family), limits, requirements.rejection_band_hz, rate_hz)

    @property
    def requires_unconditional_stability(self) -> bool:
        """Return whether the loop must be stable at every lower gain."""
        return not all(limit.relaxable for limit in self.limits)

    def limits_at(self, share: float) -> tuple[Limit, ...]:
        """Return the limits with 1 - share of the resonance objective in reserve."""
        return tuple(
            replace(limit, asked=1.0 + share * (limit.asked - 1.0)) if limit.quantity == "resonance_peak" else limit
            for limit in self.limits
        )
