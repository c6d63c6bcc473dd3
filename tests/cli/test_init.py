"""`tactuator init`, as a newcomer uses it."""

from pathlib import Path

import pytest

from tactuator.experiment.protocol.file import read_recognition
from tactuator.io.shipped import DISPLAY_KINDS, example_names


@pytest.fixture(autouse=True)
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_init__examples__copies_them_and_names_them(empty, run) -> None:
    assert run.json("init", "--examples", ".")["written"] == list(example_names())
    assert sorted(p.relative_to(empty).as_posix() for p in empty.rglob("*") if p.is_file()) == list(example_names())


def test_init__display_and_protocol__are_written_and_named(empty, run) -> None:
    ended = run("init", "--like", "voice-coil", "--protocol", "quest-plus")
    assert ended.out.split() == ["written:", "display.toml", "written:", "protocol.toml"]
    assert "flexure" in (empty / "display.toml").read_text()


def test_init__protocol_that_presents_items_beside_a_display__brings_them_alone(empty, run) -> None:
    (empty / "display.toml").write_text("mine")
    written = run.json("init", "--protocol", "recognition")["written"]
    assert {"protocol.toml", "a.wav", "a.json", "i.wav", "u.wav"} <= set(written)
    assert all((empty / name).exists() for name in written)
    protocol, _ = read_recognition(empty / "protocol.toml")
    assert [item.label for item in protocol.item] == ["a", "i", "u"]
    assert (empty / "display.toml").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.parametrize("kind", DISPLAY_KINDS)
def test_init__every_kind__can_be_designed_and_meets_or_leaves_open_every_objective(kind: str, run) -> None:
    for words in (f"init --like {kind}", "design display.toml --out controller.json", "check controller.json"):
        assert run(*words.split()).status == 0
