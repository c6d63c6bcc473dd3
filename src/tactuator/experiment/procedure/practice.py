"""Practice: trials at one level, so many of them or until so many are right."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Estimate, Placement


@dataclass
class Practice:
    """limit trials at level_db_sl at most; no estimate.

    correct: practice is passed, and over, once so many of the last `window` trials were right; None: it is passed by
    doing all of it.
    """

    level_db_sl: float
    limit: int
    frequency_hz: float | None = None
    window: int = 1
    correct: int | None = None
    outcomes: list[bool] = field(init=False, default_factory=list)

    @property
    def trials(self) -> int:
        """Trials recorded so far."""
        return len(self.outcomes)

    @property
    def passed(self) -> bool:
        """True once the criterion is met."""
        if self.correct is None:
            return self.trials >= self.limit
        return sum(self.outcomes[-self.window :]) >= self.correct

    @property
    def progress(self) -> float:
        """Share of the trials done; where there is a criterion, of those that it takes at least."""
        if self.correct is None:
            return self.trials / self.limit
        return 1.0 if self.passed else min(self.trials, self.correct) / (self.correct + 1)

    @property
    def flags(self) -> tuple[str, ...]:
        """None."""
        return ()

    def placement(self) -> Placement | None:
        """The level, until practice is passed or its trials are used up."""
        over = self.trials >= self.limit or (self.correct is not None and self.passed)
        return None if over else Placement(self.level_db_sl, self.frequency_hz)

    def record(self, correct: bool) -> None:
        """Count it."""
        if self.placement() is None:
            raise BadInput(f"the run was over after {self.trials} trials; allowed: no further response")
        self.outcomes.append(correct)

    def estimate(self) -> Estimate | None:
        """None."""
        return None
