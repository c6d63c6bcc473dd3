"""Where a finger meets a channel of a board whose display is simulated."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.errors import BadInput
from tactuator.rig.frames import Request
from tactuator.rig.link import LinkClient

Feeler = Callable[[NDArray[np.float64]], None]
SENSOR_FAULTS = ("sound", "open", "shorted", "frozen", "reversed")


class BoardFinger:
    """The finger port of one channel over the link: touched, pressed, and felt, as that of a simulated rig."""

    def __init__(self, client: LinkClient, channel: int, loads: tuple[str | None, ...]) -> None:
        self._client, self._channel, self._loads = client, channel, loads
        self._feelers: list[Feeler] = []
        self._pressed_v: NDArray[np.float64] = np.zeros(0)

    def touch(self, load: str | None) -> None:
        """Put a load of the display file on, by name; None takes it off."""
        if load not in self._loads:
            allowed = ", ".join(str(name) for name in self._loads)
            raise BadInput(f"load {load!r} is not described; allowed: {allowed}")
        self._client.must(Request.TOUCH, struct.pack("<BB", self._channel, self._loads.index(load)))

    def press(self, force_v: ArrayLike) -> None:
        """A force for the coming samples, shape (n,), in volts of command; added to what is still to come."""
        force = np.atleast_1d(np.asarray(force_v, dtype=np.float64))
        if force.ndim != 1 or not np.all(np.isfinite(force)):
            raise BadInput(f"force has shape {force.shape}; allowed: (n,), finite volts of command")
        pressed = np.zeros(max(force.size, self._pressed_v.size))
        pressed[: self._pressed_v.size] = self._pressed_v
        pressed[: force.size] += force
        self._pressed_v = pressed

    def attach(self, feeler: Feeler) -> None:
        """Call `feeler(displacement_mm)`, shape (n,), with every stretch of the trace."""
        self._feelers.append(feeler)

    def detach(self, feeler: Feeler) -> None:
        """Take a feeler off again. Raises BadInput if it is not attached."""
        if feeler not in self._feelers:
            raise BadInput("that feeler is not attached to this finger port; allowed: one that is")
        self._feelers.remove(feeler)

    @property
    def is_felt(self) -> bool:
        """Whether anybody listens."""
        return bool(self._feelers)

    def break_sensor(self, what: str) -> None:
        """Let the channel's sensor fail: "open", "shorted", "frozen", "reversed"; "sound" mends it."""
        if what not in SENSOR_FAULTS:
            raise BadInput(f"sensor fault {what!r}; allowed: {', '.join(SENSOR_FAULTS)}")
        self._client.must(Request.BREAK, struct.pack("<BB", self._channel, SENSOR_FAULTS.index(what)))

    def take_force(self, count: int) -> NDArray[np.float64] | None:
        """The force of the coming `count` samples, or None where nothing presses."""
        if self._pressed_v.size == 0:
            return None
        force = np.zeros(count)
        now = self._pressed_v[:count]
        force[: now.size] = now
        self._pressed_v = self._pressed_v[count:]
        return force

    def feel(self, displacement_mm: NDArray[np.float64]) -> None:
        """Pass on what is felt."""
        for feeler in self._feelers:
            feeler(displacement_mm.copy())
