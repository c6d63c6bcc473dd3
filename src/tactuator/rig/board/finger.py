"""The finger port of a channel on a board whose display is simulated."""

from __future__ import annotations

import struct

from tactuator.errors import BadInput
from tactuator.rig.board.frames import Request
from tactuator.rig.board.link import LinkClient
from tactuator.rig.finger import Finger

SENSOR_FAULTS = ("sound", "open", "shorted", "frozen", "reversed")


class BoardFinger(Finger):
    """The finger port of one channel over the link: touched, pressed, and felt, as that of a simulated rig."""

    def __init__(self, client: LinkClient, channel: int, loads: tuple[str | None, ...]) -> None:
        super().__init__()
        self._client, self._channel, self._loads = client, channel, loads

    def touch(self, load: str | None) -> None:
        """Put a load of the display file on, by name; None takes it off."""
        if load not in self._loads:
            allowed = ", ".join(str(name) for name in self._loads)
            raise BadInput(f"load {load!r} is not described; allowed: {allowed}")
        self._client.must(Request.TOUCH, struct.pack("<BB", self._channel, self._loads.index(load)))

    def break_sensor(self, what: str) -> None:
        """Let the channel's sensor fail: "open", "shorted", "frozen", "reversed"; "sound" mends it."""
        if what not in SENSOR_FAULTS:
            raise BadInput(f"sensor fault {what!r}; allowed: {', '.join(SENSOR_FAULTS)}")
        self._client.must(Request.BREAK, struct.pack("<BB", self._channel, SENSOR_FAULTS.index(what)))
