"""`tactuator reproduce` as a command: what it prints, leaves behind and refuses."""

import json
from pathlib import Path

import pytest

from tactuator.cli import main
from tactuator.paper import report as publish
from tactuator.paper import run as reproduce
from tactuator.paper.plan import Plan, paper_display
from tactuator.paper.run import PaperStudy
from tests.paper.conftest import Reproduced


def test_reproduce__json__is_one_object_and_the_folder_is_whole(reproduced: Reproduced) -> None:
    summary = json.loads((reproduced.folder / "summary.json").read_text())
    assert json.loads(reproduced.printed) == summary
    assert {entry.name for entry in reproduced.folder.iterdir()} == {"report.html", "figures", "summary.json"}


def test_reproduce__table__says_what_became_of_the_speech_file(
    study: PaperStudy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reproduce, "run_study", lambda plan, file, tell: study)
    monkeypatch.setattr(publish, "publish", lambda study, folder: None)  # what it writes is the test above
    assert main(["reproduce", "--out", str(tmp_path / "paper")]) == 0
    assert "objective iv" in capsys.readouterr().out


def test_reproduce__interrupted__leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(plan: Plan, file: object, tell: object) -> PaperStudy:
        raise KeyboardInterrupt

    monkeypatch.setattr(reproduce, "run_study", interrupted)
    assert main(["reproduce", "--out", str(tmp_path / "deep" / "paper")]) == 130
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err.strip() == "tactuator: interrupted"


def test_reproduce__speech_that_is_none__is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "text.wav").write_text("not sound at all, but long enough to look at")
    for name in ("none.wav", "text.wav"):
        assert main(["reproduce", "--out", str(tmp_path / "paper"), "--speech", str(tmp_path / name)]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "allowed" in said
        assert not (tmp_path / "paper").exists()


def test_seed_of__same_plan__is_the_same_and_differs_by_step() -> None:
    first, again = Plan(paper_display(), 7), Plan(paper_display(), 7)
    assert first.seed_of("a") == again.seed_of("a")
    assert len({first.seed_of("a"), first.seed_of("b"), Plan(paper_display(), 8).seed_of("a")}) == 3
