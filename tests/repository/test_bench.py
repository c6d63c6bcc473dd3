"""The benchmark runner."""

import json

import pytest

from benchmarks import run as bench


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
