"""`tactuator init`, as a newcomer uses it."""

import json
from pathlib import Path

import pytest

from tactuator.cli import main
from tactuator.experiment.protocol.file import read_recognition
from tactuator.io.shipped import DISPLAY_KINDS, example_names
from tests.cli.refusals import refused


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_init__examples__copies_them_and_names_them(empty: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", "--examples", ".", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["written"] == list(example_names())
    assert sorted(p.relative_to(empty).as_posix() for p in empty.rglob("*") if p.is_file()) == list(example_names())


def test_init__display_and_protocol__are_written_and_named(empty: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", "--like", "voice-coil", "--protocol", "quest-plus"]) == 0
    assert capsys.readouterr().out.split() == ["written:", "display.toml", "written:", "protocol.toml"]
    assert "flexure" in (empty / "display.toml").read_text()


def test_init__protocol_that_presents_items__brings_them(empty: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", "--protocol", "recognition", "--json"]) == 0
    written = json.loads(capsys.readouterr().out)["written"]
    assert {"protocol.toml", "a.wav", "a.json", "i.wav", "u.wav"} <= set(written)
    assert all((empty / name).exists() for name in written)
    protocol, _ = read_recognition(empty / "protocol.toml")
    assert [item.label for item in protocol.item] == ["a", "i", "u"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--like", "maglev"], "'maglev' is no kind"),
        (["--protocol", "guess"], "'guess' is no kind"),
        (["--from", "none.json"], "none.json: No such file"),
        (["--examples", ".", "--like", "lra"], "--examples alone"),
        (["--out", "nowhere/display.toml"], "nowhere is not a folder"),
    ],
)
def test_init__bad_input__refused(
    arguments: list[str], words: str, empty: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(["init", *arguments], words, capsys, empty)


@pytest.mark.parametrize("there", ["display.toml", "protocol.toml"])
def test_init__where_a_file_is_already__refused_and_left(
    there: str, empty: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (empty / there).write_text("mine")
    refused(["init", "--like", "lra", "--protocol", "abx"], f"{there} is there already", capsys, empty)
    assert (empty / there).read_text() == "mine"


@pytest.mark.slow
@pytest.mark.parametrize("kind", DISPLAY_KINDS)
def test_init__every_kind__can_be_designed_and_meets_or_leaves_open_every_objective(kind: str, empty: Path) -> None:
    assert main(["init", "--like", kind]) == 0
    assert main(["design", "display.toml", "--out", "controller.json"]) == 0
    assert main(["check", "controller.json"]) == 0


def test_init__protocol_beside_a_display_that_is_there__is_written_alone(empty: Path) -> None:
    Path("display.toml").write_text("mine")
    assert main(["init", "--protocol", "up-down"]) == 0
    assert Path("display.toml").read_text() == "mine"
    assert "up-down" in Path("protocol.toml").read_text()
