"""The picture of the floors is that of the contract, and every hop of the walks is where the document says."""

import re
from pathlib import Path

import pytest

from tools import floors

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
HOPS = re.findall(r"^\| \d+ \| `([^`]+)` \| `(\w+)` \|", PAGE, flags=re.MULTILINE)


def defines(source: str, name: str, suffix: str) -> bool:
    """Return whether a Python, C or JavaScript source defines a function of that name."""
    pattern = {
        ".py": rf"^ *(?:async )?def {name}\(",
        ".js": rf"^(?:async )?function {name}\(",
        ".c": rf"^[a-z][\w ]*\*?{name}\([^;]*$",
        ".h": rf"^[a-z][\w ]*\*?{name}\([^;]*$",
    }[suffix]
    return re.search(pattern, source, flags=re.MULTILINE) is not None


def test_picture__of_the_floors__is_drawn_from_the_contract() -> None:
    assert floors.PICTURE.read_text(encoding="utf-8") == floors.picture(), "out of date; `make docs` draws it anew"


def test_walks__are_both_there() -> None:
    assert len(HOPS) >= 30


@pytest.mark.parametrize(("path", "name"), HOPS)
def test_hop__named_in_the_document__is_there(path: str, name: str) -> None:
    assert defines((ROOT / path).read_text(encoding="utf-8"), name, Path(path).suffix)


def test_hop__that_is_gone__is_missed() -> None:
    assert not defines("def feed(): ...\nfeeder = feed\n", "fed", ".py")
    assert not defines("    tact_board_fade(board);\n", "tact_board_fade", ".c")


@pytest.mark.parametrize("room", sorted({room for floor in floors.floors() for room in floor}))
def test_floor__of_the_picture__is_a_room(room: str) -> None:
    package = ROOT / "src" / "tactuator"
    assert (package / room).is_dir() or (package / f"{room}.py").is_file()
