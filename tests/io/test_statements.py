"""What a file states of its numbers beside them: units, rates, scales; contradictions, and units that are not there."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io

from tactuator.errors import BadInput
from tactuator.io.column_name import column_name
from tactuator.io.csv_tables import read_curve
from tactuator.io.record import read_record
from tactuator.io.response_table import read_response
from tactuator.model.plausibility import curve_doubts

RATE_HZ = 2000.0
RNG = np.random.default_rng(11)
U, Y = RNG.standard_normal(800), RNG.standard_normal(800)
TIME = np.arange(800) / RATE_HZ
HERTZ = np.array([1.0, 3.0, 10.0, 30.0, 60.0, 100.0, 150.0, 250.0, 300.0])
LEVEL = np.array([55.0, 47.0, 36.0, 20.0, 2.0, -8.0, -14.0, -17.0, -15.0])


def hdf5(path: Path, of: str, **attributes: Any) -> Path:
    """Write a record in HDF5, with attributes of one of its data sets, or of the file ("/")."""
    with h5py.File(path, "w") as file:
        file["command"], file["position"] = U, np.where(np.arange(800) == 20, -9999.0, Y)
        file.attrs["rate_hz"] = RATE_HZ
        for key, value in attributes.items():
            file[of].attrs[key] = value
    return path


def text(path: Path, names: str, *given: np.ndarray) -> Path:
    np.savetxt(path, np.stack(given, axis=1), delimiter=",", header=names, comments="", fmt="%.9g", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("said", "unit"),
    [({"units": "um"}, "um"), ({"Unit": "mm"}, "mm"), ({"UNITS": "millimeters"}, "mm"),
     ({"unit": "\u00b5m", "units": "um"}, "um"), ({"scale_factor": 1.0, "add_offset": 0.0, "gain_db": 0.0}, ""),
     ({"calibration_date": "2024-05-01", "calibration": "2024-05-01", "long_name": "gap 2"}, "")],
)  # fmt: skip
def test_attributes__unit_or_nothing_to_apply__are_read(tmp_path: Path, said: dict[str, Any], unit: str) -> None:
    read = read_record(hdf5(tmp_path / "r.h5", "position", **said))
    assert (read.position_unit, read.remarks) == (unit, ())


@pytest.mark.parametrize(
    "said",
    [{"scale_factor": 0.5}, {"add_offset": 0.1}, {"gain": 10.0}, {"Sensitivity": "0.2 V/mm"}, {"calibration": [0, 2]},
     {"counts_per_volt": 3276.8}, {"_Unsigned": "true"}, {"unit": "V", "units": "mV"}],
)  # fmt: skip
def test_attributes__that_change_the_values__are_refused_by_name(tmp_path: Path, said: dict[str, Any]) -> None:
    with pytest.raises(BadInput, match=next(iter(said))):
        read_record(hdf5(tmp_path / "r.h5", "position", **said))


def test_fill_value__among_the_samples__is_no_number(tmp_path: Path) -> None:
    read = read_record(hdf5(tmp_path / "r.h5", "position", _FillValue=-9999.0))
    assert np.abs(read.position).max() < 10.0
    assert read.remarks == ("1 sample of position was not read, in row 21: filled in",)
    assert read_record(hdf5(tmp_path / "r.h5", "position", missing_value=float("nan"))).remarks == ()


def test_gain__of_the_file_or_its_head__is_not_applied_and_said(tmp_path: Path) -> None:
    assert read_record(hdf5(tmp_path / "r.h5", "/", gain=10.0)).remarks == ("not applied: gain 10.0",)
    table = text(tmp_path / "r.csv", "# scale: 0.5\n# Vertical Scale: 0.1\ntime_s,command_v,position_v", TIME, U, Y)
    assert read_record(table).remarks == ("not applied: scale 0.5",)


@pytest.mark.parametrize(
    ("variables", "words"),
    [({"fs": RATE_HZ, "dt": 1e-3}, "fs says 2000 Hz, dt says 1000 Hz"),
     ({"Ts": 1e-3, "sampling_frequency": RATE_HZ}, "Ts says 1000 Hz, sampling_frequency says 2000 Hz"),
     ({"t": 2.0 * TIME, "fs": RATE_HZ}, "fs says 2000 Hz, the time column says 1000 Hz"),
     ({"fs": RATE_HZ, "y_scale": 0.5}, "'y' has y_scale 0.5")],
)  # fmt: skip
def test_matlab__variables_that_contradict__are_refused_with_both(tmp_path: Path, variables: Any, words: str) -> None:
    scipy.io.savemat(tmp_path / "r.mat", {"u": U, "y": Y, **variables})
    with pytest.raises(BadInput, match=words):
        read_record(tmp_path / "r.mat")


def test_matlab__rates_that_agree_and_units__are_read(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "r.mat", {"u": U, "y": Y, "fs": RATE_HZ, "dt": 5e-4, "t": TIME, "y_unit": "um"})
    read = read_record(tmp_path / "r.mat")
    assert read.rate_hz == pytest.approx(RATE_HZ)
    assert (read.position_unit, read.remarks) == ("um", ())


def test_matlab_7_3__unit_as_text__is_read(tmp_path: Path) -> None:
    path = hdf5(tmp_path / "r.h5", "position")
    with h5py.File(path, "a") as file:
        file["position_unit"] = np.array([[ord("u")], [ord("m")]], dtype=np.uint16)
        file["position_unit"].attrs["MATLAB_class"] = np.bytes_("char")
    assert (read_record(path).position_unit, read_record(path).remarks) == ("um", ())


def test_response__scaled_by_an_attribute__is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "f.h5", "w") as file:
        for name, values in {"frequency_hz": HERTZ, "magnitude": np.ones(9), "phase_deg": -HERTZ}.items():
            file[name] = values
        file["magnitude"].attrs["scale_factor"] = 0.5
    with pytest.raises(BadInput, match=r"'magnitude' has scale_factor 0\.5"):
        read_response(tmp_path / "f.h5")


@pytest.mark.parametrize("of", ["/", "command"])
@pytest.mark.parametrize("said", [{"fs": 1000.0}, {"dt": 1e-3}, {"sample_rate": "1 kHz"}])
def test_hdf5__rates_that_contradict__are_refused(tmp_path: Path, of: str, said: dict[str, Any]) -> None:
    with pytest.raises(BadInput, match=r"rate_hz says 2000 Hz|says 1000 Hz"):
        read_record(hdf5(tmp_path / "r.h5", of, **said))


@pytest.mark.parametrize(
    ("head", "words"),
    [("# sampling rate: 1000 Hz\ntime_s,u,y", r"sampling rate \(Hz\) says 1000 Hz, the time column says 2000 Hz"),
     ("# dt: 0.001 s\n# fs: 2000 Hz\ntime,u,y", ""), ("# baud rate: 115200\ntime,u,y", ""),
     ("# fs = 2 kHz\ntime,u,y", ""), ("time_s,u,y,y", "two columns are named 'y' and differ")],
)  # fmt: skip
def test_head__rate_beside_time_stamps__must_agree(tmp_path: Path, head: str, words: str) -> None:
    path = text(tmp_path / "r.csv", head, TIME, U, Y, *([2.0 * Y] if head.endswith("y,y") else []))
    if not words:
        assert read_record(path).rate_hz == pytest.approx(RATE_HZ)
        assert read_record(path).remarks == ()
        return
    with pytest.raises(BadInput, match=words):
        read_record(path)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("pos [um] filtered", "um"), ("pos mm raw", "mm"), ("y (mm) (raw)", "mm"), ("x1_mm", "mm"), ("mm x100", None),
     ("displacement (mm) x100", None), ("pos x100 mm", None), ("pos [mm] / 10", None), ("laser 2 mm out", None),
     ("pos 1e-3 mm", None)],
)  # fmt: skip
def test_name__unit_amid_it__is_read_and_beside_a_factor_said(tmp_path: Path, name: str, unit: str | None) -> None:
    read = read_record(text(tmp_path / "r.csv", f"time_s,command_v,{name}", TIME, U, Y), output=name)
    remarks = () if unit else (f"{name!r} has no unit that is known",)
    assert (read.position_unit, read.remarks) == (unit or "", remarks)


def test_name__two_units_in_brackets__is_refused() -> None:
    with pytest.raises(BadInput, match=r"'stage \(um\) \[mm\]' has two units; expected one of them, as NAME=UNIT"):
        column_name("stage (um) [mm]")
    assert column_name("stage (mm) [mm]").unit.text == "mm"


def test_name__velocity_in_milliseconds__is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="'vel_ms' says velocity by its name and time by its unit"):
        read_record(text(tmp_path / "r.csv", "time_s,command_v,vel_ms", TIME, U, Y))


@pytest.mark.parametrize(
    ("names", "step_s", "words"),
    [("time", 1.0 / 48.0, "'time' has no unit: read as a rate of 48 Hz"), ("time", 5e-4, ""), ("time_s", 0.01, ""),
     ("time_ms_since_start", 1.0 / 48.0, "")],
)  # fmt: skip
def test_time__without_a_unit_at_a_low_rate__is_said(tmp_path: Path, names: str, step_s: float, words: str) -> None:
    read = read_record(text(tmp_path / "r.csv", f"{names},command_v,position_v", step_s * np.arange(800), U, Y))
    assert read.remarks == ((words,) if words else ())


def test_fs__without_a_unit_at_a_low_rate__is_said(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "r.mat", {"u": U, "y": Y, "fs": 48.0})
    assert read_record(tmp_path / "r.mat").remarks == ("'fs' has no unit: read as a rate of 48 Hz",)
    stamps = [f"2024-05-01T12:00:{k / 48.0:09.6f}" for k in range(800)]
    table = tmp_path / "r.csv"
    rows = (f"{stamp},{u},{y}\n" for stamp, u, y in zip(stamps, U, Y, strict=True))
    table.write_text("time,command_v,position_v\n" + "".join(rows))
    assert read_record(table).remarks == ()


def curve_file(path: Path, names: str, *given: np.ndarray) -> Path:
    return text(path, f"frequency_hz,{names}", HERTZ, *given)


ACCELERATION = 10.0 ** (LEVEL / 20.0) * 1e-6 * (2.0 * np.pi * HERTZ) ** 2 / np.sqrt(2.0)


@pytest.mark.parametrize(
    ("names", "columns", "words"),
    [("level_db_re_1um,level_db_re_1um", (LEVEL + 10.0, LEVEL), "in column 2 says 65.*in column 3 says 55"),
     ("level_db_re_1um,acceleration_m_s2_rms", (LEVEL + 6.0, ACCELERATION), "level_db_re_1um says 61.*rms says 55"),
     ("level_db_re_1um,level_db_re_1um", (LEVEL, LEVEL), ""),
     ("level_db_re_1um,acceleration_m_s2_rms", (LEVEL, ACCELERATION), "")],
)  # fmt: skip
def test_curve__columns_of_one_thing__must_agree(tmp_path: Path, names: str, columns: Any, words: str) -> None:
    path = curve_file(tmp_path / "c.csv", names, *columns)
    if not words:
        np.testing.assert_allclose(read_curve(path).level_db_re_1um, LEVEL, atol=1e-6)
        return
    with pytest.raises(BadInput, match=words):
        read_curve(path)


@pytest.mark.parametrize("per_um", [1.0, 1e-3, 1e-6])
def test_curve__linear_under_a_name_in_db__is_doubted(tmp_path: Path, per_um: float) -> None:
    for level, is_doubted in ((per_um * 10.0 ** (LEVEL / 20.0), True), (LEVEL, False)):
        read = read_curve(curve_file(tmp_path / "c.csv", "level_db_re_1um", level))
        assert bool(list(curve_doubts(read))) == is_doubted
