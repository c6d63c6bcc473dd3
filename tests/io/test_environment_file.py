"""environment.json: what `noise --write` writes and a display file takes, and what it refuses."""

import json
from pathlib import Path

import pytest

from tactuator.errors import BadInput
from tactuator.io.display import read_display, write_environment
from tactuator.model.description import Environment

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


def environment(folder: Path, more: str = "") -> Environment:
    (folder / "display.toml").write_text(DISPLAY.format(more=more))
    return read_display(folder / "display.toml").channels[0].environment


def test_read_display__measured__its_figures_and_friction_alone_is_assumed(tmp_path: Path) -> None:
    write_environment(tmp_path / "environment.json", {"index": FOUND})
    read = environment(tmp_path)
    assert (read.hum_hz, read.hum_v_peak, read.noise_v_rms) == ((50.0, 100.0), (1.5e-3, 0.25e-3), 0.31e-3)
    assert read.assumed == ("friction",)
    assert environment(tmp_path, "friction_v = 0.0").assumed == ()
    assert environment(tmp_path, "friction_v = 4e-3").assumed == ("presliding",)
    assert environment(tmp_path, "friction_v = 4e-3\npresliding_v = 5e-3").assumed == ()
    with pytest.raises(BadInput, match=r"both measured and noise_v_rms are given; allowed: one of them"):
        environment(tmp_path, "noise_v_rms = 1e-3")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "No such file"),
        ("[]", "format is not 'tactuator-environment/1'; allowed: a file that `noise --write` wrote"),
        ({"thumb": FOUND}, "allowed: thumb"),
        ({}, "'index' is not in it; allowed: none"),
        ({"index": {**FOUND, "noise_v_rms": -1.0}}, "noise_v_rms is -1; allowed: a number, 0 or more"),
        ({"index": {**FOUND, "hum_hz": [50.0]}}, "1 hum_hz and 2 hum_v_peak"),
    ],
)
def test_read_display__measured_file_that_is_none__one_line(tmp_path: Path, text, words: str) -> None:
    if isinstance(text, dict):
        text = json.dumps({"format": "tactuator-environment/1", **({"channels": text} if text else {})})
    if text is not None:
        (tmp_path / "environment.json").write_text(text)
    with pytest.raises(BadInput, match=words) as caught:
        environment(tmp_path)
    assert "\n" not in str(caught.value)
