"""Rigs whose finger ports a program can reach: those with a simulated display."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.rig.finger import Finger
from tactuator.rig.rig import Rig


@runtime_checkable
class TouchableRig(Rig, Protocol):
    """A rig that may have finger ports which a program can reach: those of a simulated display."""

    @property
    def has_finger_ports(self) -> bool:
        """Return True where the display is simulated; False where a finger goes onto it by hand."""
        ...

    def finger(self, channel: str) -> Finger:
        """Return the finger port of a channel. Raises BadInput where the display is real."""
        ...


def touchable(rig: Rig, name: str) -> TouchableRig:
    """Return the rig, on which a simulated subject can sit. Raises BadInput where the display is real."""
    if not isinstance(rig, TouchableRig):
        raise BadInput(f"simulated subjects at {name}", "at a rig whose display is simulated")
    for channel in rig.channels:
        rig.finger(channel)
    return rig


def usual_load(channels: Sequence[Channel]) -> str:
    """Return the load that touches where nobody names one: "finger" where every channel has it, else the first load
    that every channel has, "none" where no channel has any. Raises BadInput where the channels have none in common.
    """
    names = [[load.name for load in channel.loads] for channel in channels]
    common = [name for name in names[0] if all(name in others for others in names)]
    if not any(names):
        return "none"
    if not common:
        raise BadInput("no load is on every channel", "--load with the name of one")
    return "finger" if "finger" in common else common[0]


def touch_all(rig: Rig, channels: Sequence[Channel], load: str) -> tuple[str, ...]:
    """Put a load on every channel and return the names of the channels on which a person has to put it.

    load: the name of a load of the display file, or "none". Raises BadInput for a load that a channel does not have.
    """
    if load == "none":
        return ()
    for channel in channels:
        channel.load(load)
    if not (isinstance(rig, TouchableRig) and rig.has_finger_ports):
        return tuple(channel.name for channel in channels)
    for channel in channels:
        rig.finger(channel.name).touch(load)
    return ()
