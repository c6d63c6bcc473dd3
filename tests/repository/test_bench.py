"""The benchmark runner."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from benchmarks import run as bench
from tactuator.io.columns import read_columns
from tactuator.io.shipped import EXAMPLES, example_names
from tools.examples import write_all


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "FOLDER", tmp_path)
    monkeypatch.setattr(bench, "REPORT", tmp_path / "out" / "bench.json")
    (tmp_path / "bench_echo.py").write_text(
        "def run():\n    return {'ratio': 2.5, 'rates': {'own': 1e7, 'met': True}}\n"
    )
    return tmp_path


def test_bench__every_module__is_run_shown_and_written(folder, capsys):
    assert bench.main([]) == 0
    report = json.loads((folder / "out" / "bench.json").read_text())
    assert report["echo"] == {"ratio": 2.5, "rates": {"own": 1e7, "met": True}}
    assert set(report["machine"]) == {"machine", "cores", "python"}
    assert "rates.own" in capsys.readouterr().out


def test_bench__unknown_name__is_refused_in_one_line(folder, capsys):
    assert bench.main(["ecco"]) == 2
    assert capsys.readouterr().err == "no benchmark 'ecco'; there are echo\n"
    assert not (folder / "out").exists()


def test_bench__in_the_repository__each_has_run():
    for path in bench.available().values():
        assert "def run() -> dict" in path.read_text(encoding="utf-8"), path.name


HAND_WRITTEN = {"README.md", "bench.toml", "display.toml", "protocol.toml"}


def is_generated(name: str) -> bool:
    """Return whether the tool writes the file; displays and protocols are written by hand."""
    return name not in HAND_WRITTEN and not (name.endswith(".toml") and "/" in name)


def same(one: Path, other: Path) -> bool:
    """Return whether two files hold the same: numbers but for the last digit, samples but for half a bit of sixteen."""
    if one.suffix in {".wav", ".flac"}:
        return bool(np.allclose(soundfile.read(one)[0], soundfile.read(other)[0], atol=2.0**-15))
    if one.name in {"bench.csv", "sheet.csv"}:
        columns = (read_columns(path).values for path in (one, other))
        mine, theirs = (np.array(list(values.values())) for values in columns)
        return bool(np.allclose(mine, theirs, atol=1e-3))
    return one.suffix == ".json" or one.read_bytes() == other.read_bytes()


@pytest.mark.slow
def test_examples__written_anew__are_those_that_are_shipped(tmp_path: Path) -> None:
    (tmp_path / "protocols").mkdir()
    write_all(tmp_path)
    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert written == {name for name in example_names() if is_generated(name)}
    assert [name for name in sorted(written) if not same(EXAMPLES / name, tmp_path / name)] == []
