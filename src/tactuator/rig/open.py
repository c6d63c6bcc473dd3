"""Rigs by name: "simulated", "in-process", "board:URL", "sound:DEVICE", and those of other packages.

A rig's name, up to a colon, is an entry point of the group `tactuator.rigs`: a function of the text after the colon,
the display and a seed, which returns the rig (docs/rig.md). The project's own are in pyproject.toml.
"""

from __future__ import annotations

from tactuator.entry_points import plugin, plugins
from tactuator.errors import BadInput, unknown
from tactuator.model.description import Display
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.rig import Rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import SCHEME, InProcess, SerialPort, Transport, connect

RIGS = "tactuator.rigs"
"""The group of the entry points."""
_SERIAL_ANSWER_S = 1.0
"""A port is fast, or it is dead: half of what a network is given."""


def open_rig(spec: str, display: Display, seed: int = 0) -> Rig:
    """Return the rig of that name with `display` on it.

    spec: NAME or NAME:REST; for `board` REST is a serial port (COM3, /dev/ttyACM0) or `socket://host:port`. Raises
    BadInput for another name, or for what is missing (pyserial, PortAudio, the card),
    and DeviceFault where a port or a card cannot be opened.

    >>> with tt.open_rig("in-process", controller.display, seed=1) as board:
    ...     print(board.channels)
    ('index', 'thumb', 'middle')
    """
    name, _, rest = spec.partition(":")
    if name not in plugins(RIGS):
        raise unknown("rig", name, plugins(RIGS))
    rig = plugin(RIGS, name)(rest, display, seed)
    if not isinstance(rig, Rig):
        raise BadInput(f"rig {spec!r} is a {type(rig).__name__}", "what has all that tactuator.rig.rig.Rig asks for")
    return rig


def open_simulated(rest: str, display: Display, seed: int) -> SimulatedRig:
    """Return the simulated display as a rig; `rest` is empty."""
    _require_empty(rest, "simulated")
    return SimulatedRig(display, seed)


def open_in_process(rest: str, display: Display, seed: int) -> BoardRig:
    """Return the board in this process as a rig; `rest` is empty."""
    _require_empty(rest, "in-process")
    return in_process_rig(display, seed)


def _require_empty(rest: str, name: str) -> None:
    if rest:
        raise BadInput(f"rig {name}:{rest}", f"{name}, with nothing behind it")


def in_process_rig(display: Display, seed: int = 0) -> BoardRig:
    """Return a rig with a board's own program and link in this very process."""
    rig = BoardRig(LinkClient(InProcess()), display)
    rig.simulate(seed)
    return rig


def serial_rig(url: str, display: Display, seed: int = 0) -> BoardRig:
    """Return the rig of `display` on the board at `url`, a serial port or socket://host:port. A board whose display is
    simulated gets this one, with `seed`.
    """
    client = _at(url)
    try:
        rig = BoardRig(client, display)
        rig.off()  # a former program may have left it running
        if client.status().allows_hold:
            rig.simulate(seed)
    except BaseException:
        client.close()
        raise
    return rig


def acknowledge_faults(url: str) -> int:
    """Acknowledge the sensor and travel faults of the board at `url`; return how many there were."""
    client = _at(url)
    try:
        return client.acknowledge()
    finally:
        client.close()


def _at(url: str) -> LinkClient:
    if not url:
        raise BadInput("board: without a port", "board:PORT, a serial port or socket://host:port")
    transport: Transport = connect(url) if url.startswith(SCHEME) else SerialPort(url)
    return LinkClient(transport, _SERIAL_ANSWER_S)
