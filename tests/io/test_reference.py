"""References written and read again, and what is refused."""

import json

import h5py
import numpy as np
import pytest
import soundfile

from tactuator.errors import BadInput
from tactuator.io.reference import LARGEST_WAV_BYTES, ReferenceHead, content_sha256, open_reference, write_reference

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


def test_wav__its_samples__are_float32_shares_of_60_db_sl_and_say_so(tmp_path):
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


def test_wav__json_lost__scale_comes_from_the_comment(tmp_path):
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


def test_write_reference__more_than_a_wav_holds_or_a_fractional_rate__refused(tmp_path):
    with pytest.raises(BadInput, match="4 GB"), write_reference(tmp_path / "r.wav", HEAD) as writer:
        writer.frames = LARGEST_WAV_BYTES // 8
        writer.write(np.zeros((5, 2)))
    with pytest.raises(BadInput, match="whole number"), write_reference(tmp_path / "r.wav", ReferenceHead(1.5, ("a",))):
        pass


def test_write_reference__another_file_where_its_head_goes__refused_and_left(tmp_path):
    (tmp_path / "r.json").write_text('{"format": "tactuator-controller/8"}')
    with pytest.raises(BadInput, match="not the head of a reference"), write_reference(tmp_path / "r.wav", HEAD):
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
        ("none.wav", None, "no such file"),
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


def test_write_reference__length_known__written_as_ever_where_there_is_room_and_else_refused_first(tmp_path):
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
