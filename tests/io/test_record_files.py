"""Records of every kind and references, read back; and everything that a file can have wrong."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import soundfile

from tactuator.errors import BadInput
from tactuator.io import columns, text_table
from tactuator.io.record import read_record, write_record
from tactuator.io.reference import LARGEST_WAV_BYTES, ReferenceHead, content_sha256, open_reference, write_reference
from tactuator.signals.record import Record

RATE_HZ = 4000.0
RNG = np.random.default_rng(0)
U, Y = RNG.standard_normal(2000), RNG.standard_normal(2000)
TIME = np.arange(2000) / RATE_HZ


def write_csv(path: Path, header: str | None, *given: np.ndarray, delimiter: str = ",", digits: str = "%.9g") -> Path:
    np.savetxt(path, np.stack(given, axis=1), delimiter=delimiter, header=header or "", comments="", fmt=digits)
    if header is None:
        path.write_text(path.read_text().lstrip("\n"))
    return path


def test_hdf5_and_matlab__our_own_variables_and_struct__come_back(tmp_path: Path) -> None:
    written = Record(RATE_HZ, U, Y, "V", "V", reference=U * 2.0, about={"rig": "simulated", "channel": "index"})
    write_record(tmp_path / "r.h5", written)
    read = read_record(tmp_path / "r.h5")
    np.testing.assert_array_equal(read.command, U)
    np.testing.assert_array_equal(read.position, Y)
    assert (read.rate_hz, read.command_unit, read.about["channel"]) == (RATE_HZ, "V", "index")
    with h5py.File(tmp_path / "r.h5") as file:
        assert file["position"].attrs["unit"] == "V"
    scipy.io.savemat(tmp_path / "a.mat", {"u": U, "y": Y[:, None], "fs": RATE_HZ})
    scipy.io.savemat(tmp_path / "b.mat", {"run": {"vir": U, "qm": Y, "t": TIME}})
    for name in ("a.mat", "b.mat"):
        read = read_record(tmp_path / name)
        np.testing.assert_array_equal(read.command, U)
        np.testing.assert_array_equal(read.position, Y)
        assert read.rate_hz == pytest.approx(RATE_HZ)


@pytest.mark.parametrize(
    ("header", "given", "delimiter", "options", "units"),
    [
        ("time_s,command_v,position_v", (TIME, U, Y), ",", {}, ("V", "V")),
        ("t;u;y", (TIME, U, Y), ";", {}, ("", "")),
        ("time\tin\tout", (TIME, U, Y), "\t", {}, ("", "")),
        ("noise,torque_nm,angle_rad,clock_ms", (Y, U, Y, 1e3 * TIME), ",",
         {"input": "torque_nm", "output": "angle_rad", "time": "clock_ms"}, ("Nm", "rad")),
        (None, (U, Y), " ", {"rate_hz": RATE_HZ}, ("", "")),
        ("time_ms,u [V],pos [mm]", (1e3 * TIME, U, Y), ",", {}, ("V", "mm")),
        ("T [\u00b5s],u (mV),x ( \u03bcm )", (1e6 * TIME, U, Y), ",", {"time": "T [\u00b5s]"}, ("mV", "um")),
        ("t;torque [Nm];x_\u00b5m", (TIME, U, Y), ";", {}, ("Nm", "um")),
    ],
    ids=["long", "letters", "words", "of one's own", "none", "brackets", "parentheses", "newton metres"],
)  # fmt: skip
def test_csv__names_usual_told_or_none__are_found(tmp_path: Path, header, given, delimiter, options, units) -> None:
    read = read_record(write_csv(tmp_path / "r.csv", header, *given, delimiter=delimiter), **options)
    assert (read.command_unit, read.position_unit) == units
    np.testing.assert_allclose((read.command, read.position), (U, Y), rtol=1e-8)
    assert read.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    by_order = "'column1' is read as the command, 'column2' as the position (`input`, `output`)"
    in_unit = f"is read in {units[0]}, where a display commands volts"
    assert [remark for remark in read.remarks if remark != by_order and not remark.endswith(in_unit)] == []
    assert (by_order in read.remarks) == (header is None)
    assert len(read.remarks) == (header is None) + (units[0] not in ("", "V", "mV"))


def test_csv__decimal_commas__are_numbers(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "r.csv", "t;u;y", TIME, U, Y, delimiter=";")
    path.write_bytes(path.read_text().replace(".", ",").replace("y", "Länge").encode("cp1252"))
    np.testing.assert_allclose(read_record(path, output="Länge").position, Y, rtol=1e-8)


@pytest.mark.parametrize("stamps", [np.round(TIME, 4), [float(f"{time:.6g}") for time in 10.0 + TIME]])
def test_csv__stamps_of_few_digits__are_an_even_rate(tmp_path: Path, stamps: list[float]) -> None:
    read = read_record(write_csv(tmp_path / "r.csv", "t,u,y", stamps, U, Y))
    assert read.rate_hz == pytest.approx(RATE_HZ, rel=1e-3)
    assert read.remarks == ()
    np.testing.assert_allclose(read.command, U, rtol=1e-8)


def test_wav__two_channels__first_is_the_command_and_one_is_too_few(tmp_path: Path) -> None:
    data = np.stack([U, Y], axis=1) / 8.0
    soundfile.write(tmp_path / "r.wav", data, 48000, subtype="DOUBLE")
    read = read_record(tmp_path / "r.wav")
    np.testing.assert_allclose(read.command, data[:, 0])
    assert read.rate_hz == 48000.0
    soundfile.write(tmp_path / "mono.wav", U / 8.0, 8000)
    with pytest.raises(BadInput, match="one channel"):
        read_record(tmp_path / "mono.wav")


def test_csv__dropped_or_uneven_samples__are_filled_or_resampled_and_said(tmp_path: Path) -> None:
    smooth = np.sin(2.0 * np.pi * 5.0 * TIME)
    keep = np.ones(2000, dtype=bool)
    keep[[100, 500, 501, 1500]] = False
    read = read_record(write_csv(tmp_path / "r.csv", "t,u,y", TIME[keep], U[keep], smooth[keep]))
    assert read.position.size == 2000
    np.testing.assert_allclose(read.position, smooth, atol=1e-5)
    assert read.command[501] == pytest.approx(U[499], rel=1e-6)
    assert any("4 samples are missing" in remark for remark in read.remarks)
    uneven = TIME + 0.2 / RATE_HZ * np.random.default_rng(1).uniform(-1.0, 1.0, 2000)
    smooth = np.sin(2.0 * np.pi * 5.0 * uneven)
    read = read_record(write_csv(tmp_path / "r.csv", "t,u,y", uneven, U, smooth, digits="%.12g"))
    assert any("resampled" in remark for remark in read.remarks)
    offset = uneven[0]
    expected = np.sin(2.0 * np.pi * 5.0 * (offset + np.arange(read.position.size) / read.rate_hz))
    assert np.max(np.abs(read.position - expected)[5:-5]) < 2e-3


@pytest.mark.parametrize(("noise", "off"), [(0.0, 0.3), (1e-3, 0.05)])
@pytest.mark.parametrize("is_read_when_stamped", [True, False])
def test_csv__uneven_stamps__are_believed_where_the_position_follows_them(tmp_path, is_read_when_stamped, off, noise):
    rng = np.random.default_rng(2)
    uneven = TIME + off / RATE_HZ * rng.uniform(-1.0, 1.0, 2000)
    uneven[[0, -1]] = TIME[[0, -1]]
    at = uneven if is_read_when_stamped else TIME
    y = np.sin(2.0 * np.pi * 40.0 * at) + np.sin(2.0 * np.pi * 130.0 * at) + noise * rng.standard_normal(2000)
    read = read_record(write_csv(tmp_path / "r.csv", "t,u,y", uneven, U, y, digits="%.12g"))
    assert any(("taken as even" in remark) != is_read_when_stamped for remark in read.remarks)
    assert np.allclose(read.position, y, atol=1e-9) != is_read_when_stamped


def test_csv__longer_than_memory_allows__is_read_in_part_and_said(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(columns, "MOST_SAMPLES", 1000)
    monkeypatch.setattr(text_table, "_PIECE_CHARACTERS", 9000)
    read = read_record(write_csv(tmp_path / "r.csv", "t,u,y", TIME, U, Y))
    assert read.command.size == 1000
    assert any("only the first 1000 samples" in remark for remark in read.remarks)


def _nan(y: np.ndarray) -> np.ndarray:
    spoilt = y.copy()
    spoilt[41] = np.nan
    return spoilt


@pytest.mark.parametrize(
    ("header", "given", "options", "match"),
    [
        ("t,u,y", (TIME, U, np.where(np.arange(2000) % 40 == 1, np.nan, Y)), {}, "y is not a number in row 2 of"),
        ("t,u,y", (TIME, np.where(abs(TIME - 0.2) < 0.003, np.nan, U), Y), {}, "23 in a row"),
        ("t,u,y", (TIME, U, Y), {"rate_hz": 3000.0}, "the time column says 4000"),
        ("t,u,y", (TIME, U, Y), {"rate_hz": -1.0}, "positive"),
        ("t,u,y", (TIME, U, Y), {"input": "force"}, "no input column 'force'; expected t, u, y"),
        ("t,u,y", (TIME, U, Y), {"output": "u"}, "both 'u'"),
        ("t,u,y", (TIME, U, Y), {"output": "t"}, "'t' is the position and the time; expected another"),
        ("a,b,c", (U, U, Y), {"rate_hz": 1.0}, r"which column is which.*position \(`output`\) \(and `time`\), each"),
        ("u,y", (U, Y), {}, "no rate"),
        ("t,u,y", (TIME[::-1], U, Y), {}, "ascend"),
        ("t,u,y", (np.where(np.arange(2000) > 900, TIME + 0.5, TIME), U, Y), {}, "are missing"),
        ("t,u,y", (_nan(TIME), U, Y), {}, "stamp in row 42"),
        ("t,u,y", (TIME, 1e200 * U, Y), {}, r"the largest u is \S+e\+200; expected 1e-100 to 1e\+100"),
        ("t,u,y", (TIME, U, 1e-200 * Y), {}, r"the largest y is \S+e-20\d; expected 1e-100"),
    ],
)
def test_csv__amiss__is_refused_in_one_line(tmp_path: Path, header, given, options, match: str) -> None:
    path = write_csv(tmp_path / "r.csv", header, *given)
    with pytest.raises(BadInput, match=match) as caught:
        read_record(path, **options)
    assert "\n" not in str(caught.value)


HEAD = ReferenceHead(
    4000.0, ("index", "thumb"), {"index": ("a-curve", "00"), "thumb": ("a-curve", "00")}, (0.4, 300.0),
    provenance={"speech": "x.wav", "level_db_sl": 35.0},
)  # fmt: skip


def signal(count=5000):
    return (300.0 * np.random.default_rng(0).standard_normal((count, 2))).astype(np.float32).astype(np.float64)


def written(path, samples, head=HEAD):
    with write_reference(path, head) as writer:
        for block in np.array_split(samples, 3):
            writer.write(block)
    return path


def test_reference__written_and_read__same_samples_head_and_checksum_in_each_format(tmp_path):
    paths = [written(tmp_path / name, signal()) for name in ("r.wav", "r.h5", "r.hdf5")]
    for reference in map(open_reference, paths):
        assert reference.head == HEAD
        assert (reference.frames, reference.duration_s) == (5000, pytest.approx(1.25))
        np.testing.assert_allclose(np.concatenate(list(reference.blocks(999))), signal(), rtol=1e-6)
    assert len(set(map(content_sha256, paths))) == 1
    with h5py.File(paths[1]) as file:
        assert "threshold units" in file["reference"].attrs["units"]
        assert file.attrs["rate_hz"] == 4000.0


def test_wav__its_samples__are_float32_shares_of_60_db_sl(tmp_path):
    path = written(tmp_path / "r.wav", signal())
    samples, rate = soundfile.read(path)
    info = soundfile.info(path)
    np.testing.assert_allclose(samples * 1000.0, signal(), rtol=1e-6)
    assert (rate, info.subtype, info.channels) == (4000, "FLOAT", 2)
    with soundfile.SoundFile(path) as file:
        assert "1.0 = 60 dB SL" in file.comment
    document = json.loads((tmp_path / "r.json").read_text())
    curve = {"name": "a-curve", "hash": "00"}
    expected = {"full_scale_db_sl": 60.0, "curve": curve, "channels": ["index", "thumb"], "rate_hz": 4000.0}
    assert document == document | expected | {"band_hz": [0.4, 300.0]}
    path = written(tmp_path / "r.wav", signal(), ReferenceHead(4000.0, ("a", "b"), full_scale_db_sl=54.5))
    (tmp_path / "r.json").unlink()
    reference = open_reference(path)
    assert reference.head.full_scale_db_sl == 54.5
    assert reference.head.channels == ("a", "b")
    np.testing.assert_allclose(np.concatenate(list(reference.blocks())), signal(), rtol=1e-6)


@pytest.mark.parametrize("name", ["r.wav", "r.h5"])
def test_write_reference__fails_half_way__nothing_is_left(tmp_path, name):
    with pytest.raises(BadInput, match="not finite"), write_reference(tmp_path / name, HEAD) as writer:
        writer.write(signal())
        writer.write(np.full((10, 2), np.nan))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "block", "words"),
    [
        ("r.mp3", np.zeros((5, 2)), "ending"),
        ("r.wav", np.zeros((5, 3)), r"shape \(5, 3\)"),
        ("none/r.wav", np.zeros((5, 2)), "not a folder"),
    ],
)
def test_write_reference__impossible__refused(tmp_path, name, block, words):
    with pytest.raises(BadInput, match=words), write_reference(tmp_path / name, HEAD) as writer:
        writer.write(block)


def test_write_reference__of_too_much_or_over_another_file__refused_and_left(tmp_path):
    with pytest.raises(BadInput, match="4 GB"), write_reference(tmp_path / "r.wav", HEAD) as writer:
        writer.frames = LARGEST_WAV_BYTES // 8
        writer.write(np.zeros((5, 2)))
    with pytest.raises(BadInput, match="whole number"), write_reference(tmp_path / "r.wav", ReferenceHead(1.5, ("a",))):
        pass
    (tmp_path / "r.json").write_text('{"format": "tactuator-controller/8"}')
    with pytest.raises(BadInput, match=r"r\.json is a controller already"), write_reference(tmp_path / "r.wav", HEAD):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]
    assert "controller" in (tmp_path / "r.json").read_text()


def write_plain(path, samples, **more):
    soundfile.write(path, samples, 4000, **more)


def write_other(path, samples, **more):
    write_plain(written(path, signal()), samples, **more)


NAN = np.zeros((10, 2))
NAN[3, 1] = np.nan


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("none.wav", None, "file not found"),
        ("none.txt", None, "ending"),
        ("text.wav", lambda path: path.write_text("words"), "cannot be read"),
        ("plain.wav", lambda path: write_plain(path, np.zeros((10, 2))), "no scale in its INFO comment"),
        ("other.wav", lambda path: write_other(path, np.zeros((10, 3))), "3 channels"),
        ("odd.h5", lambda path: path.write_bytes(b"no"), "cannot be read"),
        ("empty.h5", lambda path: h5py.File(path, "w").close(), "cannot be read"),
        ("nan.wav", lambda path: write_other(path, NAN, subtype="FLOAT"), "finite"),
    ],
)
def test_open_reference__not_one__refused_in_one_line(tmp_path, name, write, words):
    if write is not None:
        write(tmp_path / name)
    with pytest.raises(BadInput, match=words) as refusal:
        list(open_reference(tmp_path / name).blocks())
    assert "\n" not in str(refusal.value)


def test_write_reference__length_known__written_or_refused_first(tmp_path):
    for name in ("r.wav", "r.h5"):
        with write_reference(tmp_path / name, HEAD, 5000) as writer:
            writer.write(signal())
        assert open_reference(tmp_path / name).frames == 5000
    assert (tmp_path / "r.wav").stat().st_size < 42_000
    with (
        pytest.raises(BadInput, match="cannot be written"),
        write_reference(tmp_path / "n.h5", HEAD, 1 << 57) as writer,
    ):
        writer.write(signal())
    assert not (tmp_path / "n.h5").exists()
