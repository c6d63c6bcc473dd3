"""Boards, by the board.toml of their folders, and the programs that are built for them."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.io.atomic import atomic_path
from tactuator.io.text import parse_toml, read_text
from tactuator.rig.transport import BAUD

FIRMWARE = Path(__file__).resolve().parent
ROOT = FIRMWARE.parent
CACHE = ROOT / "build" / "firmware"
COMPILER, OBJCOPY, SIZE = "arm-none-eabi-gcc", "arm-none-eabi-objcopy", "arm-none-eabi-size"
FLAGS = (
    "-std=c99", "-O2", "-ffp-contract=off", "-ffreestanding", "-Wall", "-Wextra", "-mthumb",
    "-mfloat-abi=hard", "-nostartfiles", "-nostdlib",
)  # fmt: skip
FORMS = {".elf": "", ".bin": "binary", ".hex": "ihex"}
"""What a program may be written as, by the file's ending, and what objcopy calls it."""
_HOST_ALONE = ("core/display", "core/host")
"""Parts of core/ for the simulation: no board has a use for them."""


@dataclass(frozen=True)
class Board:
    """A board: the settings of compiler and linker.

    rows: of the rings for stream and trace, a power of two. baud: rate of the link. folders: with the sources and the
    linker script of its program, besides core/ and what is in firmware/ for every board. flags: more for the compiler.
    """

    name: str
    describes: str
    processor: str
    floating_point: str
    rows: int
    clock_hz: float
    folders: tuple[Path, ...]
    flags: tuple[str, ...] = ()
    baud: int = BAUD


def read_boards(firmware: Path = FIRMWARE) -> dict[str, Board]:
    """Return the boards of the folders of `firmware` with a board.toml, by the folder's name.

    Raises BadInput if a file is no TOML, has a key that is not known, or lacks one.
    """
    boards = {}
    for path in sorted(firmware.glob("*/board.toml")):
        folders = (firmware / "cortex_m", path.parent, path.parent / "silicon")
        try:
            boards[path.parent.name] = Board(path.parent.name, folders=folders, **parse_toml(read_text(path)))
        except (BadInput, TypeError) as error:
            raise BadInput(str(error), "the keys of Board", where=(str(path),)) from error
    return boards


def find_board(name: str) -> Board:
    """Return the board of that name. Raises BadInput for an unknown name."""
    boards = read_boards()
    if name not in boards:
        raise BadInput(f"board {name!r} is not known", f"{', '.join(boards)}")
    return boards[name]


def sources(board: Board) -> list[Path]:
    """Return every file that a board's program is made of."""
    every = [path for path in (ROOT / "core").rglob("*") if not str(path.relative_to(ROOT)).startswith(_HOST_ALONE)]
    for folder in (FIRMWARE, *board.folders):
        every += folder.glob("*")
    return sorted(path for path in every if path.suffix in {".c", ".h", ".ld"})


def compile_command(board: Board, files: list[Path], program: str) -> list[str]:
    """Return the compiler's command line for a program of these files, to be run in ROOT."""
    names = [str(path.relative_to(ROOT)) for path in files if path.suffix == ".c"]
    # one that inserts into another's sections comes before it
    scripts = [f"-T{path.relative_to(ROOT)}" for path in reversed(files) if path.suffix == ".ld"]
    return [
        COMPILER, *FLAGS, f"-mcpu={board.processor}", f"-mfpu={board.floating_point}",
        f'-DTACT_BOARD_NAME="{board.name}"', f"-DTACT_STREAM_ROWS={board.rows}", f"-DTACT_TRACE_ROWS={board.rows}",
        f"-DTACT_BAUD={board.baud}",
        "-Icore", "-Ifirmware", *board.flags, *names, *scripts, "-lgcc", "-o", program,
    ]  # fmt: skip


def build(board: Board) -> Path:
    """Build the program (ELF) of a board, unless one of these very sources is there already, and return its path.

    Raises BadInput if the compiler is missing (it says what to install), or if the sources do not compile or do not fit
    the board's memory.
    """
    files = sources(board)
    program = CACHE / f"{board.name}-{_digest(board, files)}.elf"
    _require(COMPILER)
    program.parent.mkdir(parents=True, exist_ok=True)
    with _alone(program.parent):
        if not program.exists():
            _compile(board, files, program)
    return program


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process at a time build into the folder: others wait, and may find built what they would have built."""
    held = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield
    finally:
        os.close(held)


def _compile(board: Board, files: list[Path], program: Path) -> None:
    """Write the program, whole or not at all, its warnings beside it. Raises BadInput with the first complaint."""
    with atomic_path(program, None) as beside:
        command = compile_command(board, files, str(beside))
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = done.stderr.splitlines()
            first = next((line for line in said if "overflowed" in line or "error:" in line), "the compiler failed")
            words = f"firmware for {board.name} does not compile: {first.strip()}"
            raise BadInput(words, "sources that do, and that fit")
        program.with_suffix(".txt").write_text(done.stderr, encoding="utf-8")


def write_program(built: Path, out: Path) -> None:
    """Write the program `built` (ELF) to `out` in the form of its ending, whole or not at all.

    Raises BadInput for another ending, or if objcopy is missing or fails, on a full disk for one.
    """
    if out.suffix not in FORMS:
        raise BadInput(f"{out.name}: a program's name ends in {out.suffix!r}", f"{', '.join(FORMS)}")
    _require(OBJCOPY)
    with atomic_path(out, None) as beside:
        if out.suffix == ".elf":
            shutil.copyfile(built, beside)
            return
        command = [OBJCOPY, "-O", FORMS[out.suffix], str(built), str(beside)]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        if done.returncode != 0:
            said = done.stderr.strip().rpartition(": ")[2] or "objcopy failed"
            raise BadInput(f"{out} cannot be written: {said}", "a place with room")


def memory_used(built: Path) -> tuple[int, int]:
    """Return the bytes of flash and of RAM that a program (ELF) takes, its stack among them."""
    _require(SIZE)
    said = subprocess.run([SIZE, str(built)], check=True, capture_output=True, text=True).stdout
    text, data, bss = (int(word) for word in said.splitlines()[1].split()[:3])
    return text + data, data + bss


def _require(tool: str) -> None:
    if shutil.which(tool) is None:
        raise BadInput(f"{tool} is missing: install it with `make install-boards`")


def _digest(board: Board, files: list[Path]) -> str:
    digest = hashlib.sha256(repr((FLAGS, board)).encode())
    for path in files:
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
