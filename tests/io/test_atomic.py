"""Nothing half-written under the final name."""

import os
import sqlite3
from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from pathlib import Path

import pytest

from tactuator.errors import BadInput
from tactuator.io.atomic import atomic_folder, atomic_path, write_text


def interrupted(writing: AbstractContextManager[Path], file: Callable[[Path], Path]) -> None:
    with writing as beside:
        file(beside).write_text("half")
        raise KeyboardInterrupt


def test_atomic_path__error_in_the_middle__leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    write_text(target, "old")
    with pytest.raises(KeyboardInterrupt):
        interrupted(atomic_path(target), lambda beside: beside)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_atomic_path__store_of_an_experiment__is_never_written_over(tmp_path: Path) -> None:
    target = tmp_path / "study.db"
    with closing(sqlite3.connect(target)) as store:
        store.execute("CREATE TABLE answer (id INTEGER)")
    before = target.read_bytes()
    with pytest.raises(BadInput, match="store of an experiment"):
        write_text(target, "frequency_hz,level_db_sl")
    assert target.read_bytes() == before


OWN = frozenset({"a.txt"})


@pytest.mark.parametrize("writing", [atomic_path, lambda path: atomic_folder(path, OWN)])
def test_atomic__ctrl_c_as_the_place_beside_is_made__leaves_nothing(tmp_path: Path, monkeypatch, writing) -> None:
    """The handler may run as soon as the call into the system has returned; an empty file was left then."""
    came: list[Path] = []
    for name in ("open", "mkdir"):
        sound = getattr(os, name)

        def made(*given, sound=sound, **more):
            found = sound(*given, **more)
            if Path(given[0]).parent == tmp_path and not came:
                came.append(given[0])
                raise KeyboardInterrupt
            return found

        monkeypatch.setattr(os, name, made)
    with pytest.raises(KeyboardInterrupt), writing(tmp_path / "a.txt"):
        pass
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []


def test_atomic_folder__whole__takes_the_place_of_the_old(tmp_path: Path) -> None:
    target = tmp_path / "report"
    for text in ("one", "two"):
        with atomic_folder(target, OWN) as beside:
            (beside / "a.txt").write_text(text)
    assert (target / "a.txt").read_text() == "two"
    assert list(tmp_path.iterdir()) == [target]


def test_atomic_folder__error_in_the_middle__leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        interrupted(atomic_folder(tmp_path / "deep" / "report", OWN), lambda beside: beside / "a.txt")
    assert list(tmp_path.iterdir()) == []


def test_atomic__no_folder_or_a_file_in_the_way__is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="is not a folder"), atomic_path(tmp_path / "none" / "a.txt"):
        pass
    write_text(tmp_path / "file", "x")
    with pytest.raises(BadInput, match="is a file; allowed: a folder"), atomic_folder(tmp_path / "file", OWN):
        pass
    with pytest.raises(BadInput, match="cannot be made"), atomic_folder(tmp_path / "file" / "below" / "c", OWN):
        pass


def test_atomic_folder__files_of_others__is_refused(tmp_path: Path) -> None:
    write_text(tmp_path / "thesis.tex", "years of work")
    with pytest.raises(BadInput, match=r"holds other files \(thesis\.tex"), atomic_folder(tmp_path, OWN):
        pass
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_atomic_folder__place_that_cannot_be_written__is_refused_and_left_as_it_was() -> None:
    # a folder that even root cannot write to
    with pytest.raises(BadInput, match=r"cannot be (made|written)"), atomic_folder("/proc/none/report", OWN):
        pass


def test_atomic_folder__a_file_of_others_comes_in_between__is_kept_and_refused(tmp_path: Path) -> None:
    target = tmp_path / "report"
    target.mkdir()

    def work() -> None:
        with atomic_folder(target, OWN) as beside:
            (beside / "a.txt").write_text("new")
            (target / "thesis.tex").write_text("years of work")

    with pytest.raises(BadInput, match="holds other files"):
        work()
    assert (target / "thesis.tex").read_text() == "years of work"
    assert list(tmp_path.iterdir()) == [target]


def test_atomic_folder__interrupted_between_the_renames__puts_the_old_one_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "report"
    target.mkdir()
    (target / "a.txt").write_text("old")
    rename, calls = Path.rename, []

    def interrupted_second(self: Path, to: Path) -> Path:
        calls.append(to)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", interrupted_second)
    with pytest.raises(KeyboardInterrupt), atomic_folder(target, OWN) as beside:
        (beside / "a.txt").write_text("new")
    assert (target / "a.txt").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_atomic_folder__symlink__fills_what_it_points_to(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with atomic_folder(tmp_path / "link", OWN) as beside:
        (beside / "a.txt").write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "a.txt").read_text() == "new"
