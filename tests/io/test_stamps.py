"""Time stamps that instruments write: counters that wrap, dates, several runs, and samples that were not read."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.io.record import read_record, read_runs

RATE_HZ = 4000.0
COUNT = 6000
INDEX = np.arange(COUNT)
TIME = INDEX / RATE_HZ
U = np.sign(np.sin(2.0 * np.pi * 7.3 * TIME + 0.1))
Y = np.sin(2.0 * np.pi * 5.0 * TIME) + 0.3 * np.sin(2.0 * np.pi * 31.0 * TIME)
TICKS_US = np.round(TIME * 1e6)
Array = NDArray[np.float64]


def written(folder: Path, name: str, time: Array, u: Array = U, y: Array = Y, digits: str = "%.12g") -> Path:
    path = folder / "r.csv"
    rows = "\n".join(f"{digits % t},{a:.9g},{b:.9g}" for t, a, b in zip(time, u, y, strict=True))
    path.write_text(f"{name},command_v,position_v\n{rows}\n")
    return path


@pytest.mark.parametrize(
    ("name", "time", "rate_hz", "says"),
    [
        ("time_us", (TICKS_US + 2.0**32 - 7e5) % 2.0**32, None, r"wraps at 2\^32 in row 2801"),
        ("time_us", TICKS_US % 2.0**16, None, r"wraps at 2\^16"),
        ("time_ms", (TICKS_US / 1e3 + 65.1e3) % 2.0**16, None, r"wraps at 2\^16"),
        ("time_s", (TICKS_US / 1e6 + 4294.5) % (2.0**32 / 1e6), None, r"2\^32 millionths"),
        ("time_s", (TICKS_US / 1e6 + 86399.5) % 86400.0, None, "wraps at a day"),
        ("time_ms", np.floor(TIME * 1e3), RATE_HZ, "taken as even at the 4000 Hz"),
        ("time_ms", np.floor(TIME * 1e3 + 65000.0) % 2.0**16, RATE_HZ, r"wraps at 2\^16"),
        ("timestamp", TICKS_US + 1.7e15, None, "microseconds since 1970"),
        ("timestamp", TICKS_US / 1e3 + 1.7e12, None, "milliseconds since 1970"),
        ("t", 21.0 * INDEX + 5.0, RATE_HZ, "21 to a sample at the 4000 Hz"),
    ],
)
def test_read_record__stamps_of_counters__are_an_even_rate_and_said(tmp_path, name, time, rate_hz, says) -> None:
    read = read_record(written(tmp_path, name, time, digits="%.17g"), rate_hz=rate_hz)
    assert read.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    np.testing.assert_allclose((read.command, read.position), (U, Y), atol=1e-8)
    assert any(re.search(says, remark) for remark in read.remarks)


def test_read_record__iso_dates__are_seconds(tmp_path: Path) -> None:
    dates = np.datetime64("2024-03-01T23:59:59") + TICKS_US.astype("timedelta64[us]")
    path = tmp_path / "r.csv"
    rows = "".join(f"{t},{a},{b}\n" for t, a, b in zip(dates, U, Y, strict=True))
    path.write_text(f"time,command_v,position_v\n{rows}")
    read = read_record(path)
    assert read.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    np.testing.assert_allclose(read.position, Y, atol=1e-8)


def test_read_record__times_of_day__are_seconds_also_over_midnight(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    clock = (86399.5 + TIME) % 86400.0
    rows = "".join(
        f"2024-03-01,{int(t // 3600):02d}:{int(t % 3600 // 60):02d}:{t % 60:09.6f},{a},{b}\n"
        for t, a, b in zip(clock, U, Y, strict=True)
    )
    path.write_text(f"date,time,command_v,position_v\n{rows}")
    read = read_record(path)
    assert read.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    np.testing.assert_allclose(read.position, Y, atol=1e-8)


@pytest.mark.parametrize(
    ("name", "time", "rate_hz", "says"),
    [
        ("time_ms", np.floor(TIME * 1e3), None, r"repeat, 4 rows each; .*`rate_hz`\), 400\d"),
        ("time_ms", np.floor(TIME * 1e3), 5000.0, "at the 5000 Hz given"),
        ("time_ms", np.floor((TIME + (INDEX > 3000) * 0.02) * 1e3), RATE_HZ, "at the 4000 Hz given.*no missing rows"),
        ("time_s", TIME, 21.0, "the time column says 4000"),
        ("time_s", TIME - 0.01 * (INDEX == 3000), None, "time goes back in row 3001"),
    ],
)
def test_read_record__stamps_that_say_no_rate__are_refused(tmp_path, name, time, rate_hz, says) -> None:
    with pytest.raises(BadInput, match=says):
        read_record(written(tmp_path, name, time), rate_hz=rate_hz)


def test_read_runs__several_in_a_file__are_split_and_said(tmp_path: Path) -> None:
    runs = [slice(0, 1000), slice(1000, 4000), slice(4000, 4050), slice(4050, COUNT)]
    time = np.concatenate([TIME[: run.stop - run.start] for run in runs])
    path = written(tmp_path, "time_s", time)
    read = read_runs(path)
    assert isinstance(read, list)
    assert [run.command.size for run in read] == [3000, 1950, 1000]
    np.testing.assert_allclose(read[1].position, Y[4050:], atol=1e-8)
    assert "row 1001, 4001, 4051: 4 runs, 1 of them left out" in read[0].remarks[0]
    assert "the longest of 3 runs" in read_record(path).remarks[-1]
    only = read_runs(path, from_s=0.0, to_s=0.25)
    assert isinstance(only, list)
    np.testing.assert_allclose(only[0].position, Y[:1000], atol=1e-8)


def test_read_record__samples_not_read__are_filled_in_and_said(tmp_path: Path) -> None:
    y = Y.copy()
    y[[0, 1, 500, 501, 3000, COUNT - 1]] = np.nan
    read = read_record(written(tmp_path, "time_s", TIME, y=y))
    assert read.from_s == pytest.approx(2.0 / RATE_HZ)
    np.testing.assert_allclose(read.position, Y[2:-1], atol=1e-5)
    assert "3 rows at the ends" in read.remarks[0]
    assert "3 samples of position_v were not read, the first in row 501" in read.remarks[1]


def test_read_runs__outside_the_part_asked_for__is_not_judged(tmp_path: Path) -> None:
    time, y = TIME.copy(), Y.copy()
    time[:400:3], y[5000:] = np.nan, np.nan
    path = written(tmp_path, "time_s", time, y=y)
    with pytest.raises(BadInput, match="not a number"):
        read_record(path)
    (read,) = read_runs(path, from_s=0.2, to_s=1.2)
    np.testing.assert_allclose(read.position, Y[800:4800], atol=1e-8)
    assert read.from_s == pytest.approx(0.2)
    assert not read.remarks
