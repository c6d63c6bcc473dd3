"""What a synthesis is asked: the plants, the limits on each of them, the band of rejection and the rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tactuator.model.requirements import FeedbackRequirements
from tactuator.synthesis.family import Member, bears_any_lower_gain
from tactuator.synthesis.limits import Limit, loop_limits


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
        limits = loop_limits(requirements, resonance_peak, bears_any_lower_gain(family))
        return cls(tuple(family), limits, requirements.rejection_band_hz, rate_hz)

    @property
    def must_bear_less(self) -> bool:
        """Tell whether a loop has to be stable at every lower gain."""
        return not all(limit.gives_way for limit in self.limits)

    def limits_at(self, share: float) -> tuple[Limit, ...]:
        """Return the limits with 1 - share of the resonance objective in reserve."""
        return tuple(
            replace(limit, asked=1.0 + share * (limit.asked - 1.0)) if limit.quantity == "resonance_peak" else limit
            for limit in self.limits
        )
