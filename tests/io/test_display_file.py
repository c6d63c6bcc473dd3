"""Display files: what is read, what is written back, what is refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.display import parse_display, read_display, with_curve
from tactuator.model.description import Display, display_document
from tactuator.perception.curve import curve

DISPLAY = """
[display]
rate_hz = 4000
[threshold]
band_hz = [0.4, 300.0]
[[channel]]
name = "index"
sensor_gain_v_per_mm = 0.19898
travel_mm = 12.5
plant = { num = [2875.0], den = [1.0, 94.0, 290.0] }
loads = [{ name = "finger", mass = 0.12, damping = 31.0, stiffness = 360.0 }]
"""


def read(folder: Path, text: str) -> Display:
    path = folder / "display.toml"
    path.write_text(text)
    return read_display(path)


def test_read_display__plain_file__has_defaults_and_comes_back(tmp_path: Path) -> None:
    display = read(tmp_path, DISPLAY)
    channel = display.channels[0]
    assert (channel.finger, channel.converter.bits, channel.prefilter.poles) == ("index", 16, 4)
    assert channel.threshold.curve.name == "bolanowski-1988"
    assert channel.environment.friction_v == 0.004
    assert parse_display(display_document(display)) == display


def test_read_display__key_in_a_channel_or_another_curve__wins(tmp_path: Path) -> None:
    text = DISPLAY.replace('name = "index"', 'name = "index"\npolarity = -1\noffset_v = 0.1\npoles = 6')
    display = read(tmp_path, text.replace("[0.4, 300.0]", "[8.0, 300.0]") + "[prefilter]\npoles = 8\n")
    channel = display.channels[0]
    assert (channel.converter.polarity, channel.converter.offset_v, channel.prefilter.poles) == (-1, 0.1, 6)
    morioka = with_curve(display, curve("morioka-griffin-2006")).channels[0]
    assert morioka.threshold.curve.name == "morioka-griffin-2006"


def test_read_display__denominator_not_monic__scales_the_load_with_it(tmp_path: Path) -> None:
    text = DISPLAY.replace("[2875.0], den = [1.0, 94.0, 290.0]", "[5750.0], den = [2.0, 188.0, 580.0]")
    channel = read(tmp_path, text).channels[0]
    s = 2j * np.pi * 10.0
    loaded = channel.loaded_plant(channel.loads[0]).response(10.0)
    assert loaded == pytest.approx(5750.0 / ((2.12 * s + 219.0) * s + 940.0))


def test_read_display__zeros_poles_gain_and_model_file__are_plants(tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text('{"num": [2875.0], "den": [1.0, 94.0, 290.0], "delay_s": 0.0}')
    s = 2j * np.pi * 10.0
    for plant in ("{ zeros = [], poles = [-3.196, -90.804], gain = 2875.0 }", '"model.json"'):
        display = read(tmp_path, DISPLAY.replace("{ num = [2875.0], den = [1.0, 94.0, 290.0] }", plant))
        response = display.channels[0].plant.response(10.0)
        assert response == pytest.approx(2875.0 / ((s + 94.0) * s + 290.0), rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate_hz = 4000", "rate = 4000", r"known \(did you mean 'rate_hz'\?\); allowed: name, rate_hz"),
        ("rate_hz = 4000", 'rate_hz = "4000"', r"\[display\]: rate_hz is '4000'; allowed: a number"),
        ("rate_hz = 4000", "rate_hz = 1e9", "rate_hz is 1e[+]09; allowed: a number, above 0, up to 1000000"),
        ("0.19898", "198.98", r"198.98 V/mm, which make 2487 V of travel_mm 12.5; allowed: up to range_v 10 V"),
        ("rate_hz = 4000", "", r"\[display\]: rate_hz is missing"),
        ("0.19898", "-0.19898", "sensor_gain_v_per_mm is -0.19898; allowed: a number, above 0"),
        ("travel_mm = 12.5", "travel_mm = 12.5\ncolour = 1", "colour is not a key"),
        ("num = [2875.0], ", "", r"plant: neither one nor the other; allowed: \{ num, den \}"),
        ("[2875.0]", "[0.0]", "plant: num is zero"),
        ("damping = 31.0", "damping = -31.0", "damping is -31"),
        ("[threshold]", '[threshold]\ncurve = "tadoma"', "'tadoma' is not in the library"),
        ("[threshold]", '[threshold]\ncurve = "none.csv"', "No such file"),
        ("[threshold]", "[thresholds]", r"\[thresholds\]: not a table that is known; allowed: channel"),
        ("[[channel]]", "[channel]", "not a list of tables"),
        ("[display]", "[display", "allowed: a TOML file"),
    ],
)
def test_read_display__wrong_key_type_or_sign__is_told_in_one_line(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    assert old in DISPLAY
    with pytest.raises(BadInput, match=words) as refusal:
        read(tmp_path, DISPLAY.replace(old, new))
    assert "\n" not in str(refusal.value)


def test_read_display__no_such_file__is_told(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="No such file or directory; allowed: a TOML file"):
        read_display(tmp_path / "none.toml")
