"""The core on 64-bit ARM (Raspberry Pi, Apple silicon): cross-compiled, run by user-mode emulation, bit for bit.

Witness: gcc for another instruction set with its own rounding and fused multiply-add, under QEMU's floating point.
"""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from tactuator.runtime.image import build_image
from tests.rig.guard.guarded import designed

ROOT = Path(__file__).resolve().parents[3]
FLAGS = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
PARTS = ("arithmetic", "control", "strength", "wire", "touch")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Of this machine and of the other."""
    folder = tmp_path_factory.mktemp("programs")
    return compiled("cc", folder / "here", FLAGS), compiled("aarch64-linux-gnu-gcc", folder / "there", FLAGS)


def compiled(compiler: str, out: Path, flags: list[str]) -> Path:
    """Compile the program with the core's own sources."""
    sources = [path for part in PARTS for path in sorted((ROOT / "core" / part).glob("*.c"))]
    board = ROOT / "core" / "board"
    sources += [board / "image.c", board / "sealed.c", Path(__file__).with_name("bits.c")]
    subprocess.run([compiler, *flags, "-static", "-I", ROOT / "core", *sources, "-o", out], check=True)
    return out


def commands(words: list[str | Path], folder: Path) -> np.ndarray:
    """Return the bits of every command, (ticks, channels)."""
    (folder / "image.bin").write_bytes(build_image(designed()))
    done = subprocess.run([*words, folder / "image.bin"], check=True, capture_output=True)
    return np.frombuffer(done.stdout, dtype=np.uint32).reshape(-1, 3)


def test_core__on_aarch64__gives_the_bits_of_x86_64(programs, tmp_path):
    ours = commands([programs[0]], tmp_path)
    there = commands(["qemu-aarch64", programs[1]], tmp_path)
    assert ours.shape == there.shape == (20000, 3)
    values = ours.view(np.float32)
    assert np.ptp(values) > 15.0  # it moved, and reached its limits
    assert np.unique(ours).size > 10000
    assert np.array_equal(ours, there)
