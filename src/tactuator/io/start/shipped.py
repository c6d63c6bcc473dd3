"""The examples that come with tactuator: where they lie, and how they are copied out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tactuator.errors import BadInput

EXAMPLES = Path(__file__).parent / "examples"
"""The folder of examples in the installed package."""


def example_names() -> tuple[str, ...]:
    """Return the paths of all examples, relative to their folder, in alphabetical order."""
    return tuple(sorted(path.relative_to(EXAMPLES).as_posix() for path in EXAMPLES.rglob("*") if path.is_file()))


def copy_examples(folder: Path) -> tuple[Path, ...]:
    """Write a copy of every example into `folder`, which is made if it is not there, and return the paths written.

    A file that is there already with the same content stays. Raises BadInput, with nothing written, for one with
    another content, and for a folder that cannot be written.
    """
    contents = {folder / name: (EXAMPLES / name).read_bytes() for name in example_names()}
    write_all(contents)
    return tuple(contents)


def write_all(contents: Mapping[Path, bytes]) -> None:
    """Write every file, or none if one of them fails; folders that are not there are made.

    A file that is there already with the same content stays. Raises BadInput for one with another content, and where
    a folder cannot be written.
    """
    missing = {target: content for target, content in contents.items() if not _is_there(target, content)}
    written: list[Path] = []
    made: list[Path] = []
    try:
        for target, content in missing.items():
            made += _made_folders(target.parent)
            written.append(target)
            target.write_bytes(content)
    except BaseException as error:
        for path in written:
            path.unlink(missing_ok=True)
        for path in reversed(made):
            path.rmdir()
        if isinstance(error, OSError):
            raise BadInput(f"{target} cannot be written: {error.strerror}", "another folder") from None
        raise


def _is_there(target: Path, content: bytes) -> bool:
    """Return whether the file lies there already; raise BadInput where something else does."""
    if not target.exists():
        return False
    if not target.is_file() or target.read_bytes() != content:
        raise BadInput(f"{target} is there already, and not the example", "a folder without it")
    return True


def _made_folders(folder: Path) -> list[Path]:
    """Make a folder and those above it; return those that were not there, the highest first."""
    missing = [one for one in (folder, *folder.parents) if not one.exists()][::-1]
    for one in missing:
        one.mkdir()
    return missing
