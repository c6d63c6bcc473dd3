"""The command `acknowledge`: unlock a board after sensor faults."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from tactuator.api.option import Option
from tactuator.errors import BadInput
from tactuator.result import Fact, Result
from tactuator.rig.open import acknowledge_faults


@dataclass(frozen=True, eq=False, repr=False)
class AcknowledgedResult(Result):
    """Faults of a board that were acknowledged."""

    rig: str
    sensor_faults: int

    def facts(self) -> Sequence[Fact]:
        return [
            Fact("rig", self.rig, "board", summary=True),
            Fact("sensor_faults", self.sensor_faults, "sensor and travel faults acknowledged", summary=True),
        ]


def acknowledge(rig: Annotated[str, Option("The board: board:PORT or board:URL.")]) -> AcknowledgedResult:
    """Tell a board that its sensor faults are known. After three of them it stays off until then."""
    if not rig.startswith("board:"):
        raise BadInput(f"rig {rig!r} is no connected board", "board:PORT or board:URL")
    return AcknowledgedResult(rig, acknowledge_faults(rig.removeprefix("board:")))
