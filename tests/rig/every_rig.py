"""Every rig that can run here, each with the example display on it; and the one that TACTUATOR_RIG names."""

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np

from tactuator.model.description import Display
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.open import in_process_rig, open_rig
from tactuator.rig.rig import Rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import InProcess
from tests.firmware.emulator import emulated_rig
from tests.rig.guard.guarded import designed
from tests.rig.own_rig import installed_example

SEED = 1


class Lossy(InProcess):
    """Frames lost, spoilt, doubled, cut, and overtaken by the next few, by a seed."""

    def __init__(self, seed: int = 1) -> None:
        super().__init__()
        self.rng = np.random.default_rng(seed)
        self.overtaken: list[bytes] = []

    def send(self, content: bytes) -> None:
        chance = self.rng.random()
        late = self.overtaken.pop(0) if len(self.overtaken) == 3 else b""
        self.overtaken.append(content if 0.2 < chance < 0.25 else b"")
        if chance < 0.04 or 0.2 < chance < 0.25:
            content = b""
        elif chance < 0.08:
            content = content[: len(content) // 2] + b"\x00"
        elif chance < 0.12:
            spoilt = bytearray(content)
            spoilt[self.rng.integers(len(spoilt))] ^= 1 << int(self.rng.integers(8))
            content = bytes(spoilt)
        elif chance < 0.2:
            content = content + content
        elif chance < 0.3:
            content = bytes(self.rng.integers(0, 256, 40, dtype=np.uint8)) + b"\0" + content
        if content + late:
            super().send(content + late)

    def receive(self, timeout_s: float) -> bytes:
        content = super().receive(timeout_s)
        return b"" if self.rng.random() < 0.03 else content


@contextmanager
def _example(display: Display) -> Iterator[Rig]:
    with installed_example() as name, open_rig(name, display, SEED) as rig:
        yield rig


def _lossy(display: Display) -> BoardRig:
    rig = BoardRig(LinkClient(Lossy(), 0.01, tries=20), display)
    rig.simulate(SEED)
    return rig


BOARDS: dict[str, Callable[[Display], AbstractContextManager[BoardRig]]] = {
    "in-process": lambda display: in_process_rig(display, SEED),
    "lossy": _lossy,
    "emulated:mps2-an500": lambda display: emulated_rig("mps2-an500", display, SEED),
}
RIGS: dict[str, Callable[[Display], AbstractContextManager[Rig]]] = {
    "simulated": lambda display: SimulatedRig(display, SEED),
    **{name: opened for name, opened in BOARDS.items() if name != "lossy"},
    "docs/rig.md": _example,
}
if "TACTUATOR_RIG" in os.environ:
    RIGS[os.environ["TACTUATOR_RIG"]] = lambda display: open_rig(os.environ["TACTUATOR_RIG"], display, SEED)


def begin(rig: BoardRig) -> None:
    """The display as it was in the beginning, and the controller."""
    rig.off()
    rig.simulate(SEED)
    rig.load(designed())


def free_rig(transport: InProcess | None = None) -> BoardRig:
    """A board in this process whose time goes on by 32 ticks with every request, whatever it has to play."""
    rig = BoardRig(LinkClient(transport or InProcess()), designed().display, waits=False, sleep=lambda seconds: None)
    rig.simulate(SEED)
    rig.load(designed())
    return rig


def tones(count: int = 600) -> np.ndarray:
    """100 threshold units at 7, 53 and 201 Hz, one to a channel."""
    time_s = np.arange(count) / 4000.0
    return np.stack([100.0 * np.sin(2.0 * np.pi * f * time_s) for f in (7.0, 53.0, 201.0)], axis=1)
