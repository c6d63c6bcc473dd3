"""Names: one alias for each type of array, and one class for each name."""

import ast
import io
import re
import tokenize
from collections import defaultdict
from pathlib import Path

import pytest

RETIRED = {
    "attend": "run_session", "authority": "command_fade", "conduct": "presented_session", "exercise": "bit_check",
    "leaving": "ending", "look_closer": "confirm", "persistence": "excitation", "rubbing": "friction",
    "stagehand": "playback_callbacks", "station": "apparatus", "streaming_trial": "streaming_check",
    "wired": "simulated_board",
}  # fmt: skip
"""Identifiers that gave way to terms of the field, and what stands for them now."""

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "tactuator"
ROOMS_NOT_YET_SWEPT: tuple[str, ...] = ()


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
    assert owners(sources) == {}


def test_class_name__of_two_classes__is_found() -> None:
    sources = {
        "web/page.py": "class Task:\n    class _Part: ...\n",
        "corpus/task.py": "class Task:\n    class _Part: ...\n",
    }
    assert owners(sources) == {"Task": ["web/page.py", "corpus/task.py"]}


def retired(path: Path) -> set[str]:
    """Return the retired names among the identifiers of a Python or C source."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        tokens = tokenize.generate_tokens(io.StringIO(source).readline)
        names = {token.string for token in tokens if token.type == tokenize.NAME}
    else:
        names = set(re.findall(r"[A-Za-z_]\w*", re.sub(r"/\*.*?\*/|\"[^\"\n]*\"", "", source, flags=re.DOTALL)))
    return {name for name in names if re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().strip("_") in RETIRED}


def test_identifiers__none__is_a_retired_name() -> None:
    sources = [path for room in ("src", "core", "firmware") for path in sorted((ROOT / room).rglob("*.[pch]*"))]
    found = {
        path.relative_to(ROOT).as_posix(): names
        for path in sources
        if path.suffix in {".py", ".c", ".h"} and (names := retired(path))
    }
    assert found == {}


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("rig.py", "def attend(): ...\n"),
        ("rig.py", "class StreamingTrial: ...\n"),
        ("guard.c", "int look_closer(void);\n"),
    ],
)
def test_identifier__that_is_retired__is_found(tmp_path: Path, name: str, source: str) -> None:
    (tmp_path / name).write_text(f"{source}", encoding="utf-8")
    assert len(retired(tmp_path / name)) == 1


def test_word__of_a_comment_or_text__is_no_identifier(tmp_path: Path) -> None:
    (tmp_path / "rig.py").write_text('"""Who leaves the station."""  # station\n', encoding="utf-8")
    (tmp_path / "rig.c").write_text('/* leaving */ const char *WORD = "leaving";\n', encoding="utf-8")
    assert retired(tmp_path / "rig.py") == retired(tmp_path / "rig.c") == set()
