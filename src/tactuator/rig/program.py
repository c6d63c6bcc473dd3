"""Boards of the emulator, and their programs built from core/ and firmware/."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tactuator.errors import BadInput

ROOT = Path(__file__).resolve().parents[3]
COMPILER = "arm-none-eabi-gcc"
FLAGS = (
    "-std=c99", "-O2", "-ffp-contract=off", "-ffreestanding", "-Wall", "-Wextra", "-Werror", "-mthumb",
    "-mfloat-abi=hard", "-nostartfiles", "-nostdlib",
)  # fmt: skip
_HOST_ALONE = ("core/lanes", "core/host", "core/display/closed_loop")
"""Parts of core/ for many loops at once and for identification: no board has a use for them."""


@dataclass(frozen=True)
class Board:
    """A board of the emulator: its processor for the compiler, its clock, and what its links are called."""

    name: str
    processor: str
    floating_point: str
    describes: str


BOARDS: dict[str, Board] = {
    board.name: board
    for board in (
        Board("mps2-an386", "cortex-m4", "fpv4-sp-d16", "Cortex-M4F"),
        Board("mps2-an500", "cortex-m7", "fpv5-d16", "Cortex-M7"),
    )
}


def find_board(name: str) -> Board:
    """Return the board of that name. Raises BadInput if there is none."""
    if name not in BOARDS:
        raise BadInput(f"board {name!r} is not known; allowed: {', '.join(BOARDS)}")
    return BOARDS[name]


def sources() -> list[Path]:
    """Return every file that a program is made of. Raises BadInput where they are not beside the package."""
    folders = (ROOT / "core", ROOT / "firmware")
    if not all(folder.is_dir() for folder in folders):
        raise BadInput("the firmware's sources are not beside this installation; allowed: a checkout of the repository")
    every = (path for folder in folders for path in folder.rglob("*") if path.suffix in {".c", ".h", ".ld"})
    return sorted(path for path in every if not str(path.relative_to(ROOT)).startswith(_HOST_ALONE))


def build_firmware(name: str) -> Path:
    """Build the program (ELF) of a board, unless one of these very sources is there already, and return its path.

    Raises BadInput if the compiler is missing (it says what to install) or the sources do not compile.
    """
    board = find_board(name)
    files = sources()
    program = _cache() / f"{name}-{_digest(board, files)}.elf"
    if program.exists():
        return program
    if shutil.which(COMPILER) is None:
        raise BadInput(f"{COMPILER} is missing; allowed: install it with `make install-boards`")
    program.parent.mkdir(parents=True, exist_ok=True)
    handle, beside = tempfile.mkstemp(suffix=".elf", dir=program.parent)
    os.close(handle)
    done = subprocess.run(_command(board, files, beside), cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        Path(beside).unlink()
        first = next((line for line in done.stderr.splitlines() if "error" in line), "the compiler failed")
        raise BadInput(f"firmware for {name} does not compile: {first.strip()}; allowed: sources that do")
    Path(beside).replace(program)
    return program


def _command(board: Board, files: list[Path], program: str) -> list[str]:
    names = [str(path.relative_to(ROOT)) for path in files if path.suffix == ".c"]
    return [
        COMPILER, *FLAGS, f"-mcpu={board.processor}", f"-mfpu={board.floating_point}",
        f'-DTACT_BOARD_NAME="{board.name}"', "-Icore", "-Ifirmware", *names,
        "-T", "firmware/mps2/mps2.ld", "-lgcc", "-o", program,
    ]  # fmt: skip


def _digest(board: Board, files: list[Path]) -> str:
    digest = hashlib.sha256(repr((board, FLAGS)).encode())
    for path in files:
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _cache() -> Path:
    folder = ROOT / "build" / "firmware"
    if os.access(ROOT, os.W_OK):
        return folder
    return Path(tempfile.gettempdir()) / f"tactuator-firmware-{os.getuid()}"
