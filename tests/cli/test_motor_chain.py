"""From the record of a motor with friction and no spring to a controller that is checked, as a user types it."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from tactuator.cli.main import main
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


def chain(folder: Path, seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Identify a motor's record, design with its model and check the controller; all must be answered."""
    truth, command, position = motor(np.random.default_rng(seed), duration_s=12.0, steps=20)
    with h5py.File(folder / "motor.h5", "w") as file:
        file.attrs["rate_hz"] = 1000.0
        file["command_v"], file["position_v"] = command, position
    assert main(["identify", str(folder / "motor.h5"), "--out", str(folder / "model.json"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["model"]["num"][0] == pytest.approx(truth["gain"], rel=0.02)
    assert found["model"]["den"][1] == pytest.approx(truth["damping"], rel=0.05)
    assert found["friction"]["coulomb"] == pytest.approx(truth["coulomb"], rel=0.05)
    assert found["friction"]["offset"] == pytest.approx(truth["offset"], rel=0.1)
    # a crossover of some hertz takes a controller of this gain, whatever the motor's own
    (folder / "display.toml").write_text(DISPLAY.format(noise_gain=6000.0 / truth["gain"]))
    out = str(folder / "controller.json")
    assert main(["design", str(folder / "display.toml"), "--out", out, "--json"]) in (0, 1)
    designed = json.loads(Path(out).read_text())
    assert designed["channels"][0]["report"]["margins"]["phase_margin_deg"] >= 49.9
    capsys.readouterr()
    assert main(["check", out, "--json"]) in (0, 1)
    assert "outcome" in capsys.readouterr().out


@pytest.mark.slow
def test_motor__from_record_to_check__is_designed(tmp_path: Path, capsys) -> None:
    chain(tmp_path, 0, capsys)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(1, 20))
def test_twenty_motors__from_record_to_check__are_designed(tmp_path: Path, capsys, seed: int) -> None:
    chain(tmp_path, seed, capsys)
