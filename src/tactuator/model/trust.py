"""What a model is trusted by: numbers, each with its limit and what it decides."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from tactuator.parameters import Flag, Number, table

Decides = Literal["refuses trust", "narrows the valid range", "cannot tell"]


@table("trust")
class Weighed:
    """A number by which a model is judged. name, value, unit; limit: the most that is allowed, or the least where
    `least`; decides: what follows where the value is beyond its limit; where: the place or record it speaks of.
    """

    name: str
    value: Number
    unit: str
    limit: Number
    decides: Decides
    least: Flag = False
    where: str = ""

    @property
    def beyond(self) -> bool:
        """Return true where the value is not within its limit."""
        return self.value < self.limit if self.least else self.value > self.limit

    @property
    def refuses(self) -> bool:
        """Return true where the model is not to be trusted for this."""
        return self.beyond and self.decides == "refuses trust"

    @property
    def leaves_open(self) -> bool:
        """Return true where the record cannot tell for this."""
        return self.beyond and self.decides == "cannot tell"

    @property
    def measured(self) -> str:
        """Return the value with its unit."""
        return f"{self.value:.4g} {self.unit}".strip()

    @property
    def allowed(self) -> str:
        """Return the limit in words."""
        return f"{'at least' if self.least else 'at most'} {self.limit:g} {self.unit}".strip()

    def __str__(self) -> str:
        place = f", {self.where}" if self.where else ""
        return f"{self.name}{place}: {self.measured} ({self.allowed})"


def reasons(weighed: Iterable[Weighed]) -> tuple[str, ...]:
    """Return why a model is not to be trusted, empty if it is."""
    return tuple(str(row) for row in weighed if row.refuses)
