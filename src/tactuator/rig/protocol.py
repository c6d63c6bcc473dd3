"""What every rig can do."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from tactuator.digital.controller import Controller
from tactuator.rig.trace import Trace


@runtime_checkable
class Rig(Protocol):
    """Something that runs a controller at a fixed rate on one or more channels.

    Its state carries on from block to block: two blocks are one long block cut in two.
    """

    @property
    def rate_hz(self) -> float:
        """Sampling rate, hertz: `4000.0`."""
        ...

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels in the order of every array's columns: `("index", "thumb", "middle")`."""
        ...

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig."""
        ...

    def play(self, reference: ArrayLike) -> Trace:
        """Reference (n, channels), threshold units, through the loaded controller. BadInput if none is loaded."""
        ...

    def drive(self, command_v: ArrayLike) -> Trace:
        """Command (n, channels), volts, straight to the motors: no controller, no computing delay."""
        ...

    def rest(self) -> None:
        """Output to rest."""
        ...
