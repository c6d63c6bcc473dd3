"""Finger ports: the one way for a program to touch a display, press it, and feel what it does.

Every rig whose display is simulated has one for each channel (`TouchableRig`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.rig.rig import Rig

Feeler = Callable[[NDArray[np.float64]], None]


class Finger(ABC):
    """The finger port of one channel: touched by a load, pressed by a force, and felt.

    Every rig whose display is simulated has one for each channel; a rig adds how a load gets there.
    """

    def __init__(self) -> None:
        self._feelers: list[Feeler] = []
        self._pressed_v: FloatArray = np.zeros(0)

    @abstractmethod
    def touch(self, load: str | None) -> None:
        """Put a load of the display file on, by name; None takes it off. Raises BadInput for a name not described."""

    def press(self, force_v: ArrayLike) -> None:
        """Press with a force over the coming samples, shape (n,), in volts of command that would push as hard; then
        none again.

        It is added to what is still to come of earlier presses.
        """
        force = np.atleast_1d(np.asarray(force_v))
        if force.dtype.kind not in "fiub":
            raise BadInput(f"force holds {force.dtype}", "(n,), finite volts of command")
        force = force.astype(np.float64)
        if force.ndim != 1 or not np.all(np.isfinite(force)):
            raise BadInput(f"force has shape {force.shape}", "(n,), finite volts of command")
        pressed = np.zeros(max(force.size, self._pressed_v.size))
        pressed[: self._pressed_v.size] = self._pressed_v
        pressed[: force.size] += force
        self._pressed_v = pressed

    def attach(self, feeler: Feeler) -> None:
        """Call `feeler(displacement_mm)`, shape (n,), with every stretch that was played: an observer, a dial gauge."""
        self._feelers.append(feeler)

    def detach(self, feeler: Feeler) -> None:
        """Take a feeler off again. Raises BadInput if it is not attached."""
        if feeler not in self._feelers:
            raise BadInput("that feeler is not attached to this finger port", "one that is")
        self._feelers.remove(feeler)


def take_forces(fingers: Sequence[Finger], count: int) -> FloatArray | None:
    """Take the forces of the coming `count` samples, (count, fingers), so that they are over; None where nothing
    presses.
    """
    if not any(finger._pressed_v.size for finger in fingers):
        return None
    forces = np.zeros((count, len(fingers)))
    for column, finger in zip(forces.T, fingers, strict=True):
        now, finger._pressed_v = finger._pressed_v[:count], finger._pressed_v[count:]
        column[: now.size] = now
    return forces


def anybody_feels(fingers: Sequence[Finger]) -> bool:
    """Return whether a feeler is attached anywhere."""
    return any(finger._feelers for finger in fingers)


def let_feel(fingers: Sequence[Finger], displacement_mm: FloatArray) -> None:
    """Hand the displacement, (n, fingers), to every feeler; each gets an array of its own."""
    for index, finger in enumerate(fingers):
        for feeler in finger._feelers:
            feeler(displacement_mm[:, index].copy())


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
