"""Models held against records that their fit never saw; records that something is wrong with: refused or remarked."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import tactuator
from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.identification.alignment import read_at
from tactuator.identification.check import check_direction, check_rise, empirical_response
from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.identification.trust import CLIPPED, KNOCK
from tactuator.identification.validation import validate
from tactuator.io.columns import read_columns
from tactuator.io.record import read_record, write_record
from tactuator.io.response_table import are_of_response, response_of
from tactuator.signals.record import FrequencyResponse, Record
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


def test_identify__several_long_records__are_cut_together(monkeypatch: pytest.MonkeyPatch) -> None:
    count = made(1).command.size
    monkeypatch.setattr("tactuator.identification.alignment.LONGEST", count)
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
    with pytest.raises(BadInput, match="the same units"):
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


GOOD = Record(RATE_HZ, *band_limited(PLANT, np.random.default_rng(1), RATE_HZ, 6.0, 40.0))
TIME = np.arange(GOOD.command.size) / RATE_HZ
HALF, ODD = TIME.size // 2, np.arange(TIME.size) % 2
POSITION, SPREAD = GOOD.position, float(np.std(GOOD.position))
KNOWN = {"order": 2, "zeros": 0, "hold": "band-limited"}


def written(folder: Path, keep: slice | np.ndarray, time: np.ndarray = TIME, position: np.ndarray = POSITION) -> Path:
    path, columns = folder / "bench.csv", np.stack([time, GOOD.command, position], axis=1)[keep]
    np.savetxt(path, columns, delimiter=",", header="time_s,command,position", comments="")
    return path


def off_db(record: Record) -> float:
    hertz = np.geomspace(2.0, 0.3 * RATE_HZ, 40)
    model = identify(record, **KNOWN).model
    return float(np.max(np.abs(20.0 * np.log10(np.abs(model.response(hertz) / PLANT.response(hertz))))))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda folder: written(folder, np.r_[:HALF, HALF - 2 : TIME.size]), "time goes back in row"),
        (lambda folder: written(folder, np.r_[:HALF, HALF + 400 : TIME.size]), "400 of .* samples are missing"),
        (
            lambda folder: written(folder, np.s_[:], position=np.where(ODD, np.nan, POSITION)),
            rf"position is not a number in row 2 of {TIME.size - 1} and in {TIME.size // 2 - 2} more; expected numbers",
        ),
    ],
    ids=["rows twice", "a long gap", "half of it missing"],
)
def test_read_record__that_is_amiss__is_refused_in_one_line(tmp_path, make, reason) -> None:
    with pytest.raises(BadInput, match=reason) as caught:
        read_record(make(tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("record", "reason"),
    [
        (replace(GOOD, command=np.ones(TIME.size)), "the command is constant"),
        (replace(GOOD, command=np.ones(TIME.size), position=np.interp(TIME, TIME[::4], POSITION[::4])), "constant"),
        (replace(GOOD, position=np.clip(GOOD.position, -0.8 * SPREAD, 0.8 * SPREAD)), "of the position is clipped"),
        (replace(GOOD, command=np.sin(2.0 * np.pi * 20.0 * TIME)), "excites order"),
        (replace(GOOD, position=TIME), "no model can be estimated from it"),
    ],
    ids=["constant command", "constant and filled up", "clipped sensor", "one sinusoid", "time for the position"],
)
def test_identify__record_that_tells_nothing__is_refused(record: Record, reason: str) -> None:
    with pytest.raises(BadInput, match=reason):
        identify(record)


def test_identify__short_gap_and_jitter__are_mended_and_said(tmp_path: Path) -> None:
    mended = read_record(written(tmp_path, np.r_[:HALF, HALF + 20 : TIME.size]))
    assert any("20 samples are missing" in remark for remark in mended.remarks)
    assert off_db(mended) < 0.1
    jitter = np.random.default_rng(0).uniform(-0.05, 0.05, TIME.size) / RATE_HZ
    uneven = read_record(written(tmp_path, np.s_[:], TIME + jitter))
    assert any("uneven" in remark for remark in uneven.remarks)


def test_identify__clipped_sensor__is_not_trusted() -> None:
    limit = 1.8 * SPREAD
    clipped = replace(GOOD, position=np.clip(GOOD.position, -limit, limit))
    assert any(CLIPPED.name in reason for reason in identify(clipped, **KNOWN).distrust)


def test_identify__runs_pasted_without_stamps__are_not_trusted_and_the_seam_is_told() -> None:
    other = band_limited(PLANT, np.random.default_rng(2), RATE_HZ, 6.0, 40.0)
    command = np.concatenate([GOOD.command[:HALF], other[0][:HALF]])
    position = np.concatenate([GOOD.position[:HALF], other[1][:HALF]])
    pasted = identify(replace(GOOD, command=command, position=position), **KNOWN)
    (told,) = (reason for reason in pasted.distrust if reason.startswith(KNOCK.name))
    assert float(told.partition(" at ")[2].split()[0]) == pytest.approx(HALF / RATE_HZ, abs=0.02)
    assert "`to_s`" in told
    assert not identify(GOOD, **KNOWN).distrust


def test_identify__position_of_a_slower_logger_filled_up__is_refused() -> None:
    at = np.arange(1.0, TIME.size, 2.0)
    position = np.interp(np.arange(TIME.size), at, np.interp(at, np.arange(TIME.size), POSITION))
    with pytest.raises(BadInput, match="of every 2 samples of the position one was read"):
        identify(replace(GOOD, position=position), hold="band-limited", order=2, zeros=0)


@pytest.fixture(scope="module")
def bench() -> Record:
    table = np.genfromtxt(Path(tactuator.__file__).parent / "io" / "examples" / "bench.csv", delimiter=",", names=True)
    return Record(2000.0, table["drive"], table["encoder"])


def test_read_at__codes_of_a_converter_rounded_in_a_file__are_all_of_them_read(bench: Record) -> None:
    assert read_at(bench) == slice(0, None, 1)


def test_identify__columns_swapped__is_said_before_the_fit_and_not_trusted() -> None:
    said: list[str] = []
    swapped = replace(GOOD, command=GOOD.position, position=GOOD.command)
    found = identify(swapped, hold="band-limited", order=2, note=said.append, warn=said.append)
    assert "look swapped" in said[0]
    assert any("look swapped" in reason for reason in found.distrust)


def test_columns__of_cuts_of_any_length__look_swapped_only_where_they_are(bench: Record) -> None:
    for count in (100, 121, 150, 200, 300, 500, 1000, 2000, 4000, 16000):
        for first in range(0, 16001 - count, max(count, 500)):
            u, y = (each[first : first + count] for each in (bench.command, bench.position))
            right, wrong = (
                empirical_response(one - one.mean(), two - two.mean(), 2000.0) for one, two in ((u, y), (y, u))
            )
            assert check_direction(right) == check_rise(right) == ()
            assert check_direction(wrong) or count < 1000


def test_identify__record_too_short_to_tell__names_its_length_and_no_slip(bench: Record) -> None:
    short = Record(2000.0, bench.command[:121], bench.position[:121])
    found, swapped = (
        identify(each) for each in (short, replace(short, command=short.position, position=short.command))
    )
    for reasons in (found.distrust, swapped.distrust):
        assert "in a record of 0.0605 s: " in reasons[0]
        assert not any("swapped" in reason for reason in reasons)
    assert not any("swapped" in row.where for row in (*found.model.trust, *swapped.model.trust) if row.beyond)


def test_read_foreign_response__columns_of_others__are_read_or_refused(tmp_path: Path) -> None:
    hertz, path = np.geomspace(1.0, 100.0, 30), tmp_path / "sheet.csv"
    value = PLANT.response(hertz)

    def sheet(head: str, row: Callable[[int, complex], str]) -> Path:
        rows = [f"{f},{row(k, c)}" for k, (f, c) in enumerate(zip(hertz, value, strict=True))]
        path.write_text("\n".join([f"frequency_hz,{head}", *rows]) + "\n")
        return path

    def foreign(file: Path) -> FrequencyResponse:
        return response_of(file, read_columns(file))

    with pytest.raises(BadInput, match="or with real and imag"):
        foreign(sheet("response", lambda _, c: f"{abs(c):g}"))
    np.testing.assert_allclose(
        foreign(sheet("response", lambda _, c: f"{c.real:.9g}{c.imag:+.9g}j")).value(), value, rtol=1e-7
    )
    assert are_of_response(read_columns(sheet("real,imag", lambda _, c: f"{c.real:.9g},{c.imag:.9g}")))
    np.testing.assert_allclose(foreign(path).value(), value, rtol=1e-7)
    with pytest.raises(BadInput, match="phase is missing"):
        foreign(sheet("magnitude_db,phase_deg", lambda k, _: f"1.0,{'nan' if k % 3 else '0'}"))
    halved = foreign(
        sheet("magnitude,phase_deg", lambda k, c: f"{abs(c):g},{np.degrees(np.angle(c)) if k % 2 else ''}")
    )
    assert halved.frequency_hz.size == 15
    assert any("15 of 30 points" in remark for remark in halved.remarks)
