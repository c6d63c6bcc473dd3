"""Builds `tactuator.runtime._core`: every C file of core/, bound with cffi. Run by setup.py, never imported.

Python's declarations are taken from core's own headers, so that there is nothing to keep in step.
"""

from __future__ import annotations

import re
from pathlib import Path

from cffi import FFI

CORE = Path(__file__).resolve().parents[3] / "core"
HEADERS = sorted(str(path.relative_to(CORE)) for path in CORE.rglob("*.h"))
SOURCES = sorted(str(path.relative_to(CORE)) for path in CORE.rglob("*.c"))

# Bit for bit the same numbers everywhere: no fused multiply-add, nothing reassociated. To pack states in pairs is slow.
FLAGS = ["-std=c99", "-O3", "-fno-tree-slp-vectorize", "-ffp-contract=off", "-fno-fast-math", "-Wall"]

PREAMBLE = """
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#pragma GCC diagnostic ignored "-Wshadow"
#endif
"""


def declarations(header: str) -> str:
    """Return a header's declarations for cffi: types, enumerations, and functions without bodies."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    text = re.sub(r"\\\n", " ", text)
    text = re.sub(r"^\s*#.*$", "", text, flags=re.MULTILINE)
    pieces: list[str] = []
    while text.strip():
        piece, brace, text = _next_piece(text)
        if piece.startswith("static inline "):
            piece = piece.removeprefix("static inline ").partition("{")[0] + ";"
        elif brace and not piece.startswith(("typedef", "enum", "struct", "union")):
            raise ValueError(f"core header: only inline functions may have a body; got {piece.partition('{')[0]!r}")
        pieces.append(piece.strip())
    return "\n".join(pieces) + "\n"


def _next_piece(text: str) -> tuple[str, bool, str]:
    """Return the first declaration of `text`, a flag for braces in it, and the text that follows it."""
    text = text.lstrip()
    depth, braced = 0, False
    for at, character in enumerate(text):
        if character == "{":
            depth, braced = depth + 1, True
        elif character == "}":
            depth -= 1
        ends = character == ";" or (character == "}" and text.startswith("static inline "))
        if ends and depth == 0:
            return text[: at + 1], braced, text[at + 1 :]
    raise ValueError(f"core header: a declaration does not end: {text[:60]!r}")


def in_order(headers: list[str]) -> list[str]:
    """Return the headers, each after those that it includes."""
    done: list[str] = []

    def visit(name: str) -> None:
        if name in done:
            return
        for needed in re.findall(r'^#include "([^"]+)"', (CORE / name).read_text(), flags=re.MULTILINE):
            visit(needed)
        done.append(name)

    for name in headers:
        visit(name)
    return done


ORDERED = in_order(HEADERS)

ffibuilder = FFI()
for name in ORDERED:
    ffibuilder.cdef(declarations((CORE / name).read_text()))
ffibuilder.set_source(
    "tactuator.runtime._core",
    PREAMBLE + "".join(f'#include "{name}"\n' for name in ORDERED),
    sources=[f"core/{name}" for name in SOURCES],
    include_dirs=["core"],
    depends=[f"core/{name}" for name in HEADERS],
    extra_compile_args=FLAGS,
)

if __name__ == "__main__":
    ffibuilder.compile(verbose=True)
