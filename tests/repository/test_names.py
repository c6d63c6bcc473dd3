"""Names: one alias for each type of array, and one class for each name."""

import ast
import re
from collections import defaultdict
from pathlib import Path

SHARED_YET = {"Fit", "Motor", "Objective", "Problem", "Study", "Threshold"}
"""Names that classes of paper and identification still share with others."""

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "tactuator"
ROOMS_NOT_YET_SWEPT = ("identification", "rig/board_check")


def aliases(source: str) -> list[str]:
    """Return the names that a module gives to arrays of float64 or complex128."""
    return re.findall(r"^(\w+)(?:: TypeAlias)? = NDArray\[np\.(?:float64|complex128)\]", source, flags=re.MULTILINE)


def test_array_aliases__of_every_swept_room__are_those_of_arrays() -> None:
    found = {
        path.relative_to(PACKAGE).as_posix(): names
        for path in sorted(PACKAGE.rglob("*.py"))
        if (names := aliases(path.read_text(encoding="utf-8")))
        and not path.relative_to(PACKAGE).as_posix().startswith(ROOMS_NOT_YET_SWEPT)
    }
    assert found == {"arrays.py": ["FloatArray", "ComplexArray"]}


def test_array_alias__of_a_room_of_its_own__is_found() -> None:
    assert aliases("Samples = NDArray[np.float64]\nRows = NDArray[np.float32]\n") == ["Samples"]


def owners(sources: dict[str, str]) -> dict[str, list[str]]:
    """Return the files of every public class name that more than one class has."""
    found = defaultdict(list)
    for path, source in sources.items():
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(path)
    return {name: paths for name, paths in sorted(found.items()) if len(paths) > 1}


def test_class_names__every_public_one__has_one_owner() -> None:
    sources = {path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    assert {name: paths for name, paths in owners(sources).items() if name not in SHARED_YET} == {}


def test_class_name__of_two_classes__is_found() -> None:
    sources = {
        "web/page.py": "class Task:\n    class _Part: ...\n",
        "corpus/task.py": "class Task:\n    class _Part: ...\n",
    }
    assert owners(sources) == {"Task": ["web/page.py", "corpus/task.py"]}
