"""A model held against records that its fit never saw, and one model of several records."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.identification.validation import validate
from tactuator.io.record import write_record
from tactuator.signals.record import Record
from tests.identification.motors import motor
from tests.identification.others import Plant, band_limited

PLANT = Plant(np.zeros(0), np.array([-42.65 + 435.0j, -42.65 - 435.0j]), 2.0, 0.0)
RATE_HZ = 610.35


@cache
def made(seed: int, plant: Plant = PLANT, closed: bool = False) -> Record:
    return Record(RATE_HZ, *band_limited(plant, np.random.default_rng(seed), RATE_HZ, 6.0, 40.0, closed))


@pytest.fixture(scope="module")
def found() -> Identification:
    return identify(made(1), order=2, zeros=0, hold="band-limited")


@pytest.mark.parametrize(("seed", "closed"), [(2, False), (3, True)])
def test_validate__same_mechanism__holds(found: Identification, seed: int, closed: bool) -> None:
    stands = validate(found, made(seed, closed=closed))
    assert stands.failures == ()
    assert stands.inside > 0.85
    assert stands.fit_percent > 98.0


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (replace(PLANT, gain=2.04), "follows the command"),
        (replace(PLANT, poles=1.02 * PLANT.poles), "inside the band"),
        (replace(PLANT, delay_s=0.5e-3), "inside the band"),
    ],
)
def test_validate__another_mechanism__fails_with_the_reason(found: Identification, other: Plant, reason: str) -> None:
    stands = validate(found, made(4, other), "bench.h5")
    assert any(reason in one and "bench.h5" in one for one in stands.failures)


def test_validate__motor_with_friction__holds_on_its_other_half_and_fails_with_another_mass() -> None:
    _, command, position = motor(np.random.default_rng(3), duration_s=14.0, steps=10)
    half = command.size // 2
    found = identify(Record(1000.0, command[:half], position[:half]))
    assert found.model.method == "inverse dynamics"
    assert validate(found, Record(1000.0, command[half:], position[half:])).failures == ()
    assert validate(found, Record(1000.0, 1.3 * command[half:], position[half:])).failures


def test_identify__several_long_records__are_cut_together(monkeypatch: pytest.MonkeyPatch) -> None:
    count = made(1).command.size
    monkeypatch.setattr("tactuator.identification.prepared.LONGEST", count)
    found = identify([made(1), made(5)], order=2, zeros=0, hold="band-limited")
    used = [one for one in found.remarks if one.endswith("are used")]
    assert [one.partition(":")[0] for one in used] == ["record 1", "record 2"]
    assert all(f"the {count // 2 / made(1).rate_hz:.4g} s from" in one for one in used)


def test_identify__several_records__tell_more_than_one() -> None:
    together = identify([made(1), made(5), made(6)], order=2, zeros=0, hold="band-limited")
    alone = identify(made(1), order=2, zeros=0, hold="band-limited")
    assert np.max(together.model.confidence()["gain"] / alone.model.confidence()["gain"]) < 0.75
    frequency = np.geomspace(1.0, 180.0, 60)
    off = np.log(together.model.response(frequency) / PLANT.response(frequency))
    assert np.max(np.abs(off)) < 0.01
    assert np.mean(np.abs(off.real) * 8.686 <= together.model.band_db(frequency)) > 0.8


@pytest.mark.parametrize(
    ("second", "reason"),
    [
        (replace(made(2), rate_hz=600.0), "record 2 has 600 Hz"),
        (replace(made(2), position_unit="mm"), "the same units"),
        (replace(made(2), command=np.zeros(made(2).command.size)), "record 2: the command is constant"),
    ],
)
def test_identify__records_that_do_not_go_together__are_refused(second: Record, reason: str) -> None:
    with pytest.raises(BadInput, match=reason):
        identify([made(1), second])


def test_validate__other_units__are_refused(found: Identification) -> None:
    with pytest.raises(BadInput, match="allowed: the same units"):
        validate(found, replace(made(2), position_unit="mm"))


def test_identify_verb__validation_fails__status_one_and_the_reason(tmp_path: Path, capsys) -> None:
    names = [str(tmp_path / f"{k}.h5") for k in range(3)]
    for name, record in zip(names, (made(1), made(2), made(4, replace(PLANT, gain=2.1))), strict=True):
        write_record(name, record)
    asked = ["identify", names[0], "--order", "2", "--zeros", "0", "--hold", "band-limited", "--json"]
    assert main([*asked, "--validate", names[1]]) == 0
    (held,) = json.loads(capsys.readouterr().out)["validation"]
    assert (held["record"], held["holds"], held["failures"]) == ("1.h5", True, [])
    assert main([*asked, "--validate", names[1], "--validate", names[2]]) == 1
    both = capsys.readouterr()
    assert [one["holds"] for one in json.loads(both.out)["validation"]] == [True, False]
    assert "not to be trusted" in both.err
    assert "2.h5" in both.err
