"""Where live sound comes from: a pipe, a microphone in the place of PortAudio's, and what is refused."""

import io
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile

from tactuator.errors import BadInput, DeviceFault
from tactuator.rig.sound.cards import Card
from tactuator.rig.sound.stream import CardGone
from tactuator.speech.live import source as module
from tactuator.speech.live.source import FileSource, Microphone, PipeSource, open_source

RATE = 16000
TONE = 0.5 * np.sin(2 * np.pi * 200 * np.arange(RATE) / RATE)


def everything(source):
    """All that a source gives, looked at each 4 ms of a clock that waits for its thread."""
    now_s, pieces = 0.0, []
    while not source.ended:
        pieces.append(source.read(now_s))
        now_s += 0.004
        threading.Event().wait(0.001)
    return np.concatenate(pieces)


def wav(samples, subtype):
    content = io.BytesIO()
    soundfile.write(content, samples, RATE, format="WAV", subtype=subtype)
    return io.BytesIO(content.getvalue())


@pytest.mark.parametrize(("subtype", "atol"), [("PCM_16", 1e-4), ("PCM_32", 1e-8), ("FLOAT", 1e-7)])
def test_pipe__wav_of_two_channels__their_mean_at_its_own_pace(subtype, atol):
    source = PipeSource(wav(np.stack([TONE, 0.0 * TONE], axis=1), subtype))
    assert source.rate_hz == RATE
    assert "2 channels" in source.notes[0]
    np.testing.assert_allclose(everything(source), 0.5 * TONE, atol=atol)


def test_pipe__wav_with_a_chunk_behind_its_samples__plays_the_samples_alone():
    content = wav(TONE, "PCM_16").getvalue() + b"LIST" + (4000).to_bytes(4, "little") + b"\x7f" * 4000
    np.testing.assert_allclose(everything(PipeSource(io.BytesIO(content))), TONE, atol=1e-4)


def test_pipe__raw_samples__those_at_the_rate_stated():
    source = PipeSource(io.BytesIO((32767 * TONE).astype("<i2").tobytes()), RATE)
    np.testing.assert_allclose(everything(source), TONE, atol=1e-4)


@pytest.mark.parametrize(
    ("content", "rate_hz", "got"),
    [
        (b"", None, "no WAV"),
        (b"\0" * 100, None, "no WAV"),
        (b"\0" * 100, 3, "3 Hz"),
        (b"RIFF\0\0\0\0WAVE", None, "ends before its samples"),
        (wav(TONE, "PCM_24").getvalue(), None, "24 bits"),
    ],
)
def test_pipe__what_it_does_not_read__refused(content, rate_hz, got):
    with pytest.raises(BadInput) as refusal:
        PipeSource(io.BytesIO(content), rate_hz)
    assert got in refusal.value.got


def test_pipe__head_that_claims_gigabytes__passed_over_in_pieces():
    asked = []

    class Claims(io.BytesIO):
        def read(self, size=-1):
            asked.append(size)
            return super().read(size)

    with pytest.raises(BadInput, match="ends before its samples"):
        PipeSource(Claims(b"RIFF\0\0\0\0WAVEJUNK\xfe\xff\xff\xff" + b"\0" * 200_000))
    assert max(asked) <= 1 << 16


class Library:
    """PortAudio with a microphone that a test speaks into; refuses: with these words."""

    PortAudioError = RuntimeError

    def __init__(self, refuses=""):
        self.refuses, self.closed = refuses, False

    def InputStream(self, callback, samplerate, channels, **options):
        if self.refuses:
            raise RuntimeError(self.refuses)
        self.speak = lambda samples: callback(np.stack([samples] * channels, axis=1), len(samples), None, None)

        def close(ignore_errors):
            self.closed = True

        return SimpleNamespace(start=lambda: None, latency=0.004, abort=lambda ignore_errors: None, close=close)


@pytest.fixture
def library(monkeypatch):
    cards = (
        Card(0, "speakers", "ALSA", 2, 0, 48000.0),
        Card(1, "usb microphone", "ALSA", 0, 1, 44100.0),
        Card(2, "default", "ALSA", 2, 2, 48000.0),
    )
    made = Library()
    monkeypatch.setattr(module, "sounddevice", lambda: made)
    monkeypatch.setattr(module, "list_cards", lambda: cards)
    return made


def test_microphone__spoken_into__the_samples_and_gone_after_a_second_of_none(library):
    now = [0.0]
    source = Microphone("usb", lambda: now[0])
    assert (source.rate_hz, source.late_s) == (44100, 0.004)
    library.speak(TONE[:441])
    np.testing.assert_array_equal(source.read(0.0), TONE[:441])
    now[0] = 0.9
    assert not source.read(0.9).size
    assert not source.ended
    now[0] = 1.1
    source.read(1.1)
    assert source.ended
    assert isinstance(source.fault, CardGone)


def test_microphone__none_named__the_default_one_closed_in_the_end(library):
    source = open_source(None)
    assert source.notes == ("from ALSA/default",)
    assert open_source("usb@48000").rate_hz == 48000
    source.close()
    assert library.closed


@pytest.mark.parametrize(
    ("name", "rate_hz", "refuses", "kind", "got"),
    [
        ("speakers", None, "", BadInput, "no sound card 'speakers'"),
        ("usb@8", None, "Invalid sample rate", BadInput, "does not run at 8 Hz"),
        ("usb", None, "Device unavailable", DeviceFault, "cannot be opened"),
        ("usb", 48000, "", BadInput, "`rate_hz` with a microphone"),
        ("nothere.wav", None, "", BadInput, "file not found"),
    ],
)
def test_source__what_there_is_not__refused_and_nothing_opened(library, name, rate_hz, refuses, kind, got):
    library.refuses = refuses
    with pytest.raises(kind) as refusal:
        open_source(name, rate_hz)
    assert got in refusal.value.got


def test_file__with_a_rate__refused(write_sound):
    with pytest.raises(BadInput, match="`rate_hz`"):
        open_source(write_sound(TONE), 16000)


def test_file__at_its_own_pace__what_is_due_and_no_more(write_sound):
    source = FileSource(write_sound(TONE), drift=200e-6)
    assert not source.read(5.0).size
    assert source.read(5.1).size == int(0.1 * RATE * 1.0002)
    assert source.read(50.0).size == RATE - 1600
    source.read(51.0)
    assert source.ended
