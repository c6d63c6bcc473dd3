"""Practice trials at one level: a fixed number of them, or as many as it takes to be right often enough."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Estimate, Placement


@dataclass
class Practice:
    """Practice of at most `limit` trials at level_db_sl, without an estimate.

    correct: number of right answers among the last `window` trials that passes practice and ends it; None: it is passed
    by doing all of its trials.
    """

    level_db_sl: float
    limit: int
    frequency_hz: float | None = None
    window: int = 1
    correct: int | None = None
    outcomes: list[bool] = field(init=False, default_factory=list)

    @property
    def trials(self) -> int:
        """Return the number of trials recorded so far."""
        return len(self.outcomes)

    @property
    def passed(self) -> bool:
        """Return whether the criterion is met, or, without a criterion, whether all trials are done."""
        if self.correct is None:
            return self.trials >= self.limit
        return sum(self.outcomes[-self.window :]) >= self.correct

    @property
    def progress(self) -> float:
        """Return the share of the trials done; with a criterion, the share of the fewest trials that can meet it."""
        if self.correct is None:
            return self.trials / self.limit
        return 1.0 if self.passed else min(self.trials, self.correct) / (self.correct + 1)

    @property
    def flags(self) -> tuple[str, ...]:
        """Return no flags; practice raises none."""
        return ()

    def placement(self) -> Placement | None:
        """Return the practice level, or None once practice is passed or its trials are used up."""
        over = self.trials >= self.limit or (self.correct is not None and self.passed)
        return None if over else Placement(self.level_db_sl, self.frequency_hz)

    def record(self, correct: bool) -> None:
        """Count the outcome. Raises BadInput once practice is over."""
        if self.placement() is None:
            raise BadInput(f"the run was over after {self.trials} trials", "no further response")
        self.outcomes.append(correct)

    def estimate(self) -> Estimate | None:
        """Return None, as practice estimates no threshold."""
        return None
