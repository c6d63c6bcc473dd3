"""Builds and runs lawful_play.c: how often the guard takes a sound sensor for a false one, counted over any time."""

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

from tactuator.rig.board.commissioning import safety_table
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import Fault, safety_bytes
from tactuator.runtime.tables import simulated_board_bytes
from tests.rig.guard.guarded import adaptive, designed

ROOT = Path(__file__).resolve().parents[3]
_PARTS = ("arithmetic", "board", "control", "display", "link", "strength", "touch", "wire")
CONTROLLERS = ("fixed", "adaptive", "adaptive, q31")
_FLAGS = ("-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror")


@dataclass(frozen=True)
class Lawful:
    """Seconds simulated and those of them in a run, runs begun, and how often each fault occurred."""

    seconds: float
    running_s: float
    runs: int
    faults: dict[str, int]


def build(folder: Path) -> Path:
    """Compile the program with the tables of the example display, fixed and adaptive, into `folder`."""
    contents = {
        "SAFETY_FIXED": safety_bytes(safety_table(designed().display)),
        "SAFETY_ADAPTIVE": safety_bytes(safety_table(adaptive().display)),
        "IMAGE_FIXED": build_image(designed(), "float32"),
        "IMAGE_ADAPTIVE": build_image(adaptive(), "float32"),
        "IMAGE_ADAPTIVE_Q31": build_image(adaptive(), "q31"),
        "DISPLAY": simulated_board_bytes(designed().display, 1),
    }
    arrays = (f"static const uint8_t {name}[] = {{{','.join(map(str, of))}}};\n" for name, of in contents.items())
    (folder / "tables.h").write_text("".join(arrays))
    sources = [str(path) for part in _PARTS for path in sorted((ROOT / "core" / part).glob("*.c"))]
    program = folder / "lawful-play"
    command = ["cc", *_FLAGS, f"-I{ROOT / 'core'}", f"-I{folder}", str(Path(__file__).with_suffix(".c")), *sources]
    subprocess.run([*command, "-o", str(program)], check=True)
    return program


def play(program: Path, seed: int, seconds: float, controller: str = "fixed") -> Lawful:
    """Run the program for so many simulated seconds on one of CONTROLLERS; the same seed plays the same."""
    which = str(CONTROLLERS.index(controller))
    said = subprocess.run([program, str(seed), str(seconds), which], capture_output=True, text=True, check=True).stdout
    found = re.search(r"seconds (\S+) running (\S+) runs (\d+)((?: \d+)+)", said)
    assert found, said
    counts = map(int, found[4].split())
    faults = {fault.words: count for fault, count in zip(list(Fault)[1:], counts, strict=True) if count}
    return Lawful(float(found[1]), float(found[2]), int(found[3]), faults)
