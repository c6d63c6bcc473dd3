"""record, identify, measure, noise, disturb and calibrate, as a user types them."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tactuator.cli import main
from tactuator.io.controller import write_controller
from tests.measure.loops import controller, display
from tests.one_finger import DISPLAY


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A display, a record of it, and the paper's controller."""
    place = tmp_path_factory.mktemp("verbs")
    (place / "display.toml").write_text(DISPLAY)
    write_controller(place / "controller.json", controller(display()))
    words = ["record", str(place / "display.toml"), "--duration-s", "12", "--out", str(place / "r.h5"), "--json"]
    assert main(words) == 0
    return place


@pytest.fixture
def paper(folder: Path) -> tuple[str, str]:
    return "--controller", str(folder / "controller.json")


def test_identify__record_of_the_simulated_display__prints_what_the_design_promises(folder, run, tmp_path) -> None:
    out = tmp_path / "m.json"
    answer = run.json("identify", folder / "r.h5", "--out", out)
    np.testing.assert_allclose(answer["model"]["den"], [1.0, 94.0, 290.0], rtol=0.005)
    np.testing.assert_allclose(answer["model"]["num"], [2875.0], rtol=0.005)
    assert (answer["model"]["delay_s"], answer["order"]) == (0.0, 2)
    np.testing.assert_allclose(answer["poles_hz"], np.array([3.195, 90.80]) / (2.0 * np.pi), rtol=0.01)
    frequency = np.array(answer["frf"]["frequency_hz"])
    assert frequency.size == len(answer["frf"]["band_db"]) >= 500
    assert (frequency[0], frequency[-1]) == pytest.approx((0.4, 300.0))
    s = 2j * np.pi * frequency
    truth = 20.0 * np.log10(np.abs(2875.0 / (s**2 + 94.0 * s + 290.0)))
    assert np.max(np.abs(np.array(answer["frf"]["magnitude_db"]) - truth)) < 0.2
    assert answer["friction"]["coulomb"] == pytest.approx(4e-3, rel=0.2)
    assert answer["valid_hz"][0] < 0.4
    assert 300.0 < answer["valid_hz"][1] < 500.0
    assert answer["excitation"]["sufficient"] is True
    assert set(answer["residuals"]) >= {"white", "uncorrelated_with_input"}
    assert answer["fit_percent"] > 99.0
    assert len(answer["confidence"]["den"]) == 3
    assert json.loads(out.read_text())["format"] == "tactuator-model/1"
    ended = run("identify", folder / "r.h5", "--method", "rls", "--figures", tmp_path / "figures")
    assert ended.status == 0
    assert "denominator, s^0" in ended.out
    assert (tmp_path / "figures" / "identification.svg").exists()


def test_record_and_identify__multisine__noise_and_distortion_are_told(folder, run, tmp_path) -> None:
    record = ("record", folder / "display.toml", "--excitation", "multisine", "--out", tmp_path / "m.h5")
    assert run(*record, "--duration-s", "20", "--realisations", "2").status == 0
    answer = run.json("identify", tmp_path / "m.h5")
    assert answer["distortion"]["realisations"] == 2
    assert answer["residuals"]["closed_loop"] is False
    # friction, odd in the motion, stands out of the noise at low frequencies
    assert answer["distortion"]["odd_db"][0] > answer["distortion"]["noise_db"][0] + 20.0
    run.refused(*record, "--duration-s", "1", said="allowed: 8 or more")


def test_measure__table__begins_with_the_largest_felt_error_and_breaks_no_word(paper, run, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    ended = run("measure", *paper, "--frequency-hz", "5,30,251.2", "--level", "40")
    assert ended.status == 1
    heads = ended.out.partition("─")[0].split()
    assert {"channel", "error", "load", "rest", "phase", "delay", "dist."} <= set(heads)
    shown = [line.split() for line in ended.out.splitlines() if line.split()[:1] == ["index"]]
    errors = [abs(float(row[3])) for row in shown[:3]]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 3.0  # the paper's own prefilter is far below the curve at 250 Hz


def test_measure__multisine_and_stepped__print_responses(paper, run, tmp_path) -> None:
    not_flat = 1  # the paper's own prefilter is 8 dB low at 300 Hz
    out = tmp_path / "resp.h5"
    flat = run.json("measure", *paper, "--method", "multisine", "--out", out, status=not_flat)
    assert len(flat["responses"][0]["frequency_hz"]) == 33  # three of them where a sweep found too much between
    assert out.exists()
    asked = ("--frequency-hz", "5,120", "--load", "finger", "--level", "40", "--figures", tmp_path / "measured")
    (answer,) = run.json("measure", *paper, *asked)["responses"]
    off = np.array(answer["sensation_level_db"]) - np.array(answer["expected_level_db_sl"])
    assert np.all(np.abs(off) < 0.25)  # the expected is that under the load, which takes a third of a decibel at 122 Hz
    assert answer["expected_level_db_sl"][1] < 39.8
    felt_less_asked = np.array(answer["sensation_level_db"]) - 40.0
    np.testing.assert_allclose(answer["error_db"], felt_less_asked)
    np.testing.assert_allclose(answer["error_jnd"], np.abs(felt_less_asked) / 1.65)  # Israr, Tan, Reed 2006: the least
    np.testing.assert_allclose(answer["model_error_db"], felt_less_asked - off)
    parts = [np.array(answer[f"{name}_error_db"]) for name in ("prefilter", "load", "rest")]
    np.testing.assert_allclose(sum(parts), felt_less_asked, atol=1e-9)
    assert parts[1][1] < -0.2  # a third of a decibel at 122 Hz
    rows = list(csv.DictReader((tmp_path / "measured" / "response.csv").read_text().splitlines()))
    assert [float(row["measured_v"]) for row in rows][:2] == pytest.approx(answer["magnitude_v"])
    assert (tmp_path / "measured" / "response.svg").exists()
    assert (answer["frequency_hz"], answer["load"]) == ([5.0, 122.0], "finger")
    brief = ("--frequency-hz", "200", "--level", "0", "--confidence-db", "0.05", "--longest-s", "1")
    assert run("measure", *paper, *brief).status == 1


def test_noise_finger_and_disturb__of_the_papers_loop__tell_levels_loads_and_rejection(paper, run) -> None:
    ended = run("noise", *paper, "--gains", "4,32", "--json")
    answer = json.loads(ended.out)
    assert ended.status == (1 if answer["outcome"] == "not met" else 0)
    assert set(answer["objectives"]) == {"ii", "iii"}
    assert [played["under"] for played in answer["runs"]] == ["gain 4", "gain 32", "loop"]
    lines = [played["channels"][0]["worst_line_db_sl"] for played in answer["runs"]]
    assert lines[1] > lines[0]
    asked = ("finger", *paper, "--duration-s", "27")
    (answer,) = run.json(*asked)["channels"]
    assert answer["described_by"] == "one"
    values = [answer[name] for name in ("mass", "damping", "stiffness")]
    np.testing.assert_allclose(values, [0.12, 31.0, 360.0], rtol=0.01)
    assert run.json(*asked, "--load", "none", status=1)["channels"][0]["described_by"] == "cannot tell"
    rejection = run.json("disturb", *paper, "--frequency-hz", "1,10")["channels"][0]["rejection"]
    np.testing.assert_allclose(rejection["measured_db"], rejection["expected_db"], atol=0.4)


def test_calibrate__outlier__is_refused_by_name_or_stops(run, tmp_path) -> None:
    pairs = tmp_path / "pairs.csv"
    rows = [f"p{k},{x},{0.19898 * x + (0.5 if k == 3 else 0.0)}" for k, x in enumerate(range(-6, 7))]
    pairs.write_text("name,displacement_mm,voltage_v\n" + "\n".join(rows) + "\n")
    ended = run("calibrate", pairs, "--json")
    answer = json.loads(ended.out)
    assert answer["sensor_gain_v_per_mm"] == pytest.approx(0.19898, rel=0.005)
    assert [pair["name"] for pair in answer["refused"]] == ["p3"]
    assert "p3" in ended.err
    run.refused("calibrate", pairs, "--strict", said="p3")
