"""The finger port of a channel on a board whose display is simulated."""

from __future__ import annotations

import math
import struct

from tactuator.errors import BadInput
from tactuator.rig.board.frames import Request
from tactuator.rig.board.link import LinkClient
from tactuator.rig.finger import Finger

SENSOR_FAULTS = (
    "sound", "open", "shorted", "frozen", "reversed", "stuck", "offset", "drift", "gain", "lag", "swapped", "bit",
    "end stop",
)  # fmt: skip
"""What may happen to a simulated sensor (core/display/sensor_fault.h)."""


class BoardFinger(Finger):
    """The finger port of one channel over the link: touched, pressed, and felt, as that of a simulated rig."""

    def __init__(self, client: LinkClient, channel: int, loads: tuple[str | None, ...]) -> None:
        super().__init__()
        self._client, self._channel, self._loads = client, channel, loads

    def touch(self, load: str | None) -> None:
        """Put a load of the display file on, by name; None takes it off."""
        if load not in self._loads:
            allowed = ", ".join(name or "none" for name in self._loads)
            raise BadInput(f"load {load!r} is not described", f"{allowed}")
        self._client.must(Request.TOUCH, struct.pack("<BB", self._channel, self._loads.index(load)))

    def break_sensor(self, what: str, value: float = math.nan) -> None:
        """Let the channel's sensor fail in one of the ways of SENSOR_FAULTS; "sound" mends it.

        value: the code about which it is "stuck", within two codes (where it is, if none is given); volts of an
        "offset"; volts a tick of a "drift"; the factor of a "gain"; ticks of a "lag"; the number of the channel that it
        is "swapped" with; the number of the "bit" that is turned over; mm of an "end stop" (not the sensor's fault).
        Raises BadInput for another fault, and where a value is missing.
        """
        if what not in SENSOR_FAULTS:
            raise BadInput(f"sensor fault {what!r}", f"{', '.join(SENSOR_FAULTS)}")
        if math.isnan(value) and what in SENSOR_FAULTS[SENSOR_FAULTS.index("offset") :]:
            raise BadInput(f"sensor fault {what!r} without a value", "a number")
        self._client.must(Request.BREAK, struct.pack("<BBf", self._channel, SENSOR_FAULTS.index(what), value))
