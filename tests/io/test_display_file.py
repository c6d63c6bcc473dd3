"""Display files, and what `measure noise` wrote for one: read, written back, documented, refused in a line.

A channel's plant in a file of its own; models, responses and controllers in files, there and back.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.controller import read_controller, write_controller
from tactuator.io.csv_tables import read_pairs
from tactuator.io.display import parse_display, read_display, with_curve
from tactuator.io.environment import write_environment
from tactuator.io.model import read_model, write_model
from tactuator.io.response import read_responses, write_responses
from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import TABLES, Channel, Display, Environment, display_document, keys_of
from tactuator.model.plant_model import PlantModel
from tactuator.model.requirements import Wires
from tactuator.parameters import allowed, default
from tactuator.perception.curve import curve
from tactuator.signals.record import Response
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.objectives import judge
from tests.model.beams import Beam
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


def numbers_of(node: Any, *at: Any) -> Iterator[tuple[Any, ...]]:
    """Yield where a document has numbers: the keys and places that lead to each."""
    places = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for place, value in places:
        yield from numbers_of(value, *at, place)
    if isinstance(node, int | float) and not isinstance(node, bool):
        yield at


@pytest.mark.parametrize(
    "value", [1e100, -1e100, 1e-320, 10**400, float("nan"), -float("inf")], ids=lambda value: repr(value)[:6]
)
def test_parse_display__number_that_cannot_be_computed_with__refused_by_its_key(value: float) -> None:
    document = json.loads(json.dumps(display_document(parse_display(three_finger_display()))))
    document["channel"] = document["channel"][:1]
    (channel,) = document["channel"]
    channel |= {"valid_hz": [0.2, 400.0], "model_error_hz": [1.0, 9.0], "covariance": 4 * [4 * [1e-3]]}
    channel |= {"recorded": {"rate_hz": 4000.0, "command": 1.0}, "family": [channel["plant"]], "mains_hz": [60.0]}
    channel |= {"mains_max_db": [-11.0], "model_error_db": 0.1, "area_mm2": 30.0, "preload_n": 0.5}
    places = list(numbers_of(document))
    assert len(places) > 70
    for *above, last in places:
        changed = json.loads(json.dumps(document))
        node = changed
        for place in above:
            node = node[place]
        node[last] = value
        key = last if isinstance(last, str) else next(place for place in reversed(above) if isinstance(place, str))
        with pytest.raises(BadInput, match=key.removesuffix("s")) as caught:
            parse_display(changed)
        assert "\n" not in str(caught.value)


def test_read_display__defaults_keys_and_kinds_of_plant__come_back(tmp_path: Path) -> None:
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
    with pytest.raises(BadInput, match="den begins with 2"):
        read(tmp_path, text)
    text = text.replace("mass = 0.12", "per = 5750.0, mass = 0.12")
    channel = read(tmp_path, text).channels[0]
    s = 2j * np.pi * 10.0
    loaded = channel.loaded_plant(channel.loads[0]).response(10.0)
    assert loaded == pytest.approx(5750.0 / ((2.12 * s + 219.0) * s + 940.0))
    with pytest.raises(BadInput, match=r"mass is -0\.12;"):  # as it is in the file, whatever the units
        read(tmp_path, text.replace("mass = 0.12", "mass = -0.12"))
    (tmp_path / "model.json").write_text('{"num": [2875.0], "den": [1.0, 94.0, 290.0], "delay_s": 0.0}')
    s = 2j * np.pi * 10.0
    for plant in ("{ zeros = [], poles = [-3.196, -90.804], gain = 2875.0 }", '"model.json"'):
        display = read(tmp_path, DISPLAY.replace("{ num = [2875.0], den = [1.0, 94.0, 290.0] }", plant))
        response = display.channels[0].plant.response(10.0)
        assert response == pytest.approx(2875.0 / ((s + 94.0) * s + 290.0), rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate_hz = 4000", "rate = 4000", r"key \(did you mean 'rate_hz'\?\)$"),
        ("rate_hz = 4000", "rate_hz = 4,000", r"line \d+, column 12: Expected newline"),
        ("rate_hz = 4000", 'rate_hz = "4000"', r"\[display\]: rate_hz is '4000'; it must be a number"),
        ("rate_hz = 4000", "rate_hz = 1e9", "rate_hz is 1e[+]09; it must be a number, above 0, up to 1000000"),
        (
            "0.19898",
            "198.98",
            "puts out 2487 V at the end of travel_mm 12.5, .* range_v 10; it must be 0.8 or less, or ra",
        ),
        ("rate_hz = 4000", "", r"\[display\]: rate_hz is missing"),
        ("0.19898", "-0.19898", "sensor_gain_v_per_mm is -0.19898; it must be a number, above 0"),
        ("travel_mm = 12.5", "travel_mm = 12.5\ncolour = 1", "colour is not a known key"),
        ("num = [2875.0], ", "", r"plant: neither one nor the other; expected \{ num, den \}"),
        ("[2875.0]", "[0.0]", "plant: num is zero"),
        ("damping = 31.0", "damping = -31.0", "damping is -31"),
        ("[threshold]", '[threshold]\ncurve = "tadoma"', "no threshold curve 'tadoma'; expected bolanowski"),
        ("[threshold]", '[threshold]\ncurve = "none.csv"', "file not found"),
        ("[threshold]", "[thresholds]", r"no table \'thresholds\' \(did you mean \'threshold\'\?\)"),
        ("[[channel]]", "[channel]", "not a list of tables"),
        ("[display]", "[display", "line 2, column 9"),
    ],
)
def test_read_display__wrong_key_type_or_sign__is_told_in_one_line(tmp_path, old, new, words) -> None:
    assert old in DISPLAY
    with pytest.raises(BadInput, match=words) as refusal:
        read(tmp_path, DISPLAY.replace(old, new))
    assert "\n" not in str(refusal.value)


def test_display_file__missing_or_documented__is_told_by_every_key(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="file not found"):
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
    with pytest.raises(BadInput, match=r"both measured and noise_v_rms are given; expected one of them"):
        environment(tmp_path, "noise_v_rms = 1e-3")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "file not found"),
        ("[]", "format is None; it must be 'tactuator-environment/1'"),
        ({"thumb": FOUND}, "thumb"),
        ({}, "'index' is not in it; expected none"),
        ({"index": {**FOUND, "noise_v_rms": -1.0}}, "noise_v_rms is -1; it must be a number, 0 or more"),
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
        (FULL | {"volts": 1.0}, {}, r"\[sound\]: volts is not a known key; it must be one of device, input_device"),
        (FULL, {"output": 2}, "output 2 has two channels"),
        (FULL, {"input": 3}, "input 3 has two channels"),
        (FULL, {"output": 0}, "output is 0; it must be a whole number, 1 to 64"),
        (FULL, {"device": "x"}, r"device is not a known key"),
        (FULL | {"lead_s": 5.0}, {}, "lead_s is 5; it must be a number, 0.02 to 2"),
    ],
)
def test_sound__amiss__is_refused_in_one_line(sound: dict[str, Any], channel: dict[str, Any], words: str):
    with pytest.raises(BadInput, match=words):
        display_with(sound, channel)


def test_channel__wires_or_force__want_their_table_or_mass_and_follow_newtons_law():
    document = three_finger_display()
    document["channel"][0]["output"] = 2
    with pytest.raises(BadInput, match="output is not a known key"):
        parse_display(document)
    channel = without_gain().channels[0]
    assert channel.quantity == "acceleration"
    assert channel.sensor_gain_v_per_mm == pytest.approx(1e-5, rel=1e-12)
    with pytest.raises(BadInput, match="'force', which alone does not show how far a finger moves: mass_kg is missing"):
        display_with(FULL, {"quantity": "force"})


def force(**more):
    return {"quantity": "force", "mass_kg": 0.02, "sensor_gain_v_per_n": 0.5} | more


def without_gain(**more):
    document = three_finger_display()
    entry = {
        key: value for key, value in document["channel"][0].items() if key not in {"sensor_gain_v_per_mm", "loads"}
    }
    return parse_display(document | {"sound": FULL, "channel": [entry | force(**more)]})


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"mass_kg": 0.0}, "mass_kg is 0; it must be a number, above 0"),
        ({"sensor_gain_v_per_n": -1.0}, "sensor_gain_v_per_n is -1; it must be a number, above 0"),
        ({"quantity": "velocity"}, "mass_kg is 0.02; it must be left out, or beside quantity = .force."),
        ({"loads": [{"name": "finger"}]}, "load 'finger' is all zero; expected a mass, damping or stiffness"),
        ({"sensor_gain_v_per_mm": 1.0}, "sensor_gain_v_per_mm is given beside quantity = 'force'"),
    ],
)
def test_channel__force_amiss__is_refused_in_one_line(more: dict[str, Any], words: str):
    with pytest.raises(BadInput, match=words):
        without_gain(**more)


TEXT = """
[display]
rate_hz = 8000
[threshold]
band_hz = [{low}, {high}]
[feedback]
structure = "{structure}"
[[channel]]
name = "tip"
sensor_gain_v_per_mm = 1.0
travel_mm = 2.0
plant = "{plant}"
{more}
"""


USUAL = {"plant": "response.csv", "structure": "none", "low": 8.0, "high": 300.0, "more": ""}


def read_controller_of(folder: Path, **asked: object) -> Display:
    (folder / "display.toml").write_text(TEXT.format(**{**USUAL, **asked}))
    return read_display(folder / "display.toml")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    frequency = np.geomspace(7.9, 305.0, 80)
    noise = 10.0 ** (0.1 * np.random.default_rng(2).standard_normal(80) / 20.0)
    rows = np.column_stack([frequency, np.abs(Beam().response(frequency)) * noise, np.full(80, 0.2)])
    header = "frequency_hz,magnitude,confidence_db"
    np.savetxt(tmp_path / "response.csv", rows, delimiter=",", header=header, comments="")
    return tmp_path


def test_read_display__response__equalised_within_one_db_where_nobody_measured(folder: Path) -> None:
    """The beam itself, no rational system, behind the hold and the designed prefilter, on a grid of its own."""
    display = read_controller_of(folder)
    channel = display.channels[0]
    again = parse_display(display_document(display)).channels[0]
    assert again.valid_hz == channel.valid_hz == pytest.approx((7.9, 305.0))
    assert again.model_error_db == channel.model_error_db > 0.0
    assert again.plant == channel.plant
    controller = design_controller(display, error_db=0.4)
    frequency = np.geomspace(8.0, 300.0, 4000)
    felt = controller.channels[0].prefilter(8000.0).response(frequency) * np.sinc(frequency / 8000.0)
    felt = felt * Beam().response(frequency)
    error_db = 20.0 * np.log10(np.abs(felt) / channel.threshold_voltage(frequency))
    assert np.max(np.abs(error_db)) < 1.0
    finding = judge(controller).objectives[0].findings[0]
    assert finding.value is not None
    assert finding.value >= np.max(np.abs(error_db)) - 0.3
    assert "unsure" in finding.remark


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"structure": "integrator-lead-lag"}, 'no loop can be designed; expected structure = "none"'),
        (
            {"more": 'loads = [{ name = "finger", damping = 1.0 }]'},
            "a response alone does not show what a load changes",
        ),
        ({"plant": "jump.csv"}, r"channel.*plant .*jump.csv: .*4 or more"),
        ({"more": "valid_hz = [3.0, 2.0]"}, r"valid_hz is \[3, 2\]"),
        ({"plant": "model.json"}, "valid_hz is 7; it must be two frequencies"),
        ({"plant": "speed.csv"}, 'quantity is .displacement., and the plant is of velocity; .* quantity = "velocity"'),
        ({"plant": "unread.csv"}, "beside what is not read: 'lag'"),
    ],
    ids=["a loop", "a load", "three points", "valid_hz", "valid_hz of a model", "a velocity", "an unread column"],
)
def test_read_display__what_a_response_cannot_be__refused_in_one_line(folder: Path, asked, words: str) -> None:
    (folder / "jump.csv").write_text("frequency_hz,magnitude\n1,1\n2,2\n3,1\n")
    (folder / "speed.csv").write_text((folder / "response.csv").read_text().replace("magnitude", "velocity [mm/s/V]"))
    (folder / "unread.csv").write_text((folder / "response.csv").read_text().replace("confidence_db", "lag"))
    (folder / "model.json").write_text(json.dumps({"num": [1.0], "den": [1.0, 9.0], "valid_hz": 7}))
    with pytest.raises(BadInput, match=words) as refused:
        read_controller_of(folder, **asked)
    assert "\n" not in str(refused.value)


def model(folder: Path, name: str, gain: float, **other: object) -> None:
    table = {"num": [gain], "den": [1.0, 94.0, 290.0], "delay_s": 0.0, "quantity": "displacement"}
    table |= {"valid_hz": [0.2, 400]}
    table |= {"units": {"command": "V", "position": "V"}, "record": {"rate_hz": 4000.0}} | other
    (folder / f"{name}.json").write_text(json.dumps(table))


def read_list(folder: Path, plants: str) -> Display:
    text = TEXT.replace('"{plant}"', plants).format(structure="integrator-lead-lag", low=0.4, high=300, more="")
    (folder / "display.toml").write_text(text.replace("1.0\ntravel_mm", "0.2\ntravel_mm"))
    return read_display(folder / "display.toml")


def test_read_display__several_models__designed_for_all_and_each_named(tmp_path: Path) -> None:
    model(tmp_path, "cold", 2500.0, family=[{"num": [2510.0], "den": [1.0, 94.0, 290.0]}])
    model(tmp_path, "hot", 3100.0, valid_hz=[0.1, 350])
    display = read_list(tmp_path, '["cold.json", "hot.json"]')
    channel = display.channels[0]
    assert channel.models == ("cold", "cold", "hot")
    assert channel.valid_hz == (0.2, 350.0)
    assert parse_display(display_document(display)) == display
    controller = design_controller(display)
    names = ("none, cold", "none, cold, model 1", "none, hot")
    assert controller.channels[0].designed_for == names
    flatness = judge(controller).objectives[0]
    assert {finding.load for finding in flatness.findings} == set(names)
    rows = [finding for finding in flatness.worst() if finding.quantity == "level error"]
    assert [finding.model for finding in rows] == ["cold", "hot"]
    of_hot = [finding for finding in flatness.findings if (finding.channel, finding.load) == ("tip", "none, hot")]
    hot = next(finding for finding in of_hot if finding.quantity == "level error")
    alone = judge(controller, read_list(tmp_path, '["hot.json"]')).objectives[0].findings[0]
    assert hot.value == pytest.approx(alone.value)


@pytest.mark.parametrize(
    ("plants", "other", "words"),
    [
        ("[]", {}, r"plant is \[\]; it must be paths of model files, each name once"),
        ('["cold.json", 7]', {}, "paths of model files"),
        ('["cold.json", "response.csv"]', {}, "a response, for which no loop"),
        ('["cold.json", "hot.json"]', {"quantity": "velocity"}, "quantity is 'velocity'; it must be that of cold"),
        ('["cold.json", "hot.json"]', {"units": {"command": "V", "position": "mm"}}, "'mm'}; it must be that of cold"),
        ('["cold.json", "hot.json"]', {"record": {"rate_hz": 8000.0}}, "rate_hz is 8000.0; it must be that of cold"),
        ('["cold.json", "hot.json"]', {"valid_hz": [500, 600]}, "valid at no frequency in common"),
    ],
    ids=["none", "a number", "a response", "quantity", "unit", "rate", "band"],
)
def test_read_display__models_that_are_not_of_one_display__refused(folder, plants, other, words) -> None:
    model(folder, "cold", 2500.0)
    model(folder, "hot", 3100.0, **other)
    with pytest.raises(BadInput, match=words) as refused:
        read_list(folder, plants)
    assert "\n" not in str(refused.value)


def test_design__band_beyond_the_response__refused(folder: Path) -> None:
    with pytest.raises(BadInput, match=r"known from 7.9 to 305 Hz only \(valid_hz\); allowed without a loop"):
        design_controller(read_controller_of(folder, low=4.0))
    with pytest.raises(BadInput, match="a band within that"):
        design_controller(read_controller_of(folder, high=400.0))


def plant_model() -> PlantModel:
    covariance = np.diag([9.0, 0.01, 0.09, 0.0])
    return PlantModel(np.array([2875.0]), np.array([1.0, 94.0, 290.0]), 0.0, covariance, (0.4, 300.0))


def test_model__written_and_read__is_the_same_and_a_displays_plant_with_its_family(tmp_path: Path) -> None:
    write_model(tmp_path / "m.json", plant_model(), plant_model().family(4, np.random.default_rng(0)))
    read_controller_of = read_model(tmp_path / "m.json")
    np.testing.assert_array_equal(read_controller_of.den, plant_model().den)
    np.testing.assert_array_equal(read_controller_of.covariance, plant_model().covariance)
    assert read_controller_of.band_hz == (0.4, 300.0)
    table = {"name": "index", "sensor_gain_v_per_mm": 0.2, "travel_mm": 12.5, "plant": "m.json"}
    document = {
        "display": {"name": "one", "rate_hz": 4000, "delay_samples": 1},
        "threshold": {"curve": "bolanowski-1988"},
        "channel": [table],
    }
    channel = parse_display(document, tmp_path).channels[0]
    np.testing.assert_allclose(channel.plant.response(5.0), plant_model().response(np.array(5.0)), rtol=1e-9)
    assert len(channel.family) == 4


def test_model_band_covariance_and_pairs__by_hand__are_read_or_refused(tmp_path: Path) -> None:
    gain_only = PlantModel(np.array([2.0]), np.array([1.0, 3.0]), 0.0, np.diag([0.01, 0.0, 0.0]), (0.4, 300.0))
    expected = 1.959964 * 20.0 / np.log(10.0) * 0.1 / 2.0
    np.testing.assert_allclose(gain_only.band_db(np.array([0.5, 50.0])), expected, rtol=1e-6)
    assert gain_only.confidence()["gain"] == pytest.approx(1.959964 * 0.1 / 3.0)
    with pytest.raises(BadInput, match="covariance"):
        PlantModel(np.ones(1), np.ones(3), 0.0, np.eye(2), (1.0, 2.0))
    (tmp_path / "p.csv").write_text("name,displacement_mm,voltage_v\na,1,0.2\n,2,0.4\n")
    read_controller_of = read_pairs(tmp_path / "p.csv")
    assert read_controller_of.names == ["a", "row 3"]
    assert read_controller_of.voltage_v.tolist() == [0.2, 0.4]


def response() -> Response:
    pair = np.array([1.0, 2.0])
    return Response(
        "index", "none", 30.0, "stepped-sine", pair, pair * (1.0 - 1.0j), pair, pair * 0.1, pair * 1e-3, pair * 1e-4,
        np.array([False, True]), np.array([True, True]), pair, "abc",
    )  # fmt: skip


def test_response__hdf5_or_csv__comes_back_or_has_a_row_for_each_point(tmp_path: Path) -> None:
    write_responses(tmp_path / "r.h5", [response(), response()])
    read_controller_of = read_responses(tmp_path / "r.h5")
    assert len(read_controller_of) == 2
    np.testing.assert_array_equal(read_controller_of[1].amplitude_v, response().amplitude_v)
    assert read_controller_of[0].saturated.tolist() == [False, True]
    assert (read_controller_of[0].level_db_sl, read_controller_of[0].controller_hash) == (30.0, "abc")
    with h5py.File(tmp_path / "r.h5") as file:
        assert file["response1/latency_s"].attrs["unit"] == "s"
    write_responses(tmp_path / "r.csv", [response()])
    rows = (tmp_path / "r.csv").read_text().splitlines()
    assert len(rows) == 3
    assert rows[0].startswith("channel,load,level_db_sl,method,frequency_hz,magnitude_v")
    assert rows[1].split(",")[5] == "1.41421356"
    with pytest.raises(BadInput, match="ending"):
        write_responses(tmp_path / "r.png", [response()])


MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
CHANNEL = Channel("index", 0.19898, 12.5, MOTOR)
SHOWN = Display(4000.0, (CHANNEL,), 1, "one")
SECTION = np.array([[0.1, 0.2, 0.1, 1.0, -0.5, 0.3]])


def made() -> Controller:
    channel = ChannelController(
        "index", 0.004, SECTION, SECTION, AntiWindup((0.5, 0.1)), Limits(10.0, 2.4), ("finger",), {"poles": 4}
    )
    return Controller(SHOWN, (channel,))


def test_write_controller__there_and_back__has_the_same_hash_and_the_formats_keys(tmp_path: Path) -> None:
    write_controller(tmp_path / "c.json", made())
    again = read_controller(tmp_path / "c.json")
    assert again.content_hash == made().content_hash
    assert again.channels[0].anti_windup.gains == (0.5, 0.1)
    np.testing.assert_array_equal(again.channels[0].prefilter_sos, SECTION)
    document = made().document()
    assert document["format"] == "tactuator-controller/1"
    assert {"tool", "display", "rate_hz", "delay_samples", "channels", "hash"} < set(document)
    assert document["display"]["channel"][0]["curve"]["frequency_hz"][0] == 0.4


def test_controller__of_another_display_or_changed_by_hand__is_refused(tmp_path: Path) -> None:
    other = ChannelController("thumb", 0.004, SECTION, None, AntiWindup(), Limits(10.0, 2.4))
    with pytest.raises(BadInput, match="is for channels thumb; the display has index"):
        Controller(SHOWN, (other,))
    with pytest.raises(BadInput, match="no channel 'thumb'; expected index"):
        made().channel("thumb")
    path = tmp_path / "c.json"
    write_controller(path, made())
    path.write_text(path.read_text().replace("4000.0", "4001.0"))
    with pytest.raises(BadInput, match="its hash does not fit its contents; expected a file as `design` wrote it"):
        read_controller(path)
