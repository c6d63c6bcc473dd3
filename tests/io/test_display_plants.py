"""A channel's plant in a file of its own: a model, or a response by itself; and every refusal."""

import json
from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.display import parse_display, read_display
from tactuator.model.description import Display, display_document
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
