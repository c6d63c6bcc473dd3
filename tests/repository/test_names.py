"""Names: one alias for each type of array."""

import re
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "tactuator"
ROOMS_NOT_YET_SWEPT = ("experiment", "identification", "rig/board_check", "web")


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
