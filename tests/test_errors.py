"""The errors that the package raises on purpose."""

import re
from pathlib import Path

from tactuator import errors

PACKAGE = Path(errors.__file__).parent


def below(parent: str, bases: dict[str, set[str]]) -> set[tuple[str, str]]:
    names = {name for name, parents in bases.items() if parent in parents}
    return {(name, parent) for name in names}.union(*(below(name, bases) for name in names))


def test_errors__picture_at_the_head_of_the_file__is_the_tree_of_the_classes():
    text = "\n".join(path.read_text("utf-8") for path in PACKAGE.rglob("*.py"))
    classes = re.findall(r"^ *class (\w+)\(([^)]*)\):", text, re.MULTILINE)
    above, drawn = {0: "TactuatorError"}, set()
    for lines, name in re.findall(r"^    ([ │├└─]+)(\w+)", errors.__doc__, re.MULTILINE):
        above[len(lines) // 4] = name  # four columns are a step down
        drawn.add((name, above[len(lines) // 4 - 1]))
    assert drawn == below("TactuatorError", {name: set(re.findall(r"\w+", bases)) for name, bases in classes})
    assert len(drawn) > 8
