"""`tactuator design` and `check`, as a user runs them, and on forged controllers: what is met, `build` accepts."""

import copy
import hashlib
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.controller import parse_controller, read_controller
from tactuator.model.controller import Controller
from tactuator.model.verdict import Outcome
from tactuator.synthesis.objectives import whole_verdict
from tactuator.wordlength.float32_check import built
from tests.synthesis.displays import paper_controller, three_finger_controller

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


def test_design__json_table_curve_and_poles__report_of_each_channel(display, run) -> None:
    report = run.json("design", display, "--out", "c.json")
    assert set(report) == {"index", "verdict"}
    assert report["verdict"]["objectives"]["i"]["outcome"] == "met"
    assert report["index"]["margins"]["crossover_hz"] == pytest.approx(20.48, abs=0.01)
    assert report["index"]["margins"]["phase_margin_deg"] == pytest.approx(55.83, abs=0.01)
    assert report["index"]["mains_db"]["60"] == pytest.approx(-11.95, abs=0.01)
    assert report["index"]["rejection_db"]["mean"] == pytest.approx(-22.51, abs=0.01)
    assert read_controller("c.json").channel("index").report == report["index"]
    shown = " ".join(run("design", display, "--out", "c.json", "--full").out.split())
    assert "phase margin (deg)" in shown
    assert "C(s) = 12.264 (s + 5) (s + 106) / (s (s + 260))" in shown
    assert "verdict not judged (i, build: met; ii, iii, iv: not judged)" in shown
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


EXTREMES = (0.0, -1.0, 1e-300, 1e6, -1e6, 1e300, 0.5, 2.0)


def forged(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    forgery = copy.deepcopy(document)
    for _ in range(int(rng.integers(1, 4))):
        channel = forgery["channels"][int(rng.integers(len(forgery["channels"])))]
        place = int(rng.integers(5))
        sections = channel["prefilter_sos" if place == 3 or channel["feedback_sos"] is None else "feedback_sos"]
        part, key = [
            (channel, "threshold_voltage_dc"),
            (channel["limits"], str(rng.choice(["command_v", "travel_v", "comfort_db_sl"]))),
            (channel["anti_windup"]["gains"], int(rng.integers(2))),
            *(2 * [(sections[int(rng.integers(len(sections)))], int(rng.integers(6)))]),
        ][place]
        part[key] = _changed(part[key], rng)
    return resealed(forgery)


def resealed(document: dict[str, Any]) -> dict[str, Any]:
    bare = {key: value for key, value in document.items() if key != "hash"}
    text = json.dumps(bare, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return {**bare, "hash": hashlib.sha256(text.encode()).hexdigest()}


def _changed(value: float, rng: np.random.Generator) -> float:
    kind = rng.random()
    if kind < 0.4:
        return float(rng.choice(EXTREMES))
    return float(value * (np.exp(rng.normal(0.0, 1.0)) if kind < 0.7 else 1.0 + rng.normal(0.0, 1e-4)))


def judged(document: dict[str, object]) -> str:
    """Return what becomes of a forged controller; fails where `check` and `build` part."""
    try:
        controller = parse_controller(document)
        for channel, described in zip(controller.channels, controller.display.channels, strict=True):
            assert channel.threshold_voltage_dc > 0.0
            assert 0.0 < channel.limits.command_v <= described.converter.range_v * 1.001
            assert channel.limits.travel_v > 0.0
            assert 0.0 < channel.limits.comfort_db_sl <= controller.display.objectives.comfort_db_sl * 1.001
        verdict = whole_verdict(controller)
    except BadInput:
        return "refused"
    if verdict.outcome is not Outcome.NOT_MET:
        assert built(controller)[0]
    return verdict.outcome.value


def tally(count: int, seed: int) -> Counter[str]:
    three, rng = three_finger_controller(), np.random.default_rng(seed)
    display = replace(three.display, channels=three.display.channels[:1])
    document = Controller(display, three.channels[:1], three.tool).document()
    return Counter(judged(forged(document, rng)) for _ in range(count))


@pytest.mark.parametrize(("count", "seed"), [(25, 1), pytest.param(10_000, 2, marks=pytest.mark.soak)])
def test_check__forged_controllers__what_is_met_is_built(count: int, seed: int) -> None:
    counted = tally(count, seed)
    assert min(counted["refused"], counted["met"], counted["not met"]) > count // 20


def test_controller__limit_of_a_million_volts__refused_with_a_hash_that_fits_too() -> None:
    """It used to be called met."""
    document = paper_controller().document()
    document["channels"][0]["limits"]["command_v"] = 1e6
    with pytest.raises(BadInput, match="hash"):
        parse_controller(document)
    with pytest.raises(BadInput, match=r"limits: command_v is 1e\+06; it must be above 0, at most 10 V"):
        parse_controller(resealed(document))
