"""environment.json: what `noise --write` writes and a display file takes, and what it refuses."""

import json
from pathlib import Path

import pytest

from tactuator.errors import BadInput
from tactuator.io.display import read_display, write_environment

DISPLAY = """
[display]
rate_hz = 4000
[environment]
measured = "environment.json"
{more}
[[channel]]
name = "index"
sensor_gain_v_per_mm = 0.2
travel_mm = 12.5
plant = {{ num = [2875.0], den = [1.0, 94.0, 290.0] }}
"""
FOUND = {"hum_hz": [50.0, 100.0], "hum_v_peak": [1.5e-3, 0.25e-3], "noise_v_rms": 0.31e-3}


def shown(folder: Path, more: str = "") -> Path:
    path = folder / "display.toml"
    path.write_text(DISPLAY.format(more=more))
    return path


def test_read_display__measured__its_figures_and_friction_alone_is_assumed(tmp_path: Path) -> None:
    write_environment(tmp_path / "environment.json", {"index": FOUND})
    environment = read_display(shown(tmp_path)).channels[0].environment
    assert environment.hum_hz == (50.0, 100.0)
    assert environment.hum_v_peak == (1.5e-3, 0.25e-3)
    assert environment.noise_v_rms == 0.31e-3
    assert environment.assumed == ("friction",)


def test_read_display__measured_and_friction_stated__nothing_assumed(tmp_path: Path) -> None:
    write_environment(tmp_path / "environment.json", {"index": FOUND})
    assert read_display(shown(tmp_path, "friction_v = 0.0")).channels[0].environment.assumed == ()


def test_read_display__measured_and_stated__refused(tmp_path: Path) -> None:
    write_environment(tmp_path / "environment.json", {"index": FOUND})
    with pytest.raises(BadInput, match=r"both measured and noise_v_rms are given; allowed: one of them"):
        read_display(shown(tmp_path, "noise_v_rms = 1e-3"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "No such file"),
        ("[]", "format is not 'tactuator-environment/1'; allowed: a file that `noise --write` wrote"),
        (json.dumps({"format": "tactuator-environment/1", "channels": {"thumb": FOUND}}), "allowed: thumb"),
        (json.dumps({"format": "tactuator-environment/1"}), "'index' is not in it; allowed: none"),
        (
            json.dumps({"format": "tactuator-environment/1", "channels": {"index": {**FOUND, "noise_v_rms": -1.0}}}),
            "noise_v_rms is -1; allowed: a number, 0 or more",
        ),
        (
            json.dumps({"format": "tactuator-environment/1", "channels": {"index": {**FOUND, "hum_hz": [50.0]}}}),
            "1 hum_hz and 2 hum_v_peak",
        ),
    ],
)
def test_read_display__measured_file_that_is_none__one_line(tmp_path: Path, text: str | None, words: str) -> None:
    if text is not None:
        (tmp_path / "environment.json").write_text(text)
    with pytest.raises(BadInput, match=words) as caught:
        read_display(shown(tmp_path))
    assert "\n" not in str(caught.value)
