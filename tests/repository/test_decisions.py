"""Decisions have one style, and each stands in the index under its own title."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "decisions"
RECORDS = sorted(FOLDER.glob("[0-9]*.md"))
INDEX = dict(
    re.findall(r"^\| \[\d{4}\]\(([^)]+)\) \| (.+) \|$", (FOLDER / "README.md").read_text("utf-8"), flags=re.MULTILINE)
)


def faults(name: str, text: str) -> list[str]:
    """Return what is amiss with a decision of that file name."""
    number = name[:4]
    title = re.match(rf"# {number}\. (.+)\n", text)
    found = [] if title else [f"its title does not begin with '# {number}. '"]
    if title and INDEX.get(name) != title[1]:
        found.append(f"its title {title[1]!r} is not that of the index")
    parts = re.findall(r"^\*\*([^*]+?)\.?\*\*", text, flags=re.MULTILINE)
    if parts[:1] != ["Decided"] or not any(part.startswith("Why") for part in parts):
        found.append("it does not say what was decided, and why")
    return found


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.stem)
def test_decision__every_one__has_the_style_and_its_line_in_the_index(path):
    assert faults(path.name, path.read_text(encoding="utf-8")) == []


def test_index__every_line__has_its_record():
    assert sorted(INDEX) == [path.name for path in RECORDS]


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("# 0301. ", "# 0301: ", "does not begin"),
        ("replayed from", "said by", "not that of the index"),
        ("**Why.**", "Because", "and why"),
        ("**Decided.**", "So:", "what was decided"),
    ],
)
def test_decision__with_one_fault__is_found(old, new, fault):
    (path,) = FOLDER.glob("0301-*.md")
    (found,) = faults(path.name, path.read_text(encoding="utf-8").replace(old, new))
    assert fault in found
