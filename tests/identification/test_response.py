"""Motors that friction rules, and frequency responses by themselves: simulate, identify, recover, refuse."""

import json
from pathlib import Path

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.identification.asked import Asked
from tactuator.identification.by_response import identify_response
from tactuator.identification.identify import identify
from tactuator.identification.trust import RESPONSE_ALIKE, RESPONSE_OFF
from tactuator.signals.record import FrequencyResponse, Record, minimum_phase
from tests.identification.motors import motor
from tests.identification.others import Plant, band_limited

PLANT = Plant(np.array([-900.0]), np.array([-60.0 + 500.0j, -60.0 - 500.0j]), 2.0, 0.0)
HERTZ = np.geomspace(5.0, 500.0, 60)


def test_identify__motor_with_coulomb_friction_in_a_loop__gain_friction_and_offset_are_found() -> None:
    truth, command, position = motor(np.random.default_rng(3))
    found = identify(Record(1000.0, command, position))
    assert found.model.method == "inverse dynamics"
    assert not found.distrust
    assert found.friction is not None
    assert found.model.num[0] == pytest.approx(truth["gain"], rel=0.02)
    assert found.model.den[1] == pytest.approx(truth["damping"], rel=0.05)
    assert found.friction.coulomb == pytest.approx(truth["coulomb"], rel=0.05)
    assert found.friction.offset == pytest.approx(truth["offset"], rel=0.1)
    assert any("ruled by friction" in remark for remark in found.remarks)
    assert found.tests.feedback is not False
    assert found.model.valid_hz is not None


def test_identify__spring_holds_it__is_no_motor() -> None:
    record = Record(610.35, *band_limited(PLANT, np.random.default_rng(4), 610.35, 8.0, 40.0))
    assert identify(record, order=2, zeros=0, hold="band-limited").model.method == "spectral"


def test_minimum_phase__of_a_plant_without_dead_time__is_its_phase() -> None:
    value = PLANT.response(HERTZ)
    assert np.max(np.abs(minimum_phase(HERTZ, np.abs(value)) - np.unwrap(np.angle(value)))) < np.radians(5.0)


@pytest.mark.parametrize("with_phase", [True, False])
def test_identify_response__of_a_known_plant__recovers_it(with_phase: bool) -> None:
    rng = np.random.default_rng(5)
    value = PLANT.response(HERTZ) * (1.0 + 0.003 * rng.standard_normal(HERTZ.size))
    phase = np.unwrap(np.angle(value)) if with_phase else None
    given = FrequencyResponse(HERTZ, np.abs(value), phase, np.full(HERTZ.size, 0.003 if with_phase else 0.01))
    found = identify_response(given, Asked())
    assert found.order == 2
    assert not found.distrust
    off = np.log(found.model.response(HERTZ) / PLANT.response(HERTZ))
    assert np.max(np.abs(off.real)) * 8.686 < (0.05 if with_phase else 0.3)
    assert found.model.valid_hz == pytest.approx((HERTZ[0], HERTZ[-1]))


@pytest.mark.parametrize("turned", [0.0, 1.0])
def test_identify_response__without_confidence_and_with_noise__keeps_to_its_poles(turned: float) -> None:
    rng = np.random.default_rng(1)
    value = PLANT.response(HERTZ)
    for deviation in (0.02, 0.06):
        noise = rng.standard_normal(HERTZ.size) + 1j * turned * rng.standard_normal(HERTZ.size)
        seen = value * (1.0 + deviation * noise)
        guess = np.full(HERTZ.size, 0.01)
        given = FrequencyResponse(HERTZ, np.abs(seen), np.unwrap(np.angle(seen)), guess, assumed=True)
        found = identify_response(given, Asked())
        assert found.order == 2
        assert not found.distrust
        assert any("the error is" in remark for remark in found.remarks)
        off = 20.0 * np.log10(np.abs(found.model.response(HERTZ) / value))
        assert np.mean(np.abs(off) <= found.model.band_db(HERTZ)) > 0.8


def test_identify_response__assumed_confidence_and_another_form__is_not_trusted() -> None:
    given = FrequencyResponse(
        HERTZ, np.abs(PLANT.response(HERTZ)), np.angle(PLANT.response(HERTZ)), np.full(60, 0.01), assumed=True
    )
    found = identify_response(given, Asked(order=1, zeros=0))
    assert any(RESPONSE_ALIKE.name in reason for reason in found.distrust)


def test_identify_response__that_no_small_model_has__is_not_trusted() -> None:
    rng = np.random.default_rng(6)
    given = FrequencyResponse(HERTZ, np.exp(rng.standard_normal(HERTZ.size)), None, np.full(HERTZ.size, 0.01))
    found = identify_response(given, Asked(order=2))
    assert any(RESPONSE_OFF.name in reason for reason in found.distrust)


def test_identify_verb__response_in_a_file__writes_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    value = PLANT.response(HERTZ)
    rows = np.stack([HERTZ, 20.0 * np.log10(np.abs(value)), np.degrees(np.angle(value))], axis=1)
    np.savetxt(tmp_path / "sheet.csv", rows, delimiter=",", header="frequency_hz,magnitude_db,phase_deg", comments="")
    assert main(["identify", str(tmp_path / "sheet.csv"), "--out", str(tmp_path / "model.json"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["order"] == 2
    assert json.loads((tmp_path / "model.json").read_text())["valid_hz"] == pytest.approx([5.0, 500.0])


def test_identify_verb__phase_half_missing__is_told_in_one_line(tmp_path: Path, capsys) -> None:
    text = "frequency_hz,magnitude_db,phase_deg\n"
    text += "".join(f"{hertz:g},1.0,{'nan' if k % 3 else '0'}\n" for k, hertz in enumerate(HERTZ))
    (tmp_path / "sheet.csv").write_text(text)
    assert main(["identify", str(tmp_path / "sheet.csv")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "phase is missing" in said


@pytest.mark.parametrize(
    ("frequency", "magnitude", "match"),
    [
        ([1.0, 2.0, 3.0], [1.0, 1.0, 1.0], "4 or more"),
        ([1.0, 3.0, 2.0, 4.0], [1.0] * 4, "ascend"),
        ([1.0, 2.0, 3.0, 4.0], [1.0, -1.0, 1.0, 1.0], "above zero"),
    ],
)
def test_frequency_response__not_one__is_refused(frequency, magnitude, match) -> None:
    with pytest.raises(BadInput, match=match):
        FrequencyResponse(np.array(frequency), np.array(magnitude), None, np.ones(len(magnitude)))
