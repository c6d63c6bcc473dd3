"""Boards that there are: each has a folder of firmware/, whose board.toml says what the tools must know of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.io.formats.text import parse_toml, read_text

CHECKOUT = Path(__file__).resolve().parents[3]
_PACKED = Path(__file__).resolve().parents[1] / "sources"
ROOT = _PACKED if _PACKED.is_dir() else CHECKOUT
"""The folder with core/ and firmware/: the checkout's, or in a package that was installed from a wheel its own."""
NO_SOURCES = "the firmware's sources are not in this installation; allowed: a wheel, or a checkout of the repository"
"""Told where core/ and firmware/ are missing."""


@dataclass(frozen=True)
class Board:
    """A board: what the compiler and the linker are told, and what the emulator calls it.

    folder: its own, in firmware/, where board.toml has the other keys; `script` there is the linker's. rows: of the
    rings for stream and trace, a power of two. machine: QEMU's name, where the timer counts at `timer_hz`; its link is
    the emulator's serial port number `serial`. has_fifos: in the emulator it can be reached over FIFOs as well.
    is_real: it can be bought, and has a program for the board itself.
    """

    name: str
    describes: str
    processor: str
    floating_point: str
    folder: str
    script: str
    rows: int
    machine: str
    timer_hz: float
    serial: int = 0
    has_fifos: bool = False
    is_real: bool = False

    def parts(self, emulated: bool) -> tuple[str, ...]:
        """Return the folders of firmware/ whose files the program is made of, besides what is for every board."""
        own = (self.folder, f"{self.folder}/{'emulated' if emulated else 'silicon'}")
        return ("cortex_m", "emulated", *own) if emulated else ("cortex_m", *own)


def read_boards(firmware: Path) -> dict[str, Board]:
    """Return the boards of every board.toml in the folders of `firmware`, by name; none where there is no such file.

    Raises BadInput if a file is no TOML, or a board has a key that is not known or lacks one.
    """
    found = {}
    for path in sorted(firmware.glob("*/board.toml")):
        try:
            tables = parse_toml(read_text(path))
            found.update({name: Board(name=name, folder=path.parent.name, **keys) for name, keys in tables.items()})
        except (BadInput, TypeError) as error:
            raise BadInput(f"{path}: {error}", "a table for each board, with the keys of Board") from error
    return found


BOARDS = read_boards(ROOT / "firmware")


def find_board(name: str) -> Board:
    """Return the board of that name. Raises BadInput if there is none."""
    if not BOARDS:
        raise BadInput(NO_SOURCES)
    if name not in BOARDS:
        raise BadInput(f"board {name!r} is not known", f"{', '.join(BOARDS)}")
    return BOARDS[name]
