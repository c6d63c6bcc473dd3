"""The house: what a room may hold, and where the walks lead."""

import re
from pathlib import Path

from tools import floors

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "tactuator"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
BUDGETS = {room: int(lines) for room, lines in re.findall(r"^\| `([\w/]+)` \| (\d+) \|", PAGE, flags=re.MULTILINE)}
HOPS = re.findall(r"^\| \d+ \| `([^`]+)` \| `(\w+)` \|", PAGE, flags=re.MULTILINE)


def lines_of(*paths: Path) -> int:
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def test_house__rooms_tests_modules_and_pages__keep_their_budgets() -> None:
    modules = list(PACKAGE.rglob("*.py"))
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    lines = {room: lines_of(*(PACKAGE / room).rglob("*.py")) for room in rooms}
    lines |= {"src": lines_of(*modules), "modules": len(modules), "tests": lines_of(*(ROOT / "tests").rglob("*.py"))}
    pages = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
    pages += [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "tutorials").glob("*.md")]
    words = " ".join(page.read_text(encoding="utf-8") for page in pages).split()
    lines["words"] = sum(any(map(str.isalpha, word)) for word in words)
    assert lines.keys() == BUDGETS.keys()
    assert {place: count for place, count in lines.items() if count > BUDGETS[place]} == {}


def test_picture_and_walks__are_drawn_from_the_contract_and_lead_where_they_say() -> None:
    assert floors.PICTURE.read_text(encoding="utf-8") == floors.picture(), "out of date; `make docs` draws it anew"
    patterns = {".py": r"^ *(?:async )?def {}\(", ".js": r"^\s*(?:async )?(?:function )?{}\("}
    for path, name in HOPS:
        pattern = patterns.get(Path(path).suffix, r"^[a-z][\w ]*\*?{}\([^;]*$").replace("{}", name)
        text = (ROOT / path).read_text(encoding="utf-8")
        assert re.search(pattern, text, flags=re.MULTILINE) is not None, (path, name)
    assert len(HOPS) >= 25
