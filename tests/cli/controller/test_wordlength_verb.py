"""`tactuator wordlength`, as a user runs it; and controller files that are none."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tactuator.cli import main
from tactuator.io.controller import read_controller, write_controller
from tactuator.model.controller import Limits
from tactuator.wordlength.formats import FORMATS
from tests.cli.controller.controller_files import made, spoilt, unstable  # noqa: F401
from tests.cli.refusals import refused


def test_wordlength__unsafe_format_asked_for__status_1_and_every_format_with_its_figures(
    made: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["wordlength", made, "--format", "q15 biquads", "--json"]) == 1
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert err == ""
    assert set(found) == {"rate_hz", "formats", "recommended"}
    assert (found["rate_hz"], found["recommended"]) == (4000.0, "float32")
    assert [each["name"] for each in found["formats"]] == [each.name for each in FORMATS]
    figures = {"response_error_db", "roundoff_db_sl", "limit_cycle_db_sl"}
    for each in found["formats"]:
        assert set(each) == {"name", "stable", "loads", "safe", "refused"} | figures
        assert all((each[figure] is not None) == each["stable"] for figure in figures)
    assert [each["loads"] for each in found["formats"] if each["loads"]] == ["float32", "q31"]


def test_wordlength__another_rate_and_figure__drawn_and_told(
    made: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "figures"
    assert main(["wordlength", made, "--rate", "2000", "--figures", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["rate_hz"] == 2000.0
    assert found["figures"] == str(folder)
    assert sorted(path.name for path in folder.iterdir()) == ["resolution.csv", "resolution.svg"]
    bits = found["resolution_bits"]
    assert set(bits) == {"prefilter", "feedback"}
    assert list(bits["prefilter"]["sections"]) == ["2000", "4000", "8000", "16000"]
    assert set(bits["prefilter"]["sections"]["8000"]) == {"stable", "accurate"}


def test_wordlength__table__says_what_it_recommends(made: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["wordlength", made, "--format", "q31"]) == 0
    shown = capsys.readouterr().out
    assert "recommended: float32" in shown
    assert "q31 biquads fed back" in shown


def test_wordlength__nothing_that_loads_is_safe__status_1(made: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["wordlength", unstable(made), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["recommended"] is None
    assert main(["wordlength", made]) == 1
    assert "recommended: none of what a board runs" in " ".join(capsys.readouterr().out.split())


def test_wordlength__what_q31_cannot_hold__is_told_beside_the_others(
    made: str, capsys: pytest.CaptureFixture[str]
) -> None:
    narrow = read_controller(made)
    channels = tuple(replace(one, converter=replace(one.converter, range_v=20.0)) for one in narrow.display.channels)
    write_controller(made, replace(narrow, display=replace(narrow.display, channels=channels)))
    assert main(["wordlength", spoilt(made, limits=Limits(20.0, 2.0))]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "recommended: float32" in shown
    assert "q31: channel 'index': command_v is 20; allowed: at most 15 V in Q31." in shown


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rate", "100"], "rate_hz is 100 for a band up to 300 Hz; allowed: 1200 or more"),
        (["--rate", "nan"], "rate_hz is nan; allowed"),
        (["--rate", "-4000"], "rate_hz is -4000; allowed"),
        (["--rate", "fast"], "'fast'"),
        (["--format", "q16"], "format is 'q16'; allowed: q15 biquads"),
        (["--figures", "FOLDER"], "holds other files"),
        (["surplus"], "surplus"),
    ],
)
def test_wordlength__misused__is_refused(
    options: list[str], words: str, made: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(["wordlength", made, *options], words, capsys, tmp_path)


NOT_CONTROLLERS = {
    "nothing": (None, "No such file or directory"),
    "not JSON": ("{", "it is not JSON"),
    "not text": (b"\xff\xfe\x00", "it is not text"),
    "another file": ("{}", "format is None; allowed: 'tactuator-controller/1'"),
    "a list": ("[]", "format is 'list'"),
    "a later version": ('{"format": "tactuator-controller/2"}', "format is 'tactuator-controller/2'; allowed"),
    "changed by hand": ("CHANGED", "its hash does not fit its contents; allowed: a file as `design` wrote it"),
}


@pytest.mark.parametrize(("content", "words"), NOT_CONTROLLERS.values(), ids=NOT_CONTROLLERS)
def test_controller_file__that_is_none__is_refused(content, words, made, tmp_path, capsys) -> None:
    """Which verb reads it makes no difference: `test_kinds` holds a file of every other kind against each."""
    path = tmp_path / "bad.json"
    if content == "CHANGED":
        path.write_text(Path(made).read_text().replace("4000.0", "4001.0"))
    elif content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    refused(["wordlength", str(path)], words, capsys, tmp_path)
