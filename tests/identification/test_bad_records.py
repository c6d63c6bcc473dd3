"""Records and responses that something is wrong with: refused in one line, or handled and remarked."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tactuator
from tactuator.errors import BadInput
from tactuator.identification.constancy import read_at
from tactuator.identification.identify import identify
from tactuator.identification.trust import CLIPPED
from tactuator.io.record import is_response, read_foreign_response, read_record
from tactuator.signals.record import Record
from tests.identification.others import Plant, band_limited

PLANT = Plant(np.zeros(0), np.array([-42.65 + 435.0j, -42.65 - 435.0j]), 2.0, 0.0)
RATE_HZ = 610.35
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
        (lambda folder: written(folder, np.r_[:HALF, :HALF]), "time goes back in row"),
        (lambda folder: written(folder, np.r_[:HALF, HALF + 400 : TIME.size]), "400 of .* samples are missing"),
        (
            lambda folder: written(folder, np.s_[:], position=np.where(ODD, np.nan, POSITION)),
            rf"position is not a number in row 2 of {TIME.size} and in {TIME.size // 2 - 1} more; allowed: numbers",
        ),
    ],
    ids=["two runs pasted", "a long gap", "half of it missing"],
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
        (replace(GOOD, position=TIME), "no model can be told from it"),
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


def test_identify__runs_pasted_without_stamps__are_said_and_fitted_across_the_seam() -> None:
    other = band_limited(PLANT, np.random.default_rng(2), RATE_HZ, 6.0, 40.0)
    command = np.concatenate([GOOD.command[:HALF], other[0][:HALF]])
    position = np.concatenate([GOOD.position[:HALF], other[1][:HALF]])
    pasted = replace(GOOD, command=command, position=position)
    assert off_db(pasted) < 0.1
    mended = identify(pasted, **KNOWN)
    (said,) = (remark for remark in mended.remarks if "a knock or a seam" in remark)
    assert float(said.split()[2]) == pytest.approx(HALF / RATE_HZ, abs=0.02)
    assert not mended.distrust
    sound = identify(GOOD, **KNOWN)
    assert not sound.distrust
    assert sound.model.method == "refined"  # a spring holds it: no motor


def test_identify__position_of_a_slower_logger_filled_up__is_read_where_it_was() -> None:
    at = np.arange(1.0, TIME.size, 2.0)
    position = np.interp(np.arange(TIME.size), at, np.interp(at, np.arange(TIME.size), POSITION))
    found = identify(replace(GOOD, position=position), hold="band-limited", order=2, zeros=0)
    hertz = np.geomspace(2.0, 120.0, 40)
    off = np.abs(20.0 * np.log10(np.abs(found.model.response(hertz) / PLANT.response(hertz))))
    assert not found.distrust
    assert any("of every 2 samples" in one for one in found.remarks)
    assert np.max(off) < 0.1


def test_read_at__codes_of_a_converter_rounded_in_a_file__are_all_of_them_read() -> None:
    bench = np.genfromtxt(Path(tactuator.__file__).parent / "io" / "examples" / "bench.csv", delimiter=",", names=True)
    assert read_at(Record(2000.0, bench["drive"], bench["encoder"])) == slice(0, None, 1)


def test_identify__columns_swapped__is_said_before_the_fit_and_not_trusted() -> None:
    said: list[str] = []
    swapped = replace(GOOD, command=GOOD.position, position=GOOD.command)
    found = identify(swapped, hold="band-limited", order=2, note=said.append, warn=said.append)
    assert "look swapped" in said[0]
    assert any("look swapped" in reason for reason in found.distrust)


def test_read_foreign_response__columns_of_others__are_read_or_refused(tmp_path: Path) -> None:
    hertz, path = np.geomspace(1.0, 100.0, 30), tmp_path / "sheet.csv"
    value = PLANT.response(hertz)

    def sheet(head: str, row: Callable[[int, complex], str]) -> Path:
        rows = [f"{f},{row(k, c)}" for k, (f, c) in enumerate(zip(hertz, value, strict=True))]
        path.write_text("\n".join([f"frequency_hz,{head}", *rows]) + "\n")
        return path

    with pytest.raises(BadInput, match="or with real and imag"):
        read_foreign_response(sheet("response", lambda _, c: f"{c.real:g}{c.imag:+g}j"))
    assert is_response(sheet("real,imag", lambda _, c: f"{c.real:.9g},{c.imag:.9g}"))
    np.testing.assert_allclose(read_foreign_response(path).value(), value, rtol=1e-7)
    with pytest.raises(BadInput, match="phase is missing"):
        read_foreign_response(sheet("magnitude_db,phase_deg", lambda k, _: f"1.0,{'nan' if k % 3 else '0'}"))
    halved = read_foreign_response(
        sheet("magnitude,phase_deg", lambda k, c: f"{abs(c):g},{np.degrees(np.angle(c)) if k % 2 else ''}")
    )
    assert halved.frequency_hz.size == 15
    assert any("15 of 30 points" in remark for remark in halved.remarks)
