"""Finger ports: the one way for a program to touch a display, press it, and feel what it does."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

Feeler = Callable[[NDArray[np.float64]], None]


class Finger:
    """The finger port of one channel: touched by a load, pressed by a force, and felt.

    Every rig whose display is simulated has one for each channel. loads: that may touch, by name, None for none of
    them; put: puts one of them on.
    """

    def __init__(self, loads: Sequence[str | None], put: Callable[[str | None], None]) -> None:
        self._loads, self._put = loads, put
        self._feelers: list[Feeler] = []
        self._pressed_v: FloatArray = np.zeros(0)

    def __repr__(self) -> str:
        loads = ", ".join(name for name in self._loads if name) or "no load"
        return f"<Finger that {loads} can touch; attached: {len(self._feelers)}>"

    def touch(self, load: str | None) -> None:
        """Put a load of the display file on, by name; None takes it off. Position and velocity go on.

        Raises BadInput for a name not described.
        """
        if load not in self._loads:
            raise BadInput(f"load {load!r} is not described", f"{', '.join(name or 'none' for name in self._loads)}")
        self._put(load)

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
