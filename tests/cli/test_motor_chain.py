"""From the record of a motor with friction and no spring to a controller that is checked, as a user types it."""

import json

import h5py
import numpy as np
import pytest

from tests.identification.motors import motor

DISPLAY = """
[display]
name = "motor"
rate_hz = 1000
delay_samples = 1
[threshold]
curve = "bolanowski-1988"
band_hz = [0.4, 30.0]
[feedback]
command_noise_gain_max = {noise_gain:g}
rejection_band_hz = [0.4, 5.0]
[[channel]]
name = "index"
sensor_gain_v_per_mm = 0.05
travel_mm = 12.5
plant = "model.json"
"""


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, 20))])
def test_motor__from_record_to_check__is_designed(desk, run, seed: int) -> None:
    truth, command, position = motor(np.random.default_rng(seed), duration_s=12.0, steps=20)
    with h5py.File("motor.h5", "w") as file:
        file.attrs["rate_hz"] = 1000.0
        file["command_v"], file["position_v"] = command, position
    answer = run.json("identify", "motor.h5", "--out", "model.json")
    assert answer["model"]["num"][0] == pytest.approx(truth["gain"], rel=0.02)
    assert answer["model"]["den"][1] == pytest.approx(truth["damping"], rel=0.05)
    assert answer["friction"]["coulomb"] == pytest.approx(truth["coulomb"], rel=0.05)
    assert answer["friction"]["offset"] == pytest.approx(truth["offset"], rel=0.1)
    # a crossover of some hertz takes a controller of this gain, whatever the motor's own
    (desk / "motor.toml").write_text(DISPLAY.format(noise_gain=6000.0 / truth["gain"]))
    assert run("design", "motor.toml", "--out", "c.json").status in (0, 1)
    designed = json.loads((desk / "c.json").read_text())
    assert designed["channels"][0]["report"]["margins"]["phase_margin_deg"] >= 49.9
    ended = run("check", "c.json", "--json")
    assert ended.status in (0, 1)
    assert "outcome" in json.loads(ended.out)
