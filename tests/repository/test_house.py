"""The house: what a room may hold, where the walks lead, and names that say something."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tools import floors

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "tactuator"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
BUDGETS = {room: int(lines) for room, lines in re.findall(r"^\| `([\w/]+)` \| (\d+) \|", PAGE, flags=re.MULTILINE)}
HOPS = re.findall(r"^\| \d+ \| `([^`]+)` \| `(\w+)` \|", PAGE, flags=re.MULTILINE)
LONGEST_FUNCTION = 50
VAGUE = r"\b(one|found|made|own|told|left)\b"
SAID = r"\"\"\"(?s:.*?)\"\"\"|\"[^\"\n]*\"|#.*"
"""Strings and comments, most of which have such words: where nothing else has, there is nothing to look for."""
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@cache
def texts() -> dict[str, str]:
    paths = sorted(PACKAGE.rglob("*.py"))
    return {path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def definitions(body: list[ast.stmt]) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef]:
    """Every function and class of these statements, those within others too."""
    for node in body:
        if isinstance(node, (*FUNCTIONS, ast.ClassDef)):
            yield node
        for part in ("body", "orelse", "handlers", "finalbody"):
            yield from definitions(getattr(node, part, []))


def body_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    first = node.body[1 if ast.get_docstring(node) and len(node.body) > 1 else 0]
    return (node.end_lineno or 0) - first.lineno + 1


def test_house__rooms_tests_modules_and_pages__keep_their_budgets() -> None:
    """Who is above makes it smaller, or decides and raises the budget; of pages, by saying each thing once."""
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    lines = dict.fromkeys(rooms, 0) | {"src": 0, "modules": len(texts())}
    for path, text in texts().items():
        for place in {"src", path.partition("/")[0] if "/" in path else "src"}:
            lines[place] += len(text.splitlines())
    lines["tests"] = sum(len(path.read_text("utf-8").splitlines()) for path in (ROOT / "tests").rglob("*.py"))
    pages = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
    pages += [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "tutorials").glob("*.md")]
    words = " ".join(page.read_text(encoding="utf-8") for page in pages).split()
    lines["words"] = sum(any(map(str.isalpha, word)) for word in words)
    assert lines.keys() == BUDGETS.keys()
    assert {place: count for place, count in lines.items() if count > BUDGETS[place]} == {}


def test_package__functions_stored_names_and_classes__fit_a_screen_say_what_they_hold_and_have_one_owner() -> None:
    long, vague, owners = [], [], defaultdict(list)
    for path, text in texts().items():
        tree = ast.parse(text)
        for node in definitions(tree.body):
            if isinstance(node, FUNCTIONS) and body_lines(node) > LONGEST_FUNCTION:
                long.append(f"{path}:{node.name}")
            elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                owners[node.name].append(path)
        for node in ast.walk(tree) if re.search(VAGUE, re.sub(SAID, "", text)) else ():
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and re.fullmatch(VAGUE, node.id):
                vague.append(f"{path}:{node.lineno} {node.id}")
    assert (long, vague) == ([], [])
    assert {name: paths for name, paths in owners.items() if len(paths) > 1} == {}


def test_picture_and_walks__are_drawn_from_the_contract_and_lead_where_they_say() -> None:
    assert floors.PICTURE.read_text(encoding="utf-8") == floors.picture(), "out of date; `make docs` draws it anew"
    patterns = {".py": r"^ *(?:async )?def {}\(", ".js": r"^\s*(?:async )?(?:function )?{}\("}
    for path, name in HOPS:
        pattern = patterns.get(Path(path).suffix, r"^[a-z][\w ]*\*?{}\([^;]*$").replace("{}", name)
        text = (ROOT / path).read_text(encoding="utf-8")
        assert re.search(pattern, text, flags=re.MULTILINE) is not None, (path, name)
    assert len(HOPS) >= 30
