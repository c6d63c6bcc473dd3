"""`tactuator design` and `tactuator check`, as a user runs them."""

import json
from pathlib import Path

import pytest

from tactuator.cli import main
from tactuator.io.controller import read_controller
from tests.cli.refusals import refused

STATED = """
[environment]
hum_v_peak = [1e-3, 0.3e-3, 0.2e-3]
noise_v_rms = 0.2e-3
friction_v = 4e-3
"""
PAPER = """
[display]
rate_hz = 4000
[threshold]
curve = "bolanowski-1988"
[feedback]
structure = "{structure}"
[prefilter]
poles = {poles}
[objectives]
flatness_db = {flatness}
[[channel]]
name = "index"
sensor_gain_v_per_mm = 0.19898
travel_mm = 12.5
plant = {{ num = [{num}], den = [1.0, 94.0, 290.0] }}
"""


def display(folder: Path, structure: str = "paper", poles: int = 4, flatness: float = 1.0, num: float = 2875.0) -> str:
    path = folder / "display.toml"
    path.write_text(PAPER.format(structure=structure, poles=poles, flatness=flatness, num=num))
    return str(path)


def test_design__json__one_object_with_the_report_of_each_channel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "controller.json"
    assert main(["design", display(tmp_path), "--out", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert set(report) == {"index", "verdict"}
    assert report["verdict"]["objectives"]["i"]["outcome"] == "met"
    assert report["verdict"]["objectives"]["build"]["outcome"] == "met"
    assert report["index"]["margins"]["crossover_hz"] == pytest.approx(20.48, abs=0.01)
    assert report["index"]["margins"]["phase_margin_deg"] == pytest.approx(55.83, abs=0.01)
    assert report["index"]["mains_db"]["60"] == pytest.approx(-11.95, abs=0.01)
    assert report["index"]["rejection_db"]["mean"] == pytest.approx(-22.51, abs=0.01)
    assert report["index"]["prefilter"]["poles"] == 4
    assert read_controller(out).channel("index").report == report["index"]


def test_design__table__figures_and_continuous_coefficients(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "controller.json"
    assert main(["design", display(tmp_path), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "phase margin (deg)" in shown
    assert "C(s) = 12.264 (s + 5) (s + 106) / (s (s + 260))" in " ".join(shown.split())


def test_design__another_curve_and_poles__taken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    curve = tmp_path / "mine.csv"
    curve.write_text("frequency_hz,level_db_re_1um\n0.4,20\n5,15\n50,0\n300,-15\n")
    out = tmp_path / "controller.json"
    arguments = ["design", display(tmp_path), "--out", str(out), "--curve", str(curve), "--poles", "6", "--json"]
    assert main(arguments) == 0
    assert json.loads(capsys.readouterr().out)["index"]["prefilter"]["poles"] == 6
    assert read_controller(out).display.channels[0].threshold.curve.name == "mine"


LOADED = 'loads = [{ name = "finger", mass = 0.12, damping = 31.0, stiffness = 360.0 }]\n'


def test_check__everything_stated__met_and_status_0(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, path = tmp_path / "controller.json", Path(display(tmp_path))
    path.write_text(path.read_text().replace("[[channel]]", STATED + "[[channel]]") + LOADED)
    assert main(["design", str(path), "--out", str(out), "--json"]) == 0
    capsys.readouterr()
    assert main(["check", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["outcome"] == "met"
    assert found["assumptions"] == []


def test_check__display_without_loads_or_environment__not_judged_and_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The persona whose display has no loads: an empty set used to be called met."""
    out = tmp_path / "controller.json"
    assert main(["design", display(tmp_path), "--out", str(out)]) == 0
    assert "verdict: not judged (i, build: met; ii, iii, iv: not judged)" in capsys.readouterr().out
    assert main(["check", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["outcome"] == "not judged"
    outcomes = {number: one["outcome"] for number, one in found["objectives"].items()}
    assert outcomes == {"i": "met", "ii": "not judged", "iii": "not judged", "iv": "not judged", "build": "met"}
    assert found["objectives"]["iv"]["findings"][0]["remark"] == "the display file describes no load (loads)"
    assert len(found["assumptions"]) == 3


def test_check__monte_carlo__judged_and_in_the_verdict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, path = tmp_path / "controller.json", Path(display(tmp_path))
    family = "family = [{ num = [3100.0], den = [1.0, 94.0, 290.0] }]\n"
    path.write_text(path.read_text().replace("[[channel]]", STATED + "[[channel]]") + LOADED + family)
    assert main(["design", str(path), "--out", str(out), "--json"]) == 1  # a plant of the family is 1.3 dB off
    capsys.readouterr()
    outcomes = []
    for count in ("20", "200"):
        status = main(["check", str(out), "--monte-carlo", count, "--json"])
        found = json.loads(capsys.readouterr().out)
        assert status == (found["outcome"] == "not met")
        drawn = [one for one in found["objectives"]["iii"]["findings"] if one["quantity"] == "max|S|, 95 % of plants"]
        outcomes.append({one["outcome"] for one in drawn})
        assert [one["load"] for one in drawn] == ["none", "finger"]
        assert found["monte_carlo"][0]["count"] == int(count)
    assert outcomes == [{"not judged"}, {"met"}]
    path.write_text(path.read_text().replace("3100.0", "9000.0"))
    assert main(["check", str(out), "--display", str(path), "--monte-carlo", "200"]) == 1
    assert "of 200 plants drawn from the family exceed it" in " ".join(capsys.readouterr().out.split())


def test_design__not_met_over_one_that_was_not__keeps_that_beside_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, aside, before = tmp_path / "controller.json", tmp_path / "controller.before.json", []
    for flatness, status in ((1.0, 0), (0.3, 1), (0.3, 1)):
        before.append(out.read_bytes() if out.exists() else b"")
        assert main(["design", display(tmp_path, flatness=flatness), "--out", str(out), "--json"]) == status
        assert aside.exists() == bool(status)
    assert (aside.read_bytes(), out.read_bytes()) == (before[1], before[2])
    assert capsys.readouterr().err.count(f"is kept as {aside}") == 1


def test_check__not_met__status_1_and_the_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "controller.json"
    assert main(["design", display(tmp_path, flatness=0.3), "--out", str(out), "--json"]) == 1
    capsys.readouterr()
    assert main(["check", str(out), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["outcome"] == "not met"
    assert found["objectives"]["i"]["outcome"] == "not met"
    assert found["objectives"]["i"]["findings"][0]["value"] > 0.3
    assert "more poles" in found["objectives"]["i"]["findings"][0]["remark"]
    assert main(["check", str(out)]) == 1
    assert "not met" in capsys.readouterr().out


def test_check__display_that_the_loop_cannot_hold__says_unstable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "controller.json"
    assert main(["design", display(tmp_path), "--out", str(out), "--json"]) == 0
    capsys.readouterr()
    assert main(["check", str(out), "--display", display(tmp_path, num=90_000.0)]) == 1
    assert "unstable" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("curve", "words"),
    [
        ("frequency_hz,level_db_re_1um\n1,0\n300,0\n", "2 points"),
        ("frequency_hz,level_db_re_1um\n0.4,0\n50,0\n10,1\n300,0\n", "out of order"),
        ("frequency_hz,level_db_re_1um\n0.4,0\n50,0\n50,1\n300,0\n", "stands twice"),
        ("frequency_hz,level_db_re_1um\n-1,0\n50,0\n300,0\n", "-1 Hz"),
        ("frequency_hz,level_db_re_1um\n5,0\n50,0\n100,0\n", "covers the band"),
    ],
    ids=["two points", "unsorted", "duplicate", "negative", "not covering"],
)
def test_design__curve_that_cannot_be_used__one_line_and_nothing_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], curve: str, words: str
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(curve)
    given = ["design", display(tmp_path), "--out", "FOLDER/controller.json", "--curve", str(path)]
    refused(given, words, capsys, tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("rate_hz = 4000", "rate_hz = 700"), "rate_hz is 700 for a band up to 300 Hz"),
        (("num = [2875.0]", "num = [90000.0]"), "unstable"),
    ],
    ids=["rate too low for the band", "unstable given controller"],
)
def test_design__display_that_cannot_be_designed_for__refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], words: str
) -> None:
    path = Path(display(tmp_path))
    path.write_text(path.read_text().replace(*change))
    refused(["design", str(path), "--out", "FOLDER/controller.json"], words, capsys, tmp_path)
