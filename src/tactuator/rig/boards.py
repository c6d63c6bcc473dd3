"""Boards that there are, by the board.toml of their folders in firmware/, and the programs that are built for them."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.io.atomic import atomic_path
from tactuator.io.text import parse_toml, read_text

CHECKOUT = Path(__file__).resolve().parents[3]
_PACKED = Path(__file__).resolve().parents[1] / "sources"
ROOT = _PACKED if _PACKED.is_dir() else CHECKOUT
"""The folder with core/ and firmware/: the checkout's, or in a package that was installed from a wheel its own."""
NO_SOURCES = "the firmware's sources are not in this installation", "a wheel, or a checkout of the repository"
"""Told where core/ and firmware/ are missing."""
COMPILER = "arm-none-eabi-gcc"
OBJCOPY, SIZE = "arm-none-eabi-objcopy", "arm-none-eabi-size"
FLAGS = (
    "-std=c99", "-O2", "-ffp-contract=off", "-ffreestanding", "-Wall", "-Wextra", "-mthumb",
    "-mfloat-abi=hard", "-nostartfiles", "-nostdlib",
)  # fmt: skip
FORMS = {".elf": "", ".bin": "binary", ".hex": "ihex"}
"""What a program may be written as, by the file's ending, and what objcopy calls it."""
_HOST_ALONE = ("core/host", "core/display/closed_loop")
"""Parts of core/ for the simulation on this machine and for identification: no board has a use for them."""


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
        folders = (self.folder, f"{self.folder}/{'emulated' if emulated else 'silicon'}")
        return ("cortex_m", "emulated", *folders) if emulated else ("cortex_m", *folders)


def read_boards(firmware: Path) -> dict[str, Board]:
    """Return the boards of every board.toml in the folders of `firmware`, by name; none where there is no such file.

    Raises BadInput if a file is no TOML, or a board has a key that is not known or lacks one.
    """
    boards = {}
    for path in sorted(firmware.glob("*/board.toml")):
        try:
            tables = parse_toml(read_text(path))
            boards.update({name: Board(name=name, folder=path.parent.name, **keys) for name, keys in tables.items()})
        except (BadInput, TypeError) as error:
            raise BadInput(str(error), "a table for each board, with the keys of Board", where=(str(path),)) from error
    return boards


BOARDS = read_boards(ROOT / "firmware")


def find_board(name: str) -> Board:
    """Return the board of that name. Raises BadInput if there is none."""
    if not BOARDS:
        raise BadInput(*NO_SOURCES)
    if name not in BOARDS:
        raise BadInput(f"board {name!r} is not known", f"{', '.join(BOARDS)}")
    return BOARDS[name]


def sources(board: Board, emulated: bool = True) -> list[Path]:
    """Return every file that a board's program is made of. Raises BadInput where they are not beside the package."""
    core, firmware = ROOT / "core", ROOT / "firmware"
    if not (core.is_dir() and firmware.is_dir()):
        raise BadInput(*NO_SOURCES)
    every = [path for path in core.rglob("*") if not str(path.relative_to(ROOT)).startswith(_HOST_ALONE)]
    for part in ("", *board.parts(emulated)):
        every += (firmware / part).glob("*")
    return sorted(path for path in every if path.suffix in {".c", ".h", ".ld"})


def build_firmware(name: str, emulated: bool = True, flags: tuple[str, ...] = ()) -> Path:
    """Build the program (ELF) of a board, unless one of these very sources is there already, and return its path.

    emulated: for the emulator, with the simulated display in the place of converters; otherwise for the board itself.
    flags: more for the compiler. Raises BadInput if the compiler is missing (it says what to install), if the board
    cannot be bought, or if the sources do not compile or do not fit the board's memory.
    """
    board = find_board(name)
    if not emulated and not board.is_real:
        raise BadInput(f"board {name!r} is the emulator's alone", "one with a program for the board itself")
    files = sources(board, emulated)
    kind = "emulated" if emulated else "silicon"
    program = _cache() / f"{name}-{kind}-{_digest(board, files, flags)}.elf"
    if program.exists():
        return program
    _require(COMPILER)
    program.parent.mkdir(parents=True, exist_ok=True)
    with _alone(program.parent):
        if not program.exists():
            _compile(board, files, flags, program)
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


def _compile(board: Board, files: list[Path], flags: tuple[str, ...], program: Path) -> None:
    """Write the program, whole or not at all, its warnings beside it. Raises BadInput with the first complaint."""
    with atomic_path(program) as beside:
        command = [*_command(board, files, str(beside)), *flags]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = done.stderr.splitlines()
            first = next((line for line in said if "overflowed" in line or "error:" in line), "the compiler failed")
            words = f"firmware for {board.name} does not compile: {first.strip()}"
            raise BadInput(words, "sources that do, and that fit")
        program.with_suffix(".txt").write_text(done.stderr, encoding="utf-8")


def form_of(out: Path) -> str:
    """Return what objcopy calls the form that a program's name ends in, "" for ELF. Raises BadInput for another."""
    if out.suffix not in FORMS:
        raise BadInput(f"{out.name}: a program's name ends in {out.suffix!r}", f"{', '.join(FORMS)}")
    return FORMS[out.suffix]


def write_program(built: Path, out: Path, form: str) -> None:
    """Write the program `built` (ELF) to `out`, in a form of form_of(), whole or not at all.

    Raises BadInput if objcopy is missing or fails, on a full disk for one.
    """
    if form:
        _require(OBJCOPY)
    with atomic_path(out) as beside:
        if not form:
            shutil.copyfile(built, beside)
            return
        command = [OBJCOPY, "-O", form, str(built), str(beside)]
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
        raise BadInput(f"{tool} is missing", "install it with `make install-boards`")


def _command(board: Board, files: list[Path], program: str) -> list[str]:
    names = [str(path.relative_to(ROOT)) for path in files if path.suffix == ".c"]
    return [
        COMPILER, *FLAGS, f"-mcpu={board.processor}", f"-mfpu={board.floating_point}",
        f'-DTACT_BOARD_NAME="{board.name}"', f"-DTACT_STREAM_ROWS={board.rows}", f"-DTACT_TRACE_ROWS={board.rows}",
        "-Icore", "-Ifirmware", *names, "-T", f"firmware/{board.folder}/{board.script}", "-lgcc", "-o", program,
    ]  # fmt: skip


def _digest(board: Board, files: list[Path], flags: tuple[str, ...]) -> str:
    digest = hashlib.sha256(repr((FLAGS, board, flags)).encode())
    for path in files:
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _cache() -> Path:
    folder = ROOT / "build" / "firmware"
    if ROOT == CHECKOUT and os.access(ROOT, os.W_OK):
        return folder
    return Path(tempfile.gettempdir()) / f"tactuator-firmware-{os.getuid()}"
