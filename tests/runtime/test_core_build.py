"""With which flags the core is compiled, and that their arithmetic is checked."""

import runpy
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_flags__keep_the_bits() -> None:
    flags = runpy.run_path(str(ROOT / "src/tactuator/runtime/_core_build.py"))["FLAGS"]
    assert {"-std=c99", "-ffp-contract=off"} <= set(flags)
    assert not any(flag.startswith(("-march", "-ffast")) for flag in flags)


PROGRAM = """
import ctypes, sys
from tactuator.runtime.simulation import check_arithmetic
check_arithmetic()
ctypes.CDLL(sys.argv[1]).flush()
try:
    check_arithmetic()
except RuntimeError as error:
    print(error)
"""

FLUSHING = """
#include <xmmintrin.h>
void flush(void) { _mm_setcsr(_mm_getcsr() | 0x8040u); }
"""


def test_check_arithmetic__subnormals_flushed__says_so(tmp_path: Path) -> None:
    compiler = shlex.split(sysconfig.get_config_var("CC") or "cc")[0]
    (tmp_path / "flush.c").write_text(FLUSHING, encoding="ascii")
    library = tmp_path / "flush.so"
    made = subprocess.run(
        [compiler, "-shared", "-fPIC", tmp_path / "flush.c", "-o", library], capture_output=True, check=False
    )
    if made.returncode != 0:
        pytest.skip("this processor has no SSE control register to set")
    done = subprocess.run([sys.executable, "-c", PROGRAM, library], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "flush subnormal numbers to zero" in done.stdout
