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


@pytest.mark.parametrize("name", ["r.wav", "r.h5", "r.hdf5"])
def test_reference__written_and_read__same_samples_and_head(tmp_path, name):
    reference = open_reference(written(tmp_path / name, signal()))
    assert reference.head == HEAD
    assert reference.frames == 5000
    assert reference.duration_s == pytest.approx(1.25)
    np.testing.assert_allclose(np.concatenate(list(reference.blocks(999))), signal(), rtol=1e-6)


def test_reference__wav_and_hdf5__same_checksum(tmp_path):
    digests = {content_sha256(written(tmp_path / name, signal())) for name in ("r.wav", "r.h5")}
    assert len(digests) == 1


def test_wav__its_samples__are_float32_shares_of_60_db_sl_and_say_so(tmp_path):
    path = written(tmp_path / "r.wav", signal())
    samples, rate = soundfile.read(path)
    info = soundfile.info(path)
    np.testing.assert_allclose(samples * 1000.0, signal(), rtol=1e-6)
    assert (rate, info.subtype, info.channels) == (4000, "FLOAT", 2)
    with soundfile.SoundFile(path) as file:
        assert "1.0 = 60 dB SL" in file.comment
    document = json.loads((tmp_path / "r.json").read_text())
    assert document["full_scale_db_sl"] == 60.0
    assert document["curve"] == {"name": "a-curve", "hash": "00"}
    assert document["channels"] == ["index", "thumb"]
    assert document["band_hz"] == [0.4, 300.0]
    assert document["rate_hz"] == 4000.0


def test_wav__json_lost__scale_comes_from_the_comment(tmp_path):
    path = written(tmp_path / "r.wav", signal(), ReferenceHead(4000.0, ("a", "b"), full_scale_db_sl=54.5))
    (tmp_path / "r.json").unlink()
    reference = open_reference(path)
    assert reference.head.full_scale_db_sl == 54.5
    assert reference.head.channels == ("a", "b")
    np.testing.assert_allclose(np.concatenate(list(reference.blocks())), signal(), rtol=1e-6)


def test_hdf5__its_attributes__say_units_and_rate(tmp_path):
    with h5py.File(written(tmp_path / "r.h5", signal())) as file:
        assert "threshold units" in file["reference"].attrs["units"]
        assert file.attrs["rate_hz"] == 4000.0


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


def test_write_reference__more_than_a_wav_holds__refused(tmp_path):
    with pytest.raises(BadInput, match="4 GB"), write_reference(tmp_path / "r.wav", HEAD) as writer:
        writer.frames = LARGEST_WAV_BYTES // 8
        writer.write(np.zeros((5, 2)))


def test_write_reference__another_file_where_its_head_goes__refused_and_left(tmp_path):
    (tmp_path / "r.json").write_text('{"format": "tactuator-controller/8"}')
    with pytest.raises(BadInput, match="not the head of a reference"), write_reference(tmp_path / "r.wav", HEAD):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]
    assert "controller" in (tmp_path / "r.json").read_text()


def test_write_reference__fractional_rate_as_wav__refused(tmp_path):
    with pytest.raises(BadInput, match="whole number"), write_reference(tmp_path / "r.wav", ReferenceHead(1.5, ("a",))):
        pass


def make_bad(folder, name):
    path = folder / name
    if name == "text.wav":
        path.write_text("words")
    elif name == "plain.wav":
        soundfile.write(path, np.zeros((10, 2)), 4000)
    elif name == "other.wav":
        written(path, signal())
        soundfile.write(path, np.zeros((10, 3)), 4000)
    elif name == "odd.h5":
        path.write_bytes(b"no")
    elif name == "empty.h5":
        h5py.File(path, "w").close()
    return path


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.wav", "no such file"),
        ("none.txt", "ending"),
        ("text.wav", "cannot be read"),
        ("plain.wav", "no scale in its INFO comment"),
        ("other.wav", "3 channels"),
        ("odd.h5", "cannot be read"),
        ("empty.h5", "cannot be read"),
    ],
)
def test_open_reference__not_one__refused_in_one_line(tmp_path, name, words):
    with pytest.raises(BadInput, match=words) as refusal:
        open_reference(make_bad(tmp_path, name))
    assert "\n" not in str(refusal.value)


def test_blocks__nan_in_the_file__refused(tmp_path):
    path = written(tmp_path / "r.wav", signal())
    samples = np.zeros((10, 2))
    samples[3, 1] = np.nan
    soundfile.write(path, samples, 4000, subtype="FLOAT")
    with pytest.raises(BadInput, match="finite"):
        list(open_reference(path).blocks())


def test_write_reference__length_known_and_room_for_it__written_as_ever(tmp_path):
    for name in ("r.wav", "r.h5"):
        with write_reference(tmp_path / name, HEAD, 5000) as writer:
            writer.write(signal())
        assert open_reference(tmp_path / name).frames == 5000
    assert (tmp_path / "r.wav").stat().st_size < 42_000


def test_write_reference__more_than_any_disk__refused_before_anything_is_written(tmp_path):
    with (
        pytest.raises(BadInput, match="cannot be written"),
        write_reference(tmp_path / "r.h5", HEAD, 1 << 57) as writer,
    ):
        writer.write(signal())
    assert list(tmp_path.iterdir()) == []
