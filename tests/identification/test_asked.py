"""Values that a user fixes: how they are written, and which are refused."""

import json

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.identification.asked import Asked, Fixed
from tactuator.identification.identify import identify
from tactuator.signals.record import Record
from tests.cli.refusals import refused


def test_parse__every_name__is_read_and_written_alike() -> None:
    for text in ("gain=-0.5", "stiffness=2842", "mass=0.02", "pole=500", "resonance=60,4", "num_s1=-3", "den_s0=1e+06"):
        assert str(Fixed.parse(text)) == text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("weight=1", "allowed: gain, stiffness, mass, pole, resonance"),
        ("mass", "allowed: NAME=VALUE"),
        ("mass=heavy", "allowed: NAME=VALUE"),
        ("resonance=60", "resonance=HERTZ,Q"),
        ("mass=nan", "a finite number"),
        ("gain=inf", "a finite number"),
        ("gain=0", "other than zero"),
        ("mass=-0.02", "above zero"),
        ("pole=-100", "left half plane"),
        ("resonance=60,0", "Q above zero"),
        ("den_s0=-1", "above zero"),
        ("den_s9=1", "allowed: gain"),
    ],
)
def test_parse__no_value__is_refused(text: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        Fixed.parse(text)


@pytest.mark.parametrize(
    ("texts", "asked", "words"),
    [
        (["mass=1", "mass=2"], {}, "mass is fixed twice"),
        (["gain=1", "stiffness=2"], {}, "one value"),
        (["gain=1"], {"integrators": 1}, "poles or zeros at s = 0"),
        (["stiffness=1"], {"quantity": "velocity"}, "poles or zeros at s = 0"),
        (["resonance=60,4", "pole=100"], {"order": 2}, "3 poles are known of 2"),
        (["den_s0=1"], {}, "without --order"),
        (["den_s2=1"], {"order": 2}, "allowed powers: 0 to 1"),
        (["num_s2=1"], {"order": 3, "zeros": 1}, "allowed powers: 0 to 1"),
        (["mass=1"], {"order": 2, "zeros": 1}, "two poles more than zeros"),
        (["mass=1", "num_s0=1"], {"order": 2}, "one value"),
        (["gain=1", "num_s0=1", "den_s0=1"], {"order": 2}, "two of them give the third"),
        (["pole=100", "den_s0=1", "den_s1=1"], {"order": 2}, "more coefficients"),
    ],
)
def test_asked__values_that_contradict__are_refused(texts: list[str], asked: dict, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        Asked(**asked, fixed=tuple(map(Fixed.parse, texts)))


def test_identify__fixed_value_without_its_search_or_its_phase__is_refused(tmp_path, capsys) -> None:
    command, position = np.random.default_rng(0).standard_normal((2, 400))
    with pytest.raises(BadInput, match="allowed: with 'refined' alone"):
        identify(Record(1000.0, command, position), method="rls", fixed=(Fixed("mass", 1.0),))
    rows = "".join(f"{hertz:g},{1.0 / hertz:g}\n" for hertz in np.geomspace(5.0, 500.0, 20))
    (tmp_path / "sheet.csv").write_text("frequency_hz,magnitude\n" + rows)
    arguments = ["identify", str(tmp_path / "sheet.csv"), "--fix", "pole=100"]
    refused(arguments, "a magnitude without phase", capsys, tmp_path)
    refused([*arguments[:2], "--fix", "weight=1"], "'weight'", capsys, tmp_path)


def test_identify_verb__fixed_values__are_in_answer_table_and_model(tmp_path, capsys) -> None:
    hertz = np.geomspace(5.0, 500.0, 40)
    s = 2j * np.pi * hertz
    value = 50.0 / (s**2 + 90.0 * s + 142000.0)
    rows = np.stack([hertz, 20.0 * np.log10(np.abs(value)), np.degrees(np.angle(value))], axis=1)
    head = "frequency_hz,magnitude_db,phase_deg"
    np.savetxt(tmp_path / "sheet.csv", rows, delimiter=",", header=head, comments="")
    arguments = ["identify", str(tmp_path / "sheet.csv"), "--fix", "mass=0.02", "--fix", "stiffness=2840"]
    assert main([*arguments, "--out", str(tmp_path / "model.json"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in printed["fixed"]] == ["mass", "stiffness"]
    assert printed["fixed"][0]["own"] == pytest.approx(0.02, rel=1e-3)
    assert printed["model"]["num"] == [50.0]
    assert printed["model"]["den"][-1] == pytest.approx(142000.0, rel=1e-12)
    assert printed["confidence"]["num"] == [0.0]
    assert printed["confidence"]["gain"] == 0.0
    written = json.loads((tmp_path / "model.json").read_text())
    assert written["record"]["fixed"] == "mass=0.02 stiffness=2840"
    assert written["valid_hz"] == pytest.approx([5.0, 500.0])
    assert main(arguments) == 0
    assert "fixed: mass" in capsys.readouterr().out
