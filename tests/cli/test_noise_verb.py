"""`check` and `noise` about one controller, and loops that `noise` does not close."""

import json
from pathlib import Path

import numpy as np
import pytest

from tactuator.cli import main
from tactuator.io.controller import read_controller
from tactuator.io.display import read_display
from tactuator.measure.noise import felt_noise
from tactuator.rig.simulated import SimulatedRig
from tactuator.synthesis.verdict import judge

DISPLAY = """
[display]
rate_hz = 4000
[feedback]
structure = "{structure}"
[environment]
hum_v_peak = [{hum[0]}, {hum[1]}, {hum[2]}]
noise_v_rms = 0.2e-3
{friction}
[[channel]]
name = "index"
sensor_gain_v_per_mm = 0.2
travel_mm = 12.5
plant = {plant}
"""
HUM = (1e-3, 3e-4, 2e-4)
MOTOR = "{ num = [2875.0], den = [1.0, 94.0, 290.0] }"
LRA = "{ num = [1208902.0], den = [1.0, 73.3, 1208902.0] }"


def written(
    path: Path, structure: str = "paper", plant: str = MOTOR, friction: str = "friction_v = 0.0", hum=HUM
) -> str:
    path.write_text(DISPLAY.format(structure=structure, plant=plant, friction=friction, hum=hum))
    return str(path)


def agreement_db(folder: Path, seed: int) -> np.ndarray:
    """Identify a voice coil with hum and friction from a record, design for the model, and compare what `check` says of
    every mains line with what is felt on the true display."""
    rng = np.random.default_rng(seed)
    hum = (np.array(HUM) * np.exp(rng.uniform(-0.5, 1.2, 3))).tolist()
    num, drag, spring = 2875.0 * np.exp(rng.uniform(-0.5, 0.7)), 94.0 * np.exp(rng.uniform(-0.7, 0.5)), 290.0
    friction = f"friction_v = {rng.choice([0.0, 2e-3, 4e-3, 8e-3])}"
    plant = f"{{ num = [{num}], den = [1.0, {drag}, {spring}] }}"
    true = written(folder / "true.toml", plant=plant, friction=friction, hum=hum)
    record, model, made = (str(folder / name) for name in ("r.h5", "m.json", "c.json"))
    assert main(["record", true, "--duration-s", "12", "--out", record, "--seed", str(seed), "--json"]) == 0
    assert main(["identify", record, "--out", model, "--json"]) == 0
    found = written(folder / "found.toml", plant='"m.json"', friction="", hum=hum)
    assert main(["design", found, "--out", made, "--json"]) == 0
    controller = read_controller(made)
    lines = judge(controller).objectives[1].findings
    rig = SimulatedRig(read_display(true), seed)
    rig.load(controller)
    heard = felt_noise(rig, controller.display)[0]
    levels = dict(zip(heard.line_hz.tolist(), heard.line_db_sl.tolist(), strict=True))
    return np.array([(one.value or 0.0) - levels[one.frequency_hz or 0.0] for one in lines])


def test_check_and_noise__identified_voice_coil_with_hum__agree_on_every_mains_line(tmp_path: Path) -> None:
    """The persona whose two verdicts contradicted each other: friction that nobody had measured was assumed."""
    assert np.max(np.abs(agreement_db(tmp_path, 0))) <= 0.5


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(10))
def test_check_and_noise__ten_identified_actuators__agree_on_every_mains_line(tmp_path: Path, seed: int) -> None:
    assert np.max(np.abs(agreement_db(tmp_path, seed))) <= 0.5


def test_noise__gain_whose_loop_is_unstable__is_named_and_not_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = str(tmp_path / "c.json")
    assert main(["design", written(tmp_path / "d.toml"), "--out", made, "--json"]) == 0
    capsys.readouterr()
    main(["noise", "--controller", made, "--gains", "4,5000", "--duration-s", "3", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert [run["under"] for run in found["runs"]] == ["gain 4", "loop"]
    assert "unstable" in found["not_played"]["gain 5000"]


def test_verbs_that_close_the_loop__controller_unstable_on_the_named_display__refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = str(tmp_path / "c.json")
    assert main(["design", written(tmp_path / "d.toml"), "--out", made, "--json"]) == 0
    wild = written(tmp_path / "wild.toml", plant="{ num = [90000.0], den = [1.0, 94.0, 290.0] }")
    capsys.readouterr()
    for verb in (["noise", "--gains", ""], ["measure"], ["disturb"]):
        assert main([*verb, "--controller", made, "--display", wild, "--json"]) == 2
        assert "call the loop of index unstable" in capsys.readouterr().err


def test_noise__display_without_a_loop__closes_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The persona with an open-loop LRA: `noise` used to close proportional loops around it."""
    made = str(tmp_path / "c.json")
    assert (
        main(["design", written(tmp_path / "d.toml", "none", LRA), "--out", made, "--json"]) == 1
    )  # not flat within 1 dB
    capsys.readouterr()
    assert main(["noise", "--controller", made, "--duration-s", "3", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [run["under"] for run in found["runs"]] == ["loop"]
    assert set(found["not_played"].values()) == {"the display is driven without a loop: there is nothing to close"}
    assert {one["outcome"] for one in found["objectives"].values()} == {"not judged"}


def test_noise__what_it_measured__is_what_check_then_judges_by(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A display whose file says nothing of hum and noise: not judged; with what `noise` told of it put in: judged."""
    made, path = str(tmp_path / "c.json"), tmp_path / "d.toml"
    silent = DISPLAY.split("[environment]")[0] + "[environment]\nfriction_v = 0.0\n[[channel]]"
    text = silent + DISPLAY.split("[[channel]]")[1]
    path.write_text(text.format(structure="paper", plant=MOTOR))
    assert main(["design", str(path), "--out", made, "--json"]) == 0
    assert main(["check", made, "--json"]) == 0
    measured = tmp_path / "environment.json"
    assert main(["noise", "--controller", made, "--gains", "", "--json", "--write", str(measured)]) == 0
    *_, before, heard = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert before["objectives"]["ii"]["outcome"] == before["objectives"]["iii"]["outcome"] == "not judged"
    sensor = heard["runs"][-1]["channels"][0]["sensor"]
    assert json.loads(measured.read_text())["channels"] == {"index": sensor}
    path.write_text(path.read_text().replace("friction_v", 'measured = "environment.json"\nfriction_v'))
    assert main(["check", made, "--display", str(path), "--json"]) == 0
    after = json.loads(capsys.readouterr().out)
    assert after["objectives"]["ii"]["outcome"] == after["objectives"]["iii"]["outcome"] == "met"
    assert after["assumptions"] == []
