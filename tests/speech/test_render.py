"""From a file to a reference: level, limits, files, refusals."""

import json

import numpy as np
import pytest
import soundfile

from tactuator.errors import BadInput
from tactuator.io.reference import content_sha256, open_reference
from tactuator.speech.active_level import active_level
from tactuator.speech.band_codings import DirectCoding
from tactuator.speech.coding import coding_of
from tactuator.speech.reading import sample_path
from tactuator.speech.render import RenderJob, render_file
from tests.speech.rendered import render_array


def level_of(*blocks):
    return active_level(lambda: iter(blocks), 4000.0).level_db


def tone(amplitude):
    return amplitude * np.sin(2 * np.pi * 200.0 * np.arange(4000) / 4000)[:, None]


@pytest.mark.parametrize("name", ["direct", "bands", "envelope", "yuan-2005", "bratakos-2001"])
def test_render__any_coding__utterance_at_the_level_asked(controller, name):
    reference, limiting = render_array(sample_path(), controller, coding_of(name), 20.0)
    assert len(reference) == int(np.ceil(soundfile.info(sample_path()).frames / 4))
    assert level_of(reference) == pytest.approx(20.0, abs=0.1)
    assert all(entry.max_reduction_db == 0.0 for entry in limiting)


def test_render__loud__limited_and_said(controller):
    reference, limiting = render_array(sample_path(), controller, None, 55.0)
    assert np.abs(reference).max() <= 10 ** (55 / 20)
    for entry in limiting:
        assert entry.max_reduction_db > 0.0
        assert entry.max_slope_db_per_ms <= 0.5
        assert 0.0 < entry.reduced_s < 3.0
        assert sum(entry.reasons.values()) > 0.0


def test_render__any_sampling_rate__the_same_and_begin_and_end_are_ramped(controller, write_sound):
    results = []
    for rate in (8000, 11025, 48000, 192000):
        time = np.arange(rate) / rate
        wave = np.sin(2 * np.pi * 150 * time) * np.hanning(rate) + 0.3 * np.cos(2 * np.pi * 230 * time)
        results.append(render_array(write_sound(0.5 * wave, rate, f"{rate}.wav", "FLOAT"), controller)[0])
        largest = np.abs(results[0]).max()
        np.testing.assert_allclose(results[-1][400:-400], results[0][400:-400], atol=2e-3 * largest)
        assert np.abs(results[-1][[0, -1]]).max() < 0.02 * largest


def test_render__nothing_to_feel__refused(controller, write_sound):
    """Tones that begin and end at once were clicks of 23 dB SL."""
    for hertz, window in ((2000, np.hanning(16000)), (440, 1.0), (5000, 0.5)):
        wave = window * np.sin(2 * np.pi * hertz * np.arange(16000) / 16000)
        with pytest.raises(BadInput, match="nothing of this sound lies in the band: coding 'direct' leaves"):
            render_array(write_sound(wave, subtype="DOUBLE"), controller)


def test_render__level_or_finger_that_cannot_be__refused(controller):
    for asked in (55.1, -60.1, np.nan):
        with pytest.raises(BadInput, match="-60 to 55 dB SL"):
            render_array(sample_path(), controller, None, asked)
    with pytest.raises(BadInput, match="ring"):
        render_array(sample_path(), controller, DirectCoding(fingers=("ring",)))


def test_render_file__wav_hdf5_and_felt__agree(controller, tmp_path):
    job = RenderJob(controller, DirectCoding(), simulate=True, seed=3)
    first = render_file(sample_path(), tmp_path / "a.wav", job, tmp_path / "felt.wav")
    second = render_file(sample_path(), tmp_path / "a.h5", job)
    assert first.sha256 == second.sha256 == content_sha256(tmp_path / "a.wav") == content_sha256(tmp_path / "a.h5")
    assert json.dumps(first.document()["felt"]) == json.dumps(second.document()["felt"])  # of the same seed
    assert render_file(sample_path(), tmp_path / "a.h5", RenderJob(controller, DirectCoding())).felt is None
    asked, felt = (open_reference(tmp_path / name) for name in ("a.wav", "felt.wav"))
    assert asked.head.provenance["coding"]["kind"] == "direct"
    assert asked.head.provenance["source"] == "sample.wav"
    assert asked.head.curves["index"][0] == "bolanowski-1988"
    pair = [np.concatenate(list(file.blocks()))[: asked.frames, 1] for file in (asked, felt)]
    assert np.corrcoef(pair)[0, 1] > 0.99
    document = first.document()
    assert set(document["felt"]) == set(document["peak_db_sl"]) == {"index", "thumb", "middle"}
    json.dumps(document, allow_nan=True)


@pytest.mark.parametrize(
    ("name", "felt", "words"),
    [("a.mp3", None, "ending"), ("a.wav", "a.wav", "two files"), ("no/a.wav", None, "folder|file not found")],
)
def test_render_file__impossible_outputs__refused_and_nothing_left(controller, tmp_path, name, felt, words):
    with pytest.raises(BadInput, match=words):
        render_file(sample_path(), tmp_path / name, RenderJob(controller, DirectCoding()), felt and tmp_path / felt)
    assert list(tmp_path.iterdir()) == []


def test_render_file__speech_bad_at_its_end__nothing_left(controller, tmp_path, write_sound):
    wave = np.random.default_rng(0).standard_normal(200_000) * 0.1
    wave[-1] = np.nan
    path = write_sound(wave, subtype="FLOAT")
    with pytest.raises(BadInput, match="finite"):
        render_file(path, tmp_path / "a.wav", RenderJob(controller, DirectCoding()))
    assert [p.name for p in tmp_path.iterdir()] == ["speech.wav"]


def test_render_file__longer_than_a_stretch__streams_to_the_same_samples(controller, tmp_path, write_sound):
    sample, rate = soundfile.read(sample_path())
    path = write_sound(np.tile(sample, 13), rate)
    rendered = render_file(path, tmp_path / "a.wav", RenderJob(controller, DirectCoding()))
    at_once, _ = render_array(path, controller)
    got = np.concatenate(list(open_reference(tmp_path / "a.wav").blocks()))
    np.testing.assert_allclose(got, at_once, rtol=1e-6)
    assert rendered.frames == len(at_once) > 30 * 4000
