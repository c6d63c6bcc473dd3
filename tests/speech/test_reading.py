"""What is read of a speech file, and every refusal; of a file that was cut: tests/io/test_hostile_files."""

import numpy as np
import pytest
import soundfile

from tactuator.errors import BadInput
from tactuator.speech.reading import sample_path, scan_speech, speech_blocks
from tools.formant_synthesis import RATE_HZ, synthesise


def tone(seconds=1.0, rate_hz=16000, frequency_hz=200.0):
    return 0.5 * np.sin(2 * np.pi * frequency_hz * np.arange(round(seconds * rate_hz)) / rate_hz)


def read(path):
    return np.concatenate(list(speech_blocks(scan_speech(path))))


@pytest.mark.parametrize("rate_hz", [8000, 16000, 192000])
def test_scan_speech__mono_at_any_rate__says_what_it_is(write_sound, rate_hz):
    got = scan_speech(write_sound(tone(rate_hz=rate_hz), rate_hz))
    assert (got.rate_hz, got.frames, got.channels, got.duration_s) == (rate_hz, rate_hz, 1, 1.0)
    assert got.peak == pytest.approx(0.5, abs=1e-3)
    assert got.notes == ()


def test_scan_speech__stereo__mixed_down_and_said(write_sound):
    left, right = tone(frequency_hz=200.0), tone(frequency_hz=130.0)
    path = write_sound(np.stack([left, right], axis=1), subtype="FLOAT")
    assert scan_speech(path).notes == ("2 channels mixed down to one (their mean)",)
    np.testing.assert_allclose(read(path), (left + right) / 2, atol=1e-6)


@pytest.mark.parametrize(
    ("subtype", "name", "tolerance"),
    [
        ("PCM_U8", "speech.wav", 1e-2),
        ("PCM_32", "speech.wav", 1e-8),
        ("DOUBLE", "speech.wav", 1e-12),
        ("PCM_24", "speech.flac", 1e-6),
        ("PCM_16", "speech.aiff", 1e-4),
    ],
)
def test_speech_blocks__any_word_length__same_signal(write_sound, subtype, name, tolerance):
    got = read(write_sound(tone(), name=name, subtype=subtype))
    np.testing.assert_allclose(got, tone(), atol=tolerance)


def test_speech_blocks__a_constant_beside_the_signal__taken_out_and_said(write_sound):
    path = write_sound(0.3 + tone(), subtype="FLOAT")
    assert "DC" in scan_speech(path).notes[0]
    np.testing.assert_allclose(read(path), tone(), atol=1e-6)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda w, d: d / "none.wav", "file not found"),
        (lambda w, d: d, "a folder"),
        (lambda w, d: ((d / "empty.wav").write_bytes(b"") and None) or d / "empty.wav", "empty, 0 bytes"),
        (lambda w, d: (d / "t.wav").write_text("words\n") and d / "t.wav", "not readable as sound"),
        (lambda w, d: w(np.zeros(16000)), "silent"),
        (lambda w, d: w(np.full(16000, 0.25), subtype="FLOAT"), r"constant at 0.25 of full scale \(DC\)"),
        (lambda w, d: w(tone(0.01)), "160 frames, 10 ms"),
        (lambda w, d: w(np.zeros(0)), "0 frames"),
        (lambda w, d: w(np.r_[tone(), np.nan, tone()], subtype="FLOAT"), "sample at 1.000 s is not a finite number"),
        (lambda w, d: w(tone(2.0, 500), 500), "sampled at 500 Hz"),
    ],
)
def test_scan_speech__not_usable__refused_in_one_line(write_sound, tmp_path, make, words):
    with pytest.raises(BadInput, match=words) as refusal:
        scan_speech(make(write_sound, tmp_path))
    assert "\n" not in str(refusal.value)


def test_sample__shipped_file__is_what_the_script_makes():
    shipped, rate = soundfile.read(sample_path())
    synthesised = synthesise()
    assert rate == RATE_HZ
    assert 2.0 <= len(synthesised) / rate <= 3.0
    np.testing.assert_allclose(shipped, synthesised, atol=2.0 / 32768)
