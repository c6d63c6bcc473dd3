"""Nothing half-written under the final name."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from tactuator.errors import BadInput
from tactuator.io.atomic import atomic_folder, atomic_path, write_text

OURS = frozenset({"a.txt"})


def test_atomic__error_in_the_middle__leaves_the_old_file_and_no_folder(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    write_text(target, "old")
    with pytest.raises(KeyboardInterrupt), atomic_path(target) as beside:
        beside.write_text("half")
        raise KeyboardInterrupt
    assert target.read_text() == "old"
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "deep" / "report", OURS) as beside:
        (beside / "a.txt").write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == [target]


def test_atomic_path__store_of_an_experiment__is_never_written_over(tmp_path: Path) -> None:
    target = tmp_path / "study.db"
    with closing(sqlite3.connect(target)) as store:
        store.execute("CREATE TABLE answer (id INTEGER)")
    before = target.read_bytes()
    with pytest.raises(BadInput, match="store of an experiment"):
        write_text(target, "frequency_hz,level_db_sl")
    assert target.read_bytes() == before


@pytest.mark.parametrize("writing", [atomic_path, lambda path: atomic_folder(path, OURS)])
def test_atomic__ctrl_c_as_the_place_beside_is_made__leaves_nothing(tmp_path: Path, monkeypatch, writing) -> None:
    """The handler may run as soon as the call into the system has returned; an empty file was left then."""
    came: list[Path] = []
    for name in ("open", "mkdir"):
        sound = getattr(os, name)

        def interrupted(*given, sound=sound, **more):
            answer = sound(*given, **more)
            if Path(given[0]).parent == tmp_path and not came:
                came.append(given[0])
                raise KeyboardInterrupt
            return answer

        monkeypatch.setattr(os, name, interrupted)
    with pytest.raises(KeyboardInterrupt), writing(tmp_path / "a.txt"):
        pass
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []


def test_atomic_folder__whole__takes_the_place_of_the_old_or_of_what_a_link_points_to(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("report")
    (tmp_path / "report").mkdir()
    for name in ("report", "link"):
        with atomic_folder(tmp_path / name, OURS) as beside:
            (beside / "a.txt").write_text(name)
        assert (tmp_path / "report" / "a.txt").read_text() == name
    assert (tmp_path / "link").is_symlink()
    assert sorted(tmp_path.iterdir()) == [tmp_path / "link", tmp_path / "report"]


def test_atomic__no_folder_or_a_file_in_the_way__is_refused(tmp_path: Path) -> None:
    write_text(tmp_path / "file", "x")
    # a folder that even root cannot write to is in /proc
    for writing, words in (
        (atomic_path(tmp_path / "none" / "a.txt"), "is not a folder"),
        (atomic_folder(tmp_path / "file", OURS), "is a file; allowed: a folder"),
        (atomic_folder(tmp_path / "file" / "below" / "c", OURS), "cannot be made"),
        (atomic_folder("/proc/none/report", OURS), r"cannot be (made|written)"),
    ):
        with pytest.raises(BadInput, match=words), writing:
            pass


def test_atomic_folder__files_of_others_before_or_in_between__are_kept_and_it_is_refused(tmp_path: Path) -> None:
    target = tmp_path / "report"
    target.mkdir()
    with pytest.raises(BadInput, match=r"holds other files \(thesis\.tex"), atomic_folder(target, OURS) as beside:
        (beside / "a.txt").write_text("new")
        (target / "thesis.tex").write_text("years of work")
    with pytest.raises(BadInput, match="holds other files"), atomic_folder(target, OURS):
        pass
    assert (target / "thesis.tex").read_text() == "years of work"
    assert list(tmp_path.iterdir()) == [target]


def test_atomic_folder__interrupted_between_the_renames__puts_the_old_one_back(tmp_path: Path, monkeypatch) -> None:
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
    with pytest.raises(KeyboardInterrupt), atomic_folder(target, OURS) as beside:
        (beside / "a.txt").write_text("new")
    assert (target / "a.txt").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]
