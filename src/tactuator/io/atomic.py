"""Nothing half-written: files and folders appear under their name when they are whole."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from tactuator.errors import BadInput
from tactuator.io.kinds import require_replaceable


@contextmanager
def atomic_path(path: str | os.PathLike[str], kind: str | None) -> Iterator[Path]:
    """Yield a path beside `path` to write to; renamed to `path` at the end, removed on any error.

    kind: of the file, of `KINDS`, None for one of no kind that is known. Raises BadInput where the folder is missing
    or cannot be written, and as `require_replaceable` does.
    """
    target = Path(path)
    check_parent(target)
    if target.exists() and not target.is_file():
        raise BadInput(f"{path} is a folder or a device", "the name of a file")
    require_replaceable(target, kind)
    # the name is known before the file is there: a Ctrl-C between the two leaves nothing
    beside = target.with_name(f".{target.stem}-{_token()}{target.suffix}")
    try:
        with _told_of_a_full_disk(path):
            mode = 0o600 if kind == "store" else 0o666  # subjects' answers are private from the first byte
            os.close(os.open(beside, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode))
            yield beside
        beside.replace(target)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


@contextmanager
def _told_of_a_full_disk(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise BadInput(f"{path} cannot be written: {error.strerror}", "a place with room") from None
        raise


@contextmanager
def atomic_folder(path: str | os.PathLike[str], own_names: frozenset[str]) -> Iterator[Path]:
    """Yield an empty folder beside `path`; it takes the place of `path` at the end, and is removed on any error.

    Raises BadInput where it cannot be made, or where `path` holds anything but `own_names`: what is not ours is never
    replaced. Enter it before long work begins, so that a refusal comes first.
    """
    check_folder(Path(path))
    target = Path(path).resolve()
    _check_own(target, own_names)
    parents = _made_parents(target)
    try:
        beside = target.with_name(f".{target.name}-{_token()}")
        try:
            beside.mkdir(mode=0o700)
            yield beside
            beside.chmod(0o755)
            _check_own(target, own_names)
            _take_the_place_of(target, beside)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    except BaseException as error:
        for folder in parents:
            with suppress(OSError):
                folder.rmdir()
        if isinstance(error, OSError):
            raise BadInput(f"{target} cannot be written: {error.strerror}", "another place") from None
        raise


_OF_FILES = (
    *(".csv", ".tsv", ".txt", ".json", ".toml", ".md", ".html", ".h5", ".hdf5", ".mat", ".db", ".bin", ".wav", ".flac"),
    *(".svg", ".png", ".pdf", ".xlsx", ".zip"),
)


def check_folder(target: Path) -> None:
    """Refuse a folder that is yet to be made under the name of a file."""
    if target.suffix.lower() in _OF_FILES and not target.exists():
        raise BadInput(f"{target} is the name of a file", "that of a folder")


def _check_own(target: Path, own_names: frozenset[str]) -> None:
    if target.exists() and not target.is_dir():
        raise BadInput(f"{target} is a file", "a folder, or a name that is free")
    others = sorted({entry.name for entry in target.iterdir()} - own_names) if target.is_dir() else []
    if others:
        raise BadInput(f"{target} holds other files ({others[0]}, ...)", "a new or empty folder")


def _made_parents(target: Path) -> list[Path]:
    """Make the folders above `target`; those that were not there, the lowest first."""
    missing = [folder for folder in target.parents if not folder.exists()]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{target} cannot be made: {error.strerror}", "a folder that can be written") from None
    check_parent(target)
    return missing


def _take_the_place_of(target: Path, beside: Path) -> None:
    """Rename the folder, and put the old one back if anything comes between the two renames."""
    old = beside.with_name(beside.name + "-old")
    try:
        if target.exists():
            target.rename(old)
        beside.rename(target)
    except BaseException:
        if old.exists() and not target.exists():
            old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def write_text(path: str | os.PathLike[str], text: str, kind: str) -> None:
    """Write `text` (UTF-8) to `path`, whole or not at all; kind: as for `atomic_path`."""
    with atomic_path(path, kind) as beside:
        beside.write_text(text, encoding="utf-8")


def _token() -> str:
    return uuid4().hex[:8]


def check_parent(target: Path) -> None:
    """Refuse a file whose folder is not there or cannot be written, before the work whose result it is to hold."""
    parent = target.parent
    if not parent.is_dir():
        raise BadInput(f"{parent} is not a folder", "a place in a folder that exists")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise BadInput(f"{parent} cannot be written", "a folder with permission to write")


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write every file, or none if one of them fails; folders that are not there are made.

    A file that is there already with the same content stays. Raises BadInput for one with another content, and where
    a folder cannot be written.
    """
    missing = {target: content for target, content in contents.items() if not _is_there(target, content)}
    try:
        with ExitStack() as undo:
            for target, content in missing.items():
                for folder in reversed((target.parent, *target.parent.parents)):
                    if not folder.exists():
                        folder.mkdir()
                        undo.callback(folder.rmdir)
                undo.callback(target.unlink, missing_ok=True)
                target.write_bytes(content)
            undo.pop_all()
    except OSError as error:
        raise BadInput(f"{target} cannot be written: {error.strerror}", "another folder") from None


def _is_there(target: Path, content: bytes) -> bool:
    if not target.exists():
        return False
    if not target.is_file() or target.read_bytes() != content:
        raise BadInput(f"{target} is there already, with another content", "a folder without it")
    return True
