"""From a file to a reference: level, limits, files, refusals."""

import json

import numpy as np
import pytest
import soundfile

from tactuator.errors import BadInput
from tactuator.io.reference import content_sha256, open_reference
from tactuator.speech.band_codings import DirectCoding
from tactuator.speech.coding import coding_of
from tactuator.speech.reading import sample_path
from tactuator.speech.render import LevelMeter, RenderJob, render_file, rendering
from tests.speech.rendered import render_array


def level(reference):
    meter = LevelMeter(4000.0)
    meter.push(reference)
    return meter.level_db()


@pytest.mark.parametrize("name", ["direct", "bands", "envelope", "yuan-2005", "bratakos-2001"])
@pytest.mark.parametrize("asked", [20.0, 35.0])
def test_render__any_coding__utterance_at_the_level_asked(controller, name, asked):
    reference, speech, limiting = render_array(sample_path(), controller, coding_of(name), asked)
    assert len(reference) == int(np.ceil(speech.frames / 4))
    assert level(reference) == pytest.approx(asked, abs=0.1)
    assert all(entry.max_reduction_db == 0.0 for entry in limiting)


def test_render__loud__limited_and_said(controller):
    reference, _, limiting = render_array(sample_path(), controller, None, 55.0)
    assert np.abs(reference).max() <= 10 ** (55 / 20)
    for entry in limiting:
        assert entry.max_reduction_db > 0.0
        assert entry.max_slope_db_per_ms <= 0.5
        assert 0.0 < entry.reduced_s < 3.0
        assert sum(entry.reasons.values()) > 0.0


def test_render__begin_and_end__ramped(controller, write_sound):
    tone = np.sin(2 * np.pi * 150 * np.arange(16000) / 16000 + 1.0)
    reference, _, _ = render_array(write_sound(tone), controller)
    assert np.abs(reference[[0, -1]]).max() < 0.02 * np.abs(reference).max()


def test_render__sampling_rate_of_the_file__does_not_matter(controller, write_sound):
    rates = (8000, 11025, 16000, 44100, 48000, 192000)
    results = []
    for rate in rates:
        time = np.arange(rate) / rate
        wave = np.sin(2 * np.pi * 150 * time) * np.hanning(rate) + 0.3 * np.sin(2 * np.pi * 230 * time)
        results.append(render_array(write_sound(0.5 * wave, rate, f"{rate}.wav", "FLOAT"), controller)[0])
    for result in results[1:]:
        np.testing.assert_allclose(result, results[0], atol=2e-3 * np.abs(results[0]).max())


@pytest.mark.parametrize(
    ("wave", "words"),
    [
        (0.5 * np.sin(2 * np.pi * 2000 * np.arange(16000) / 16000), "coding 'direct' leaves"),
        (np.zeros(16000), "silent"),
    ],
)
def test_render__nothing_to_feel__refused(controller, write_sound, wave, words):
    path = write_sound(wave * np.hanning(16000), subtype="DOUBLE")
    with pytest.raises(BadInput, match=words):
        render_array(path, controller)


@pytest.mark.parametrize("asked", [55.1, -60.1, np.nan, np.inf])
def test_render__level_beyond_what_may_be_asked__refused(controller, asked):
    with pytest.raises(BadInput, match="allowed: -60 to 55 dB SL"):
        render_array(sample_path(), controller, None, asked)


def test_render__finger_that_is_not_there__refused(controller):
    with pytest.raises(BadInput, match="ring"), rendering(sample_path(), controller, DirectCoding(fingers=("ring",))):
        pass


def test_render_file__wav_hdf5_and_felt__agree(controller, tmp_path):
    job = RenderJob(controller, DirectCoding(), seed=3)
    first = render_file(sample_path(), tmp_path / "a.wav", job, tmp_path / "felt.wav")
    second = render_file(sample_path(), tmp_path / "a.h5", job)
    assert first.sha256 == second.sha256 == content_sha256(tmp_path / "a.wav") == content_sha256(tmp_path / "a.h5")
    assert second.felt is None
    assert first.felt is not None
    asked, felt = (open_reference(tmp_path / name) for name in ("a.wav", "felt.wav"))
    assert asked.head.provenance["coding"]["kind"] == "direct"
    assert asked.head.provenance["speech"] == "sample.wav"
    assert asked.head.curves["index"][0] == "bolanowski-1988"
    pair = [np.concatenate(list(file.blocks()))[: asked.frames, 1] for file in (asked, felt)]
    assert np.corrcoef(pair)[0, 1] > 0.99
    document = first.document()
    assert set(document["felt"]) == set(document["peak_db_sl"]) == {"index", "thumb", "middle"}
    json.dumps(document, allow_nan=True)


def test_render_file__same_seed__same_felt(controller, tmp_path):
    job = RenderJob(controller, DirectCoding(), simulate=True, seed=3)
    first, second = (json.dumps(render_file(sample_path(), tmp_path / "a.wav", job).document()) for _ in range(2))
    assert first == second


@pytest.mark.parametrize(
    ("name", "felt", "words"),
    [("a.mp3", None, "ending"), ("a.wav", "a.wav", "two files"), ("no/a.wav", None, "folder|No such file")],
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
    at_once, _, _ = render_array(path, controller)
    got = np.concatenate(list(open_reference(tmp_path / "a.wav").blocks()))
    np.testing.assert_allclose(got, at_once, rtol=1e-6)
    assert rendered.frames == len(at_once) > 30 * 4000
