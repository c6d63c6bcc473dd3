"""Practice: a number of trials at one level."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Estimate, Placement


@dataclass
class Fixed:
    """limit trials at level_db_sl; no estimate."""

    level_db_sl: float
    limit: int
    frequency_hz: float | None = None
    outcomes: list[bool] = field(init=False, default_factory=list)

    @property
    def trials(self) -> int:
        """Trials recorded so far."""
        return len(self.outcomes)

    @property
    def progress(self) -> float:
        """Share of the trials done."""
        return self.trials / self.limit

    @property
    def flags(self) -> tuple[str, ...]:
        """None."""
        return ()

    def placement(self) -> Placement | None:
        """The level, until all trials are done."""
        return None if self.trials >= self.limit else Placement(self.level_db_sl, self.frequency_hz)

    def record(self, correct: bool) -> None:
        """Count it."""
        if self.placement() is None:
            raise BadInput(f"the run was over after {self.trials} trials; allowed: no further response")
        self.outcomes.append(correct)

    def estimate(self) -> Estimate | None:
        """None."""
        return None
