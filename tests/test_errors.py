"""The tree of errors at the head of errors.py is the tree of the classes."""

import re
from pathlib import Path

import tactuator.errors

PACKAGE = Path(tactuator.errors.__file__).parent


def classes():
    """Return the bases of every class of the package, by its name."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        for name, bases in re.findall(r"^ *class (\w+)\(([^)]*)\):", path.read_text("utf-8"), re.MULTILINE):
            found[name] = set(re.findall(r"\w+", bases))
    return found


def below(parent, bases):
    """Return the names under a class, each with its parent."""
    own = {name for name, parents in bases.items() if parent in parents}
    return {(name, parent) for name in own}.union(*(below(name, bases) for name in own))


def drawn():
    """Return the names in the picture, each with its parent: four columns are a step down."""
    line, above, found = re.compile(r"^    ([ │├└─]*)(\w+)"), [], set()
    for text in tactuator.errors.__doc__.splitlines():
        if (match := line.match(text)) is not None:
            depth = len(match[1]) // 4
            above[depth:] = [match[2]]
            if depth:
                found.add((match[2], above[depth - 1]))
    return found


def test_errors__picture_at_the_head_of_the_file__is_the_tree_of_the_classes():
    assert drawn() == below("TactuatorError", classes())
    assert len(drawn()) > 8
