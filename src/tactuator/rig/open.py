"""Rigs by name: "simulated", "emulated:mps2-an500", "board:URL", "sound:DEVICE"."""

from __future__ import annotations

from tactuator.errors import BadInput
from tactuator.model.description import Display
from tactuator.rig.board_rigs import emulated_rig, in_process_rig, serial_rig
from tactuator.rig.boards import BOARDS
from tactuator.rig.rig import Rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.sound.open import sound_rig


def rig_names() -> str:
    """Return the names of rigs that may be asked for, as a message or a help text lists them."""
    return ", ".join(
        ["simulated", "in-process", *(f"emulated:{name}" for name in BOARDS), "board:URL", "sound:DEVICE[@RATE]"]
    )


def open_rig(spec: str, display: Display, seed: int = 0) -> Rig:
    """Return the rig of that name with `display` on it.

    URL: a serial port (COM3, /dev/ttyACM0) or `socket://host:port`. Raises BadInput for another name, or for what is
    missing (the emulator, the cross-compiler, pyserial, PortAudio, the card), and DeviceFault where a port or a card
    cannot be opened.
    """
    kind, _, rest = spec.partition(":")
    if spec == "simulated":
        return SimulatedRig(display, seed)
    if spec == "in-process":
        return in_process_rig(display, seed)
    if kind == "emulated" and rest:
        return emulated_rig(rest, display, seed)
    if kind == "board" and rest:
        return serial_rig(rest, display, seed)
    if kind == "sound":
        return sound_rig(rest, display)
    raise BadInput(f"rig {spec!r} is not known", f"{rig_names()}")
