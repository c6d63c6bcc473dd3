"""Display files, and what `noise --write` measured for one: read, written back, documented, refused in one line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.display import parse_display, read_display, with_curve, write_environment
from tactuator.model.description import TABLES, Display, Environment, display_document, keys_of
from tactuator.model.requirements import Wires
from tactuator.parameters import allowed, default
from tactuator.perception.curve import curve
from tests.three_fingers import three_finger_display
from tools.display_reference import PAGE, TABLE, reference

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


def test_read_display__defaults_keys_and_every_kind_of_plant__are_taken_and_come_back(tmp_path: Path) -> None:
    display = read(tmp_path, DISPLAY)
    channel = display.channels[0]
    assert (channel.finger, channel.converter.bits, channel.prefilter.poles) == ("index", 16, 4)
    assert channel.threshold.curve.name == "bolanowski-1988"
    assert channel.environment.friction_v == 0.004
    assert parse_display(display_document(display)) == display
    text = DISPLAY.replace('name = "index"', 'name = "index"\npolarity = -1\noffset_v = 0.1\npoles = 6')
    display = read(tmp_path, text.replace("[0.4, 300.0]", "[8.0, 300.0]") + "[prefilter]\npoles = 8\n")
    channel = display.channels[0]
    assert (channel.converter.polarity, channel.converter.offset_v, channel.prefilter.poles) == (-1, 0.1, 6)
    morioka = with_curve(display, curve("morioka-griffin-2006")).channels[0]
    assert morioka.threshold.curve.name == "morioka-griffin-2006"
    text = DISPLAY.replace("[2875.0], den = [1.0, 94.0, 290.0]", "[5750.0], den = [2.0, 188.0, 580.0]")
    channel = read(tmp_path, text).channels[0]
    s = 2j * np.pi * 10.0
    loaded = channel.loaded_plant(channel.loads[0]).response(10.0)
    assert loaded == pytest.approx(5750.0 / ((2.12 * s + 219.0) * s + 940.0))
    (tmp_path / "model.json").write_text('{"num": [2875.0], "den": [1.0, 94.0, 290.0], "delay_s": 0.0}')
    s = 2j * np.pi * 10.0
    for plant in ("{ zeros = [], poles = [-3.196, -90.804], gain = 2875.0 }", '"model.json"'):
        display = read(tmp_path, DISPLAY.replace("{ num = [2875.0], den = [1.0, 94.0, 290.0] }", plant))
        response = display.channels[0].plant.response(10.0)
        assert response == pytest.approx(2875.0 / ((s + 94.0) * s + 290.0), rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate_hz = 4000", "rate = 4000", r"known \(did you mean 'rate_hz'\?\)$"),
        ("rate_hz = 4000", "rate_hz = 4,000", r"line \d+, column 12: 'rate_hz = 4,000.*': Expected newline"),
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
def test_read_display__wrong_key_type_or_sign__is_told_in_one_line(tmp_path, old, new, words) -> None:
    assert old in DISPLAY
    with pytest.raises(BadInput, match=words) as refusal:
        read(tmp_path, DISPLAY.replace(old, new))
    assert "\n" not in str(refusal.value)


def test_display_file__missing_or_documented__is_told_by_every_key(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="No such file or directory; allowed: a TOML file"):
        read_display(tmp_path / "none.toml")
    text = PAGE.read_text(encoding="utf-8")
    assert {place[2] for place in TABLE.finditer(text)} == set(TABLES)
    assert text == reference(text), "out of date: make docs"
    for name in TABLES:
        for key, about in keys_of(name).items():
            assert about.description, f"{name}.{key}"
            assert allowed(about), f"{name}.{key}"
            assert default(about) != "", f"{name}.{key}"


FOUND = {"hum_hz": [50.0, 100.0], "hum_v_peak": [1.5e-3, 0.25e-3], "noise_v_rms": 0.31e-3}


def environment(folder: Path, more: str = "") -> Environment:
    return read(folder, f'{DISPLAY}[environment]\nmeasured = "environment.json"\n{more}').channels[0].environment


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


FULL = {"output_full_scale_v": 2.0}


def display_with(sound: dict[str, Any], *channels: dict[str, Any]):
    document = three_finger_display()
    for entry, more in zip(document["channel"], channels, strict=False):
        entry.update(more)
    return parse_display(document | {"sound": sound})


def test_sound__wires__count_from_one_where_a_channel_does_not_say_otherwise():
    card = display_with(FULL).sound
    assert card.wires == tuple(Wires(k, k, 2.0, 1.0) for k in (1, 2, 3))
    assert (card.device, card.latency_samples) == ("", 0)
    display = display_with(FULL | {"device": "x", "latency_samples": 512}, {"output": 7, "input": 0})
    assert (display.sound.wires[0], display.sound.latency_samples) == (Wires(7, 0, 2.0, 1.0), 512)
    assert parse_display(display_document(display)).sound == display.sound
    assert "sound" not in display_document(parse_display(three_finger_display()))


@pytest.mark.parametrize(
    ("sound", "channel", "words"),
    [
        ({}, {}, r"\[sound\]: output_full_scale_v is missing"),
        (FULL | {"volts": 1.0}, {}, r"\[sound\]: volts is not a key that is known; allowed: device, input_device"),
        (FULL, {"output": 2}, "output 2 has two channels"),
        (FULL, {"input": 3}, "input 3 has two channels"),
        (FULL, {"output": 0}, "output is 0; allowed: a whole number, 1 to 64"),
        (FULL, {"device": "x"}, r"device is not a key"),
        (FULL | {"lead_s": 5.0}, {}, "lead_s is 5; allowed: a number, 0.02 to 2"),
    ],
)
def test_sound__amiss__is_refused_in_one_line(sound: dict[str, Any], channel: dict[str, Any], words: str):
    with pytest.raises(BadInput, match=words):
        display_with(sound, channel)


def test_channel__wires_or_force__want_their_table_or_mass_and_follow_newtons_law():
    document = three_finger_display()
    document["channel"][0]["output"] = 2
    with pytest.raises(BadInput, match="output is not a key"):
        parse_display(document)
    channel = without_gain().channels[0]
    assert channel.quantity == "acceleration"
    assert channel.sensor_gain_v_per_mm == pytest.approx(1e-5, rel=1e-12)
    with pytest.raises(BadInput, match="'force', which alone does not tell how far a finger moves: mass_kg is missing"):
        display_with(FULL, {"quantity": "force"})


def force(**more):
    return {"quantity": "force", "mass_kg": 0.02, "sensor_gain_v_per_n": 0.5} | more


def without_gain(**more):
    document = three_finger_display()
    entry = {key: value for key, value in document["channel"][0].items() if key != "sensor_gain_v_per_mm"}
    return parse_display(document | {"sound": FULL, "channel": [entry | force(**more)]})


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"mass_kg": 0.0}, "mass_kg is 0; allowed: a number, above 0"),
        ({"sensor_gain_v_per_n": -1.0}, "sensor_gain_v_per_n is -1; allowed: a number, above 0"),
        ({"quantity": "velocity"}, "mass_kg is not a key"),
        ({"sensor_gain_v_per_mm": 1.0}, "sensor_gain_v_per_mm is given beside quantity = 'force'"),
    ],
)
def test_channel__force_amiss__is_refused_in_one_line(more: dict[str, Any], words: str):
    with pytest.raises(BadInput, match=words):
        without_gain(**more)
