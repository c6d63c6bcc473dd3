from pathlib import Path

import h5py
import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.csv_tables import read_pairs
from tactuator.io.display import parse_display
from tactuator.io.model import read_model, write_model
from tactuator.io.response import read_responses, write_responses
from tactuator.model.plant_model import PlantModel
from tactuator.signals.record import Response


def model() -> PlantModel:
    covariance = np.diag([9.0, 0.01, 0.09, 0.0])
    return PlantModel(np.array([2875.0]), np.array([1.0, 94.0, 290.0]), 0.0, covariance, (0.4, 300.0))


def test_model__written_and_read__is_the_same_and_a_displays_plant_with_its_family(tmp_path: Path) -> None:
    write_model(tmp_path / "m.json", model(), model().family(4, np.random.default_rng(0)))
    read = read_model(tmp_path / "m.json")
    np.testing.assert_array_equal(read.den, model().den)
    np.testing.assert_array_equal(read.covariance, model().covariance)
    assert read.band_hz == (0.4, 300.0)
    table = {"name": "index", "sensor_gain_v_per_mm": 0.2, "travel_mm": 12.5, "plant": "m.json"}
    document = {
        "display": {"name": "one", "rate_hz": 4000, "delay_samples": 1},
        "threshold": {"curve": "bolanowski-1988"},
        "channel": [table],
    }
    channel = parse_display(document, tmp_path).channels[0]
    np.testing.assert_allclose(channel.plant.response(5.0), model().response(np.array(5.0)), rtol=1e-9)
    assert len(channel.family) == 4


def test_model__band__is_the_hand_calculation_for_the_gain_alone() -> None:
    gain_only = PlantModel(np.array([2.0]), np.array([1.0, 3.0]), 0.0, np.diag([0.01, 0.0, 0.0]), (0.4, 300.0))
    expected = 1.959964 * 20.0 / np.log(10.0) * 0.1 / 2.0
    np.testing.assert_allclose(gain_only.band_db(np.array([0.5, 50.0])), expected, rtol=1e-6)
    assert gain_only.confidence()["gain"] == pytest.approx(1.959964 * 0.1 / 3.0)


def test_model__covariance_of_another_size__is_refused() -> None:
    with pytest.raises(BadInput, match="covariance"):
        PlantModel(np.ones(1), np.ones(3), 0.0, np.eye(2), (1.0, 2.0))


def response() -> Response:
    pair = np.array([1.0, 2.0])
    return Response(
        "index", "none", 30.0, "stepped-sine", pair, pair * (1.0 - 1.0j), pair, pair * 0.1, pair * 1e-3, pair * 1e-4,
        np.array([False, True]), np.array([True, True]), pair, "abc",
    )  # fmt: skip


def test_response__hdf5__comes_back(tmp_path: Path) -> None:
    write_responses(tmp_path / "r.h5", [response(), response()])
    read = read_responses(tmp_path / "r.h5")
    assert len(read) == 2
    np.testing.assert_array_equal(read[1].amplitude_v, response().amplitude_v)
    assert read[0].saturated.tolist() == [False, True]
    assert (read[0].level_db_sl, read[0].controller_hash) == (30.0, "abc")
    with h5py.File(tmp_path / "r.h5") as file:
        assert file["response1/latency_s"].attrs["unit"] == "s"


def test_response__csv__has_a_row_for_each_point_and_another_ending_is_refused(tmp_path: Path) -> None:
    write_responses(tmp_path / "r.csv", [response()])
    rows = (tmp_path / "r.csv").read_text().splitlines()
    assert len(rows) == 3
    assert rows[0].startswith("channel,load,level_db_sl,method,frequency_hz,magnitude_v")
    assert rows[1].split(",")[5] == "1.41421356"
    with pytest.raises(BadInput, match="ending"):
        write_responses(tmp_path / "r.png", [response()])


def test_pairs__named_and_not__are_read(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("name,displacement_mm,voltage_v\na,1,0.2\n,2,0.4\n")
    read = read_pairs(tmp_path / "p.csv")
    assert read.names == ["a", "row 3"]
    assert read.voltage_v.tolist() == [0.2, 0.4]
