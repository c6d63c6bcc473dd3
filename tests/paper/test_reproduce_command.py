"""`tactuator reproduce` as a command: what it prints, leaves behind and refuses."""

import json
import wave
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactuator.cli import main
from tactuator.paper import report as publish
from tactuator.paper import run as reproduce
from tactuator.paper.plan import Plan, paper_display
from tactuator.paper.run import PaperStudy
from tactuator.paper.steps import check_speech
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


def written(path: Path, samples: np.ndarray, rate: int = 16000, subtype: str = "PCM_16") -> Path:
    soundfile.write(path, samples, rate, subtype=subtype)
    return path


def tone(seconds: float) -> np.ndarray:
    return 0.3 * np.sin(2.0 * np.pi * 150.0 * np.arange(round(seconds * 16000)) / 16000)


@pytest.fixture
def bad_files(tmp_path: Path) -> dict[str, Path]:
    (tmp_path / "empty.wav").write_bytes(b"")
    (tmp_path / "text.wav").write_text("not sound at all, but long enough to look at")
    whole = written(tmp_path / "whole.wav", tone(1.0)).read_bytes()
    (tmp_path / "truncated.wav").write_bytes(whole[: len(whole) // 2])
    with_nan = tone(1.0)
    with_nan[700] = np.nan
    return {
        "missing": tmp_path / "none.wav",
        "empty": tmp_path / "empty.wav",
        "text": tmp_path / "text.wav",
        "truncated": tmp_path / "truncated.wav",
        "silent": written(tmp_path / "silent.wav", np.zeros(16000)),
        "short": written(tmp_path / "short.wav", tone(0.01)),
        "absurd": written(tmp_path / "absurd.wav", 1e200 * tone(1.0), subtype="DOUBLE"),
        "nan": written(tmp_path / "nan.wav", with_nan, subtype="FLOAT"),
    }


@pytest.mark.parametrize("kind", ["missing", "empty", "text", "truncated", "silent", "short", "absurd", "nan"])
def test_reproduce__bad_speech__is_refused_in_one_line(
    kind: str, bad_files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "--out", str(tmp_path / "paper"), "--speech", str(bad_files[kind])]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "allowed" in said
    assert not (tmp_path / "paper").exists()


def test_speech_file__stereo_8_bit_and_24_bit__are_read(tmp_path: Path) -> None:
    stereo = written(tmp_path / "stereo.wav", np.column_stack([tone(0.5), 0.5 * tone(0.5)]))
    assert check_speech(Plan(paper_display(), speech=stereo)).notes == ("2 channels mixed down to one (their mean)",)
    fine = written(tmp_path / "fine.flac", tone(0.5), subtype="PCM_24")
    assert check_speech(Plan(paper_display(), speech=fine)).duration_s == pytest.approx(0.5)
    with wave.open(str(tmp_path / "coarse.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(1)
        file.setframerate(16000)
        file.writeframes((127.5 + 100.0 * tone(0.5)).astype(np.uint8).tobytes())
    assert check_speech(Plan(paper_display(), speech=tmp_path / "coarse.wav")).peak > 0.1


def test_seed_of__same_plan__is_the_same_and_differs_by_step() -> None:
    first, again = Plan(paper_display(), 7), Plan(paper_display(), 7)
    assert first.seed_of("a") == again.seed_of("a")
    assert len({first.seed_of("a"), first.seed_of("b"), Plan(paper_display(), 8).seed_of("a")}) == 3
