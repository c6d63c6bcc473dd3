"""People whom the tool misled, and what it has to tell them: an open-loop LRA under a finger, an identified voice coil
with hum, a display that describes no loads. What a verdict says of each alone: tests/synthesis/test_objectives.
"""

import json
from pathlib import Path

import numpy as np

from tactuator.io.controller import read_controller
from tactuator.io.display import read_display
from tactuator.measure.noise import felt_noise
from tactuator.rig.simulated import SimulatedRig
from tactuator.synthesis.objectives import judge

DISPLAY = """
[display]
rate_hz = {rate_hz}
[threshold]
band_hz = [{low_hz}, 300.0]
[feedback]
structure = "{structure}"
[environment]
{environment}
[[channel]]
name = "index"
sensor_gain_v_per_mm = {sensor}
travel_mm = {travel}
plant = {plant}
"""
MOTOR = {
    "rate_hz": 4000, "low_hz": 0.4, "structure": "paper", "sensor": 0.2, "travel": 12.5,
    "plant": "{ num = [2875.0], den = [1.0, 94.0, 290.0] }",
}  # fmt: skip
LRA = {
    "rate_hz": 8000, "low_hz": 40.0, "structure": "none", "sensor": 1.0, "travel": 1.0,
    "plant": "{ num = [1208902.0], den = [1.0, 73.3, 1208902.0] }",
}  # fmt: skip
FINGER = 'loads = [{ name = "finger", mass = 0.1, damping = 60.0, stiffness = 40000.0 }]\n'
HUM = (1e-3, 3e-4, 2e-4)


def environment(friction: str = "friction_v = 0.0", hum=HUM) -> str:
    return f"hum_v_peak = {list(hum)}\nnoise_v_rms = 0.2e-3\n{friction}"


def written(path: Path, of: dict[str, object], more: str = "", **changes: object) -> Path:
    path.write_text(DISPLAY.format(**{"environment": environment(), **of, **changes}) + more)
    return path


def designed(folder: Path, run, of: dict[str, object], more: str = "") -> tuple[str, Path]:
    assert run("design", written(folder / "d.toml", of, more), "--out", folder / "c.json").status in (0, 1)
    return "--controller", folder / "c.json"


def agreement_db(folder: Path, seed: int, run) -> np.ndarray:
    """Identify a voice coil with hum and friction from a record, design for the model, and compare what `check` says of
    every mains line with what is felt on the true display."""
    rng = np.random.default_rng(seed)
    hum = (np.array(HUM) * np.exp(rng.uniform(-0.5, 1.2, 3))).tolist()
    num, drag, spring = 2875.0 * np.exp(rng.uniform(-0.5, 0.7)), 94.0 * np.exp(rng.uniform(-0.7, 0.5)), 290.0
    friction = f"friction_v = {rng.choice([0.0, 2e-3, 4e-3, 8e-3])}"
    plant = f"{{ num = [{num}], den = [1.0, {drag}, {spring}] }}"
    true = written(folder / "true.toml", MOTOR, plant=plant, environment=environment(friction, hum))
    assert run("record", true, "--duration-s", "12", "--out", folder / "r.h5", "--seed", seed).status == 0
    assert run("identify", folder / "r.h5", "--out", folder / "m.json").status == 0
    model = written(folder / "model.toml", MOTOR, plant='"m.json"', environment=environment("", hum))
    assert run("design", model, "--out", folder / "c.json").status in (0, 1)  # by its friction
    controller = read_controller(folder / "c.json")
    rig = SimulatedRig(read_display(true), seed)
    rig.load(controller)
    heard = felt_noise(rig, controller.display)[0]
    levels = dict(zip(heard.line_hz.tolist(), heard.line_db_sl.tolist(), strict=True))
    lines = judge(controller).objectives[1].findings
    return np.array([(line.value or 0.0) - levels[line.frequency_hz or 0.0] for line in lines])


def test_check_and_noise__identified_voice_coil_with_hum__agree_on_every_mains_line(tmp_path, run) -> None:
    """The persona whose two verdicts contradicted each other: friction that nobody had measured was assumed."""
    assert np.max(np.abs(agreement_db(tmp_path, 0, run))) <= 0.5


def test_loop_or_display__unstable_or_without_loads__is_not_played_or_answers(tmp_path, run) -> None:
    of = designed(tmp_path, run, MOTOR)
    heard = json.loads(run("measure", "noise", *of, "--gains", "4,5000", "--duration-s", "3", "--json").out)
    assert [played["under"] for played in heard["runs"]] == ["gain 4", "loop"]
    assert "unstable" in heard["not_played"]["gain 5000"]
    wild = written(tmp_path / "wild.toml", MOTOR, plant="{ num = [90000.0], den = [1.0, 94.0, 290.0] }")
    for what in ("noise", "response", "disturbance", "load"):
        run.refused("measure", what, *of, "--display", wild, said="call the loop of index unstable")
    for words in (
        "measure response --frequency-hz 20",
        "measure noise --gains= --duration-s 3",
        "measure disturbance --frequency-hz 5",
    ):
        assert run(*words.split(), *of).status == 0


def test_open_loop_lra__noise_and_measure__close_no_loop_and_call_no_load_met(tmp_path, run) -> None:
    """`measure noise` used to close proportional loops around it, and `check` to call its hum and its finger met."""
    of = designed(tmp_path, run, LRA, FINGER)
    heard = run.json("measure", "noise", *of, "--duration-s", "3")
    assert [played["under"] for played in heard["runs"]] == ["loop"]
    assert set(heard["not_played"].values()) == {"the display is driven without a loop: there is nothing to close"}
    assert {objective["outcome"] for objective in heard["objectives"].values()} == {"not judged"}
    measured = run.json("measure", "response", *of, "--load", "finger", "--frequency-hz", "175")
    assert measured["outcome"] == "not judged"
    (finding,) = (each for each in measured["objectives"]["i"]["findings"] if each["load"] == "finger")
    assert finding["remark"].startswith("for information only")
    judged = run.json("check", of[1], status=1)  # near its resonance a tone of 10 dB SL is under half a step
    assert {number: each["outcome"] for number, each in judged["objectives"].items()} == {
        "i": "not met", "ii": "not judged", "iii": "met", "iv": "not judged", "build": "met"
    }  # fmt: skip
    assert "-6.67 dB at 177 Hz" in judged["objectives"]["iv"]["findings"][0]["remark"]
    of = designed(tmp_path, run, LRA, FINGER + "[objectives]\nflatness_db = 0.03\n")
    measured = run.json("measure", "response", *of, "--method", "multisine", "--frequency-hz", "75,110,175", status=1)
    assert measured["outcome"] == "not met"


def test_noise__what_it_measured__is_what_check_then_judges_by(tmp_path, run) -> None:
    """A display whose file says nothing of hum and noise is not judged; with what `measure noise` wrote it is."""
    silent = MOTOR | {"environment": "friction_v = 0.0"}
    of = designed(tmp_path, run, silent)
    before = run.json("check", of[1])
    assert before["objectives"]["ii"]["outcome"] == before["objectives"]["iii"]["outcome"] == "not judged"
    measured = tmp_path / "environment.json"
    heard = run.json("measure", "noise", *of, "--gains", "", "--write", measured)
    sensor = heard["runs"][-1]["channels"][0]["sensor"]
    assert json.loads(measured.read_text())["channels"] == {"index": sensor}
    stated = 'measured = "environment.json"\nfriction_v = 0.0'
    after = run.json("check", of[1], "--display", written(tmp_path / "d.toml", MOTOR, environment=stated))
    assert after["objectives"]["ii"]["outcome"] == after["objectives"]["iii"]["outcome"] == "met"
    assert after["assumptions"] == []
