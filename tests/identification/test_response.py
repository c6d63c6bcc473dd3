"""Frequency responses by themselves: simulate, identify, recover, refuse; values that a user fixes, and how."""

import json

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.identification.by_response import identify_response
from tactuator.identification.identify import identify
from tactuator.identification.options import Fixed, IdentifyOptions
from tactuator.identification.trust import FIXED_DB, RESPONSE_ALIKE, RESPONSE_OFF
from tactuator.model.plausibility import response_doubts
from tactuator.signals.record import FrequencyResponse, Record, minimum_phase
from tests.cli.refusals import refused
from tests.identification.others import Plant

PLANT = Plant(np.array([-900.0]), np.array([-60.0 + 500.0j, -60.0 - 500.0j]), 2.0, 0.0)
HERTZ = np.geomspace(5.0, 500.0, 60)


def test_minimum_phase__of_a_plant_without_dead_time__is_its_phase() -> None:
    value = PLANT.response(HERTZ)
    assert np.max(np.abs(minimum_phase(HERTZ, np.abs(value)) - np.unwrap(np.angle(value)))) < np.radians(5.0)


@pytest.mark.parametrize("points", [10, 15, 30])
@pytest.mark.parametrize("delay_s", [0.0, 2e-3, 10e-3])
def test_response_doubts__sparse_wrapped_phase__is_no_slip_and_a_slip_is_the_right_one(points, delay_s) -> None:
    for hertz in (np.geomspace(10.0, 1000.0, points), np.linspace(10.0, 1000.0, points)):
        value = PLANT.response(hertz) * np.exp(-2j * np.pi * hertz * delay_s)
        phase, error = np.angle(value), np.full(points, 0.01)
        assert response_doubts(FrequencyResponse(hertz, np.abs(value), phase, error)) == ()
        for slip, misread in (
            ("degrees where radians", np.degrees(phase)),
            ("radians where degrees", np.radians(phase)),
        ):
            said = response_doubts(FrequencyResponse(hertz, np.abs(value), misread, error))
            assert all(slip in each for each in said)
            assert said or points < 30


@pytest.mark.parametrize("with_phase", [True, False])
def test_identify_response__of_a_known_plant__recovers_it(with_phase: bool) -> None:
    rng = np.random.default_rng(5)
    value = PLANT.response(HERTZ) * (1.0 + 0.003 * rng.standard_normal(HERTZ.size))
    phase = np.unwrap(np.angle(value)) if with_phase else None
    given = FrequencyResponse(HERTZ, np.abs(value), phase, np.full(HERTZ.size, 0.003 if with_phase else 0.01))
    found = identify_response(given, IdentifyOptions())
    assert found.order == 2
    assert not found.distrust
    off = np.log(found.model.response(HERTZ) / PLANT.response(HERTZ))
    assert np.max(np.abs(off.real)) * 8.686 < (0.05 if with_phase else 0.3)
    assert found.model.valid_hz == pytest.approx((HERTZ[0], HERTZ[-1]))


@pytest.mark.parametrize(("turned", "deviation"), [(0.0, 0.06), (1.0, 0.02)])
def test_identify_response__without_confidence_and_with_noise__keeps_to_its_poles(turned, deviation) -> None:
    rng = np.random.default_rng(1)
    value = PLANT.response(HERTZ)
    noise = rng.standard_normal(HERTZ.size) + 1j * turned * rng.standard_normal(HERTZ.size)
    seen = value * (1.0 + deviation * noise)
    guess = np.full(HERTZ.size, 0.01)
    given = FrequencyResponse(HERTZ, np.abs(seen), np.unwrap(np.angle(seen)), guess, assumed=True)
    found = identify_response(given, IdentifyOptions())
    assert found.order == 2
    assert not found.distrust
    assert any("the error is" in remark for remark in found.remarks)
    off = 20.0 * np.log10(np.abs(found.model.response(HERTZ) / value))
    assert np.mean(np.abs(off) <= found.model.band_db(HERTZ)) > 0.8


@pytest.mark.parametrize(
    ("assumed", "with_phase"), [(True, True), (False, True), pytest.param(True, False, marks=pytest.mark.slow)]
)
def test_identify_response__bad_readings__are_left_out_and_named(assumed: bool, with_phase: bool) -> None:
    rng = np.random.default_rng(9)
    value = PLANT.response(HERTZ) * (1.0 + 0.007 * (rng.standard_normal(60) + 1j * rng.standard_normal(60)))
    bad, off_db = [12, 33, 48], np.array([6.0, -10.0, -6.0])
    value[bad] *= 10.0 ** (off_db / 20.0)
    phase = np.unwrap(np.angle(value)) if with_phase else None
    given = FrequencyResponse(HERTZ, np.abs(value), phase, np.full(60, 0.007), assumed=assumed)
    found = identify_response(given, IdentifyOptions())
    assert (found.order, found.distrust) == (2, ())
    (remark,) = (remark for remark in found.remarks if "left out" in remark)
    assert all(f"{HERTZ[k]:.5g}" in remark for k in bad)
    off = 20.0 * np.log10(np.abs(found.model.response(HERTZ) / PLANT.response(HERTZ)))
    assert np.max(np.abs(off)) < 0.1
    assert np.all(found.model.band_db(HERTZ[bad]) >= np.abs(off_db) - 0.3)
    assert np.all(np.delete(found.model.band_db(HERTZ), bad) < 0.1)


@pytest.mark.parametrize(("order", "right"), [pytest.param(None, True, marks=pytest.mark.slow), (3, False), (5, True)])
def test_identify_response__magnitudes_alone__is_right_or_refused(order, right):
    """With five poles it was 2.8 dB off, and trusted."""
    pair = np.array([-100.0 + 1540.0j, -100.0 - 1540.0j])
    plant = Plant(0.88 * pair, np.array([*np.roots([1.0, 94.0, 290.0]), *pair]), 9.0, 2e-3)
    hertz, below = np.geomspace(1.0, 500.0, 90), np.geomspace(1.0, 300.0, 500)
    size = np.abs(plant.response(hertz)) * (1.0 + 0.012 * np.random.default_rng(7).standard_normal(90))
    given = FrequencyResponse(hertz, size, None, np.full(90, 0.01), assumed=True)
    found = identify_response(given, IdentifyOptions(order=order))
    off_db = 20.0 * np.log10(np.abs(found.model.response(below) / plant.response(below)))
    assert (found.order, found.distrust == (), np.max(np.abs(off_db)) < 0.2) == (order or 4, right, right)
    assert (found.model.valid_hz[1] < 200.0) is not right
    assert right or any(reason.startswith(f"{FIXED_DB.name}, by itself it shows 4 poles") for reason in found.distrust)


def test_identify_response__bad_first_of_few__the_band_holds_reading_and_pole() -> None:
    rng, hertz = np.random.default_rng(0), np.linspace(3.0, 400.0, 21)
    s, w, low = 2j * np.pi * hertz, 2.0 * np.pi * 143.0, np.geomspace(3.0, 20.0, 40)
    value = (
        w**2 / (s**2 + w / 8.6 * s + w**2) * (1.0 + 0.014 * (rng.standard_normal(21) + 1j * rng.standard_normal(21)))
    )
    value[0] *= 5.0
    phase = np.unwrap(np.angle(value))
    found = identify_response(
        FrequencyResponse(hertz, np.abs(value), phase, np.full(21, 0.01), assumed=True), IdentifyOptions()
    )
    assert not found.distrust
    off_db = 20.0 * np.log10(np.abs(found.model.response(low)))  # of one
    assert np.all(np.abs(off_db) < found.model.band_db(low) + 0.3)


@pytest.mark.parametrize(
    ("magnitude", "assumed", "order", "reason"),
    [
        (np.abs(PLANT.response(HERTZ)), True, 1, RESPONSE_ALIKE),
        (np.exp(np.random.default_rng(6).standard_normal(HERTZ.size)), False, 2, RESPONSE_OFF),
    ],
)
def test_identify_response__that_the_form_does_not_have__is_not_trusted(magnitude, assumed, order, reason) -> None:
    given = FrequencyResponse(HERTZ, magnitude, np.angle(PLANT.response(HERTZ)), np.full(60, 0.01), assumed=assumed)
    found = identify_response(given, IdentifyOptions(order=order, zeros=0))
    assert any(reason.name in one for one in found.distrust)


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


def test_parse__every_name__is_read_and_written_alike() -> None:
    for text in ("gain=-0.5", "pole=500", "delay_s=0.002"):
        assert str(Fixed.parse(text)) == text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mass=1", "no value to fix 'mass'; expected gain, pole, delay_s"),
        ("den_s0=1", "no value to fix 'den_s0'"),
        ("gain", "NAME=VALUE"),
        ("gain=large", "NAME=VALUE"),
        ("pole=nan", "a finite number"),
        ("gain=inf", "a finite number"),
        ("gain=0", "other than zero"),
        ("pole=-100", "left half plane"),
        ("delay_s=-1e-3", "0 or more"),
    ],
)
def test_parse__no_value__is_refused(text: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        Fixed.parse(text)


@pytest.mark.parametrize(
    ("texts", "asked", "words"),
    [
        (["gain=1", "gain=2"], {}, "gain is fixed twice"),
        (["delay_s=0", "delay_s=1"], {}, "delay_s is fixed twice"),
        (["gain=1"], {"integrators": 1}, "poles or zeros at s = 0"),
        (["gain=1"], {"quantity": "velocity"}, "poles or zeros at s = 0"),
        (["pole=60", "pole=100"], {"order": 1}, "2 poles are known of 1"),
    ],
)
def test_asked__values_that_contradict__are_refused(texts: list[str], asked: dict, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        IdentifyOptions(**asked, fixed=tuple(map(Fixed.parse, texts)))


def test_identify__fixed_value_without_its_search_or_its_phase__is_refused(tmp_path, capsys) -> None:
    command, position = np.random.default_rng(0).standard_normal((2, 400))
    with pytest.raises(BadInput, match="with 'refined' alone"):
        identify(Record(1000.0, command, position), method="rls", fixed=(Fixed("gain", 1.0),))
    rows = "".join(f"{hertz:g},{1.0 / hertz:g}\n" for hertz in np.geomspace(5.0, 500.0, 20))
    (tmp_path / "sheet.csv").write_text("frequency_hz,magnitude\n" + rows)
    arguments = ["identify", str(tmp_path / "sheet.csv"), "--fix", "pole=100"]
    refused(arguments, "a magnitude without phase", capsys, tmp_path)
    refused([*arguments[:2], "--fix", "mass=1"], "no value to fix 'mass'; expected gain, pole", capsys, tmp_path)


def test_identify_verb__fixed_values__are_in_answer_table_and_model(tmp_path, capsys) -> None:
    hertz = np.geomspace(5.0, 500.0, 40)
    s = 2j * np.pi * hertz
    value = 50.0 / (s**2 + 90.0 * s + 142000.0)
    rows = np.stack([hertz, 20.0 * np.log10(np.abs(value)), np.degrees(np.angle(value))], axis=1)
    head = "frequency_hz,magnitude_db,phase_deg"
    np.savetxt(tmp_path / "sheet.csv", rows, delimiter=",", header=head, comments="")
    arguments = ["identify", str(tmp_path / "sheet.csv"), "--fix", f"gain={50.0 / 142000.0!r}", "--fix", "delay_s=0"]
    assert main([*arguments, "--out", str(tmp_path / "model.json"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    (known,) = printed["fixed"]
    assert (known["name"], known["own"]) == ("gain", pytest.approx(50.0 / 142000.0, rel=1e-3))
    assert printed["model"]["num"][0] / printed["model"]["den"][-1] == pytest.approx(50.0 / 142000.0, rel=1e-15)
    assert printed["confidence"]["gain"] < 1e-15
    assert printed["confidence"]["delay_s"] == 0.0
    written = json.loads((tmp_path / "model.json").read_text())
    assert written["record"]["fixed"] == "gain=0.000352113 delay_s=0"
    assert written["valid_hz"] == pytest.approx([5.0, 500.0])
    assert main([*arguments, "--full"]) == 0
    assert "fixed: gain" in capsys.readouterr().out
