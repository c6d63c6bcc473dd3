"""Docstrings are sentences: a callable's begins with a verb that says what it does, and nothing is left half said."""

import ast
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "tactuator"
ROOMS_NOT_YET_SWEPT: tuple[str, ...] = ()
CLAUSES = {"How", "That", "What", "When", "Where", "Whether", "Which", "Who", "Whose", "Why"}
VERBS = """
Add Append Apply Ask Begin Block Bring Build Calibrate Call Check Choose Close Code Compare Compile Compute Count
Decide Design Do Draw Drive Drop End Estimate Evaluate Fade Feed Fill Filter Find Finish Fit Forget Format Gather
Give Go Hand Hold Identify Initialise Join Judge Keep Label Learn Leave Let Load Look Lower Make Map Mark Match
Measure Merge Move Name Open Parse Place Plan Play Predict Press Print Put Queue Raise Read Rebuild Receive Record
Refine Refit Refuse Remember Remove Rename Render Replace Report Require Resample Restore Return Run Save Say Score
Search Send Serve Set Show Simulate Solve Split Start Step Stop Store Stream Sum Take Tell Test Touch Turn Update Verify
Wait Walk Write Yield
"""

Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def faults(node: Documented) -> list[str]:
    """Return what is amiss with the docstring of `node`; nothing where it has none."""
    text = ast.get_docstring(node)
    if text is None:
        return []
    paragraphs = re.split(r"\n\s*\n", text)
    words = paragraphs[0].split()
    head = words[0].rstrip(",")
    found = []
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and head not in VERBS.split():
        found.append(f"{head!r} is no verb that says what is done")
    if head in CLAUSES:
        found.append(f"a bare clause: {head!r} ...")
    if not head[0].isupper():
        found.append("no capital letter at its head")
    if len(words) <= 4:
        found.append("four words or fewer")
    if paragraphs[0][-1] not in ".:?":
        found.append("its first paragraph does not end as a sentence")
    for before, after in pairwise(paragraphs):
        if re.search(r"[\w,;]$", before) and not before.startswith(" ") and not after.startswith(" "):
            found.append(f"broken in mid-sentence after {before.split()[-1]!r}")
    return found


def documented(source: str) -> Iterator[Documented]:
    """Yield everything that can have a docstring."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, Documented):
            yield node


def files() -> list[Path]:
    """Return the files of the rooms that are swept."""
    found = sorted(PACKAGE.rglob("*.py"))
    return [path for path in found if not path.relative_to(PACKAGE).as_posix().startswith(ROOMS_NOT_YET_SWEPT)]


def test_docstrings__of_every_swept_room__are_sentences() -> None:
    found = [
        f"{path.relative_to(PACKAGE)}, {getattr(node, 'name', 'module')}: {fault}"
        for path in files()
        for node in documented(path.read_text(encoding="utf-8"))
        for fault in faults(node)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("docstring", "fault"),
    [
        ("What a rig gives back of a block.", "a bare clause"),
        ("Whether the closed loop is stable.", "a bare clause"),
        ("The level of the loudest channel.", "no verb"),
        ("return the level of the channel.", "no capital letter"),
        ("Return the level.", "four words"),
        ("Return the level of the channel", "does not end as a sentence"),
        ("Return the level and\n\nthe phase of it.", "broken in mid-sentence"),
        ("Return the level of it.\n\nShape (n,), in\n\ndecibels.", "broken in mid-sentence"),
    ],
)
def test_docstring__with_one_fault__is_found(docstring: str, fault: str) -> None:
    (_, function) = documented(f'def level():\n    """{docstring}"""')
    assert any(fault in each for each in faults(function))


@pytest.mark.parametrize(
    "docstring",
    [
        "Return the level of the loudest channel.",
        "Yield blocks of shape (n, channels):",
        "Return the sum, in the difference d.\n\nWith d,\n\n    b = c - d,\n\nwhose sum is exact.",
    ],
)
def test_docstring__that_is_a_sentence__passes(docstring: str) -> None:
    (_, function) = documented(f'def level():\n    """{docstring}"""')
    assert faults(function) == []


def test_module_and_class__named_by_what_they_hold__pass_without_a_verb() -> None:
    module, holder = documented(
        '"""Per-channel limits on a reference."""\nclass Limits:\n    """Limits of one channel only."""'
    )
    assert faults(module) == []
    assert faults(holder) == []
