"""The house: what a room may hold, where the walks lead, and names that say something."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from tools import floors

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "tactuator"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
BUDGETS = {room: int(lines) for room, lines in re.findall(r"^\| `([\w/]+)` \| (\d+) \|", PAGE, flags=re.MULTILINE)}
HOPS = re.findall(r"^\| \d+ \| `([^`]+)` \| `(\w+)` \|", PAGE, flags=re.MULTILINE)
LONGEST_FUNCTION = 50
VAGUE = {"one", "found", "made", "own", "told", "left"}


@cache
def nodes() -> list[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Name]]:
    """Every function, class and name of the package, each with its module; parsed once, in one worker."""
    wanted = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Name)
    return [
        (path.relative_to(PACKAGE).as_posix(), node)
        for path in sorted(PACKAGE.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, wanted)
    ]


def lines_of(place: Path) -> int:
    """Count the lines of Python of a file or folder."""
    files = [place] if place.is_file() else sorted(place.rglob("*.py"))
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


def body_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Count the lines of a function below its signature and docstring."""
    first = node.body[1 if ast.get_docstring(node) and len(node.body) > 1 else 0]
    return (node.end_lineno or 0) - first.lineno + 1


@pytest.mark.parametrize(
    "room", [*(path.name for path in sorted(PACKAGE.iterdir()) if (path / "__init__.py").exists())]
)
def test_room__whatever_it_holds__keeps_its_budget_of_lines(room: str) -> None:
    assert lines_of(PACKAGE / room) <= BUDGETS[room], "make it smaller, or decide and raise its budget"


def test_house__as_a_whole__keeps_its_budget() -> None:
    assert lines_of(PACKAGE) <= BUDGETS["src"]
    assert lines_of(ROOT / "tests") <= BUDGETS["tests"]
    assert len(list(PACKAGE.rglob("*.py"))) <= BUDGETS["modules"]


def test_pages__all_but_decisions__keep_their_budget_of_words() -> None:
    pages = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
    pages += [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "tutorials").glob("*.md")]
    words = " ".join(page.read_text(encoding="utf-8") for page in pages).split()
    assert sum(any(map(str.isalpha, word)) for word in words) <= BUDGETS["words"], "say each thing once"


def test_functions__every_one__fits_a_screen() -> None:
    long = [
        f"{path}:{node.name}"
        for path, node in nodes()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and body_lines(node) > LONGEST_FUNCTION
    ]
    assert long == []


def test_names__that_are_stored__say_what_they_hold() -> None:
    vague = [
        f"{path}:{node.lineno} {node.id}"
        for path, node in nodes()
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in VAGUE
    ]
    assert vague == []


def test_class_names__every_public_one__has_one_owner() -> None:
    owners = defaultdict(list)
    for path, node in nodes():
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            owners[node.name].append(path)
    assert {name: paths for name, paths in owners.items() if len(paths) > 1} == {}


def test_picture__of_the_floors__is_drawn_from_the_contract() -> None:
    assert floors.PICTURE.read_text(encoding="utf-8") == floors.picture(), "out of date; `make docs` draws it anew"


@pytest.mark.parametrize(("path", "name"), HOPS)
def test_hop__named_in_the_document__is_there(path: str, name: str) -> None:
    patterns = {".py": rf"^ *(?:async )?def {name}\(", ".js": rf"^\s*(?:async )?(?:function )?{name}\("}
    pattern = patterns.get(Path(path).suffix, rf"^[a-z][\w ]*\*?{name}\([^;]*$")
    assert re.search(pattern, (ROOT / path).read_text(encoding="utf-8"), flags=re.MULTILINE) is not None


def test_walks__are_both_there() -> None:
    assert len(HOPS) >= 30
