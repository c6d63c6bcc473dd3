"""What Python is told of core's headers."""

import importlib.util
import shlex
import subprocess
import sys
import sysconfig
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@cache
def build() -> ModuleType:
    spec = importlib.util.spec_from_file_location("_core_build", ROOT / "src/tactuator/runtime/_core_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_declarations__inline_function__loses_its_body_and_any_other_is_refused() -> None:
    types = "#define A 1\n/* int no; */\ntypedef struct {\n    int x;\n} t;\n"
    told = build().declarations(types + "inline int f(const t *a)\n{\n    return a->x;\n}\n")
    assert " ".join(told.split()) == "typedef struct { int x; } t; int f(const t *a) ;"
    with pytest.raises(ValueError, match="only inline functions may have a body"):
        build().declarations("int f(void)\n{\n    return 1;\n}\nint g(void);\n")
    with pytest.raises(ValueError, match="does not end"):
        build().declarations("typedef struct { int x;")


def test_flags__keep_the_bits() -> None:
    assert {"-std=c99", "-ffp-contract=off"} <= set(build().FLAGS)
    assert not any(flag.startswith(("-march", "-ffast")) for flag in build().FLAGS)


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
