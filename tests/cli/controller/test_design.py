"""`tactuator design` and `tactuator check`, as a user runs them."""

from pathlib import Path

import pytest

from tactuator.io.controller import read_controller

STATED = """
[environment]
hum_v_peak = [1e-3, 0.3e-3, 0.2e-3]
noise_v_rms = 0.2e-3
friction_v = 2e-3
presliding_v = 10e-3
"""
LOADED = 'loads = [{ name = "finger", mass = 0.12, damping = 31.0, stiffness = 360.0 }]\n'


@pytest.fixture
def display(desk: Path) -> Path:
    """The paper's display of one finger, without a load; nothing is stated of what disturbs it."""
    return desk / "display.toml"


def stated(display: Path, more: str = "") -> None:
    display.write_text(display.read_text().replace("[[channel]]", STATED + "[[channel]]") + LOADED + more)


def strict(display: Path, flatness_db: float) -> None:
    text = display.read_text().partition("[objectives]")[0]
    display.write_text(f"{text}[objectives]\nflatness_db = {flatness_db}\n")


def test_design__json_and_table__report_of_each_channel(display, run) -> None:
    report = run.json("design", display, "--out", "c.json")
    assert set(report) == {"index", "verdict"}
    assert report["verdict"]["objectives"]["i"]["outcome"] == "met"
    assert report["index"]["margins"]["crossover_hz"] == pytest.approx(20.48, abs=0.01)
    assert report["index"]["margins"]["phase_margin_deg"] == pytest.approx(55.83, abs=0.01)
    assert report["index"]["mains_db"]["60"] == pytest.approx(-11.95, abs=0.01)
    assert report["index"]["rejection_db"]["mean"] == pytest.approx(-22.51, abs=0.01)
    assert read_controller("c.json").channel("index").report == report["index"]
    shown = " ".join(run("design", display, "--out", "c.json").out.split())
    assert "phase margin (deg)" in shown
    assert "C(s) = 12.264 (s + 5) (s + 106) / (s (s + 260))" in shown
    assert "verdict: not judged (i, build: met; ii, iii, iv: not judged)" in shown


def test_design__another_curve_and_poles__taken(display, run) -> None:
    Path("mine.csv").write_text("frequency_hz,level_db_re_1um\n0.4,20\n5,15\n50,0\n300,-15\n")
    report = run.json("design", display, "--out", "c.json", "--curve", "mine.csv", "--poles", "6")
    assert report["index"]["prefilter"]["poles"] == 6
    assert read_controller("c.json").display.channels[0].threshold.curve.name == "mine"


def test_check__display_without_loads_or_environment__not_judged_and_says_why(display, run) -> None:
    """The persona whose display has no loads: an empty set used to be called met."""
    run("design", display, "--out", "c.json")
    judged = run.json("check", "c.json")
    outcomes = {number: each["outcome"] for number, each in judged["objectives"].items()}
    assert outcomes == {"i": "met", "ii": "not judged", "iii": "not judged", "iv": "not judged", "build": "met"}
    assert judged["outcome"] == "not judged"
    assert judged["objectives"]["iv"]["findings"][0]["remark"] == "the display file describes no load (loads)"
    assert len(judged["assumptions"]) == 3
    display.write_text(display.read_text().replace("[2875.0]", "[90000.0]"))
    ended = run("check", "c.json", "--display", display)
    assert ended.status == 1
    assert "unstable" in ended.out


def test_check__everything_stated__met_and_with_drawn_plants_by_their_number(display, run) -> None:
    stated(display)
    run.json("design", display, "--out", "c.json")
    judged = run.json("check", "c.json")
    assert (judged["outcome"], judged["assumptions"]) == ("met", [])
    drawn = run.json("check", "c.json", "--monte-carlo", "20")
    of_plants = [
        each for each in drawn["objectives"]["iii"]["findings"] if each["quantity"] == "max|S|, 95 % of plants"
    ]
    assert [(each["load"], each["outcome"]) for each in of_plants] == [("none", "not judged"), ("finger", "not judged")]
    assert drawn["monte_carlo"][0]["count"] == 20


def test_design__not_met__status_1_says_why_and_keeps_the_last_that_was(display, run, desk) -> None:
    out, aside, before, said = desk / "c.json", desk / "c.before.json", [], ""
    for flatness_db, status in ((1.0, 0), (0.3, 1), (0.3, 1)):
        before.append(out.read_bytes() if out.exists() else b"")
        strict(display, flatness_db)
        ended = run("design", display, "--out", out, "--json")
        said += ended.err
        assert (ended.status, aside.exists()) == (status, bool(status))
    assert (aside.read_bytes(), out.read_bytes()) == (before[1], before[2])
    assert said.count(f"is kept as {aside}") == 1
    judged = run.json("check", out, status=1)
    assert judged["outcome"] == judged["objectives"]["i"]["outcome"] == "not met"
    assert judged["objectives"]["i"]["findings"][0]["value"] > 0.3
    assert "more poles" in judged["objectives"]["i"]["findings"][0]["remark"]
    assert "not met" in run("check", out).out
