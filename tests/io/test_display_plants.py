"""A channel's plant in a file of its own; models, responses and controllers in files, there and back."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.controller import read_controller, write_controller
from tactuator.io.csv_tables import read_pairs
from tactuator.io.display import parse_display, read_display
from tactuator.io.model import read_model, write_model
from tactuator.io.response import read_responses, write_responses
from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Channel, Display, Threshold, display_document
from tactuator.model.plant_model import PlantModel
from tactuator.perception.curve import curve
from tactuator.signals.record import Response
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.verdict import judge
from tests.model.beams import Beam

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


def read(folder: Path, **asked: object) -> Display:
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
    display = read(folder)
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
        ({"structure": "integrator-lead-lag"}, 'no loop can be designed; allowed: structure = "none"'),
        ({"more": 'loads = [{ name = "finger", damping = 1.0 }]'}, "cannot be told from a response by itself"),
        ({"plant": "jump.csv"}, "4 or more"),
        ({"more": "valid_hz = [3.0, 2.0]"}, r"valid_hz is \[3, 2\]"),
        ({"plant": "model.json"}, "valid_hz is 7; allowed: two frequencies"),
    ],
    ids=["a loop", "a load", "three points", "valid_hz", "valid_hz of a model"],
)
def test_read_display__what_a_response_cannot_be__refused_in_one_line(folder: Path, asked, words: str) -> None:
    (folder / "jump.csv").write_text("frequency_hz,magnitude\n1,1\n2,2\n3,1\n")
    (folder / "model.json").write_text(json.dumps({"num": [1.0], "den": [1.0, 9.0], "valid_hz": 7}))
    with pytest.raises(BadInput, match=words) as refused:
        read(folder, **asked)
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
    rows = [finding for finding in flatness.worst() if finding.quantity == "felt minus asked"]
    assert [finding.model for finding in rows] == ["cold", "hot"]
    of_hot = [finding for finding in flatness.findings if (finding.channel, finding.load) == ("tip", "none, hot")]
    hot = next(finding for finding in of_hot if finding.quantity == "felt minus asked")
    alone = judge(controller, read_list(tmp_path, '["hot.json"]')).objectives[0].findings[0]
    assert hot.value == pytest.approx(alone.value)


@pytest.mark.parametrize(
    ("plants", "other", "words"),
    [
        ("[]", {}, r"plant is \[\]; allowed: paths of model files, each name once"),
        ('["cold.json", 7]', {}, "paths of model files"),
        ('["cold.json", "response.csv"]', {}, "a response, for which no loop"),
        ('["cold.json", "hot.json"]', {"quantity": "velocity"}, "quantity is 'velocity'; allowed: that of cold"),
        ('["cold.json", "hot.json"]', {"units": {"command": "V", "position": "mm"}}, "'mm'}; allowed: that of cold"),
        ('["cold.json", "hot.json"]', {"record": {"rate_hz": 8000.0}}, "rate_hz is 8000.0; allowed: that of cold"),
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
        design_controller(read(folder, low=4.0))
    with pytest.raises(BadInput, match="a band within that"):
        design_controller(read(folder, high=400.0))


def plant_model() -> PlantModel:
    covariance = np.diag([9.0, 0.01, 0.09, 0.0])
    return PlantModel(np.array([2875.0]), np.array([1.0, 94.0, 290.0]), 0.0, covariance, (0.4, 300.0))


def test_model__written_and_read__is_the_same_and_a_displays_plant_with_its_family(tmp_path: Path) -> None:
    write_model(tmp_path / "m.json", plant_model(), plant_model().family(4, np.random.default_rng(0)))
    read = read_model(tmp_path / "m.json")
    np.testing.assert_array_equal(read.den, plant_model().den)
    np.testing.assert_array_equal(read.covariance, plant_model().covariance)
    assert read.band_hz == (0.4, 300.0)
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
    read = read_pairs(tmp_path / "p.csv")
    assert read.names == ["a", "row 3"]
    assert read.voltage_v.tolist() == [0.2, 0.4]


def response() -> Response:
    pair = np.array([1.0, 2.0])
    return Response(
        "index", "none", 30.0, "stepped-sine", pair, pair * (1.0 - 1.0j), pair, pair * 0.1, pair * 1e-3, pair * 1e-4,
        np.array([False, True]), np.array([True, True]), pair, "abc",
    )  # fmt: skip


def test_response__hdf5_or_csv__comes_back_or_has_a_row_for_each_point(tmp_path: Path) -> None:
    write_responses(tmp_path / "r.h5", [response(), response()])
    read = read_responses(tmp_path / "r.h5")
    assert len(read) == 2
    np.testing.assert_array_equal(read[1].amplitude_v, response().amplitude_v)
    assert read[0].saturated.tolist() == [False, True]
    assert (read[0].level_db_sl, read[0].controller_hash) == (30.0, "abc")
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
CHANNEL = Channel("index", "index", 0.19898, 12.5, MOTOR, Threshold(curve("bolanowski-1988")))
DISPLAY = Display("one", 4000.0, 1, (CHANNEL,))
SECTION = np.array([[0.1, 0.2, 0.1, 1.0, -0.5, 0.3]])


def made() -> Controller:
    channel = ChannelController(
        "index", 0.004, SECTION, SECTION, AntiWindup((0.5, 0.1)), Limits(10.0, 2.4), ("finger",), {"poles": 4}
    )
    return Controller(DISPLAY, (channel,))


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
        Controller(DISPLAY, (other,))
    with pytest.raises(BadInput, match="channel 'thumb' is not there; allowed: index"):
        made().channel("thumb")
    path = tmp_path / "c.json"
    write_controller(path, made())
    path.write_text(path.read_text().replace("4000.0", "4001.0"))
    with pytest.raises(BadInput, match="its hash does not fit its contents; allowed: a file as `design` wrote it"):
        read_controller(path)
