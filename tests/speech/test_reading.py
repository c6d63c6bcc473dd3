"""What is read of a speech file, and every refusal; of a file that was cut: tests/io/test_hostile_files."""

import struct

import numpy as np
import pytest
import soundfile

from tactuator.errors import BadInput
from tactuator.io.sound_frames import _flac_spans
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


def test_scan_speech__channels_that_cancel__said_with_how_much_is_lost(write_sound):
    hiss = 0.005 * np.random.default_rng(4).standard_normal(16000)
    reversed_ = write_sound(np.stack([tone(), hiss - tone()], axis=1), subtype="PCM_24")
    assert "the channels cancel: their mean is 4" in scan_speech(reversed_).notes[1]
    alike = write_sound(np.stack([tone(), 0.7 * tone(1.0)], axis=1), subtype="PCM_24")
    assert len(scan_speech(alike).notes) == 1


@pytest.mark.parametrize("subtype", ["PCM_16", "FLOAT", "PCM_U8"])
@pytest.mark.parametrize(("gain", "clips"), [(0.9, False), (2.5, True)])
def test_scan_speech__clipped__said(write_sound, subtype, gain, clips):
    notes = scan_speech(write_sound(np.clip(gain * 2.0 * tone(frequency_hz=211.0), -0.97, 0.97), subtype=subtype)).notes
    assert any("clipping is likely" in note for note in notes) is clips


@pytest.mark.parametrize(("low", "high"), [(-0.4, 0.4), (-2.0, 0.3), (-0.3, 2.0)])
@pytest.mark.parametrize("after", [1.0, 0.02])
def test_scan_speech__clipped_on_one_side_with_a_mean_or_turned_down_after__said(write_sound, low, high, after):
    voice = (1.0 + 0.5 * tone(2.0, frequency_hz=3.0)) * tone(2.0, frequency_hz=211.0) + 0.05
    for channels in (1, 2):
        rows = np.stack([after * np.clip(2.0 * voice, low, high), after * 0.1 * voice][:channels], axis=1)
        notes = scan_speech(write_sound(rows, subtype="PCM_24")).notes
        assert any("clipping is likely" in note for note in notes)
        whole = np.stack([after * 0.4 * voice] * channels, axis=1)
        assert not any("clipping" in note for note in scan_speech(write_sound(whole, subtype="PCM_16")).notes)


def streamed(path, length):
    """A WAV whose writer did not know the length."""
    content = bytearray(path.read_bytes())
    at = content.index(b"data") + 4
    content[4:8] = content[at : at + 4] = length.to_bytes(4, "little")
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("length", [0, 0x7FFFFFFF, 0x7FFFFFFF - 36, 0xFFFFFFFF, 0xFFFFFFFF - 44, 0x80000000])
@pytest.mark.parametrize("subtype", ["PCM_16", "PCM_24", "FLOAT"])
def test_scan_speech__stream_of_unknown_length__read_to_its_end(write_sound, subtype, length):
    whole = read(write_sound(tone(2.0), subtype=subtype, name="whole.wav"))
    got = streamed(write_sound(tone(2.0), subtype=subtype), length)
    assert scan_speech(got).frames == 32000
    np.testing.assert_array_equal(read(got), whole)


def with_unknown_length(kind, content):
    """The bytes of a file of 16 bits whose writer could not go back to write the lengths, by each format's own text."""
    if kind == "AU":  # 32 bits at 8
        return content[:8] + bytes(4) + content[12:]
    at = content.index(b"data")
    if kind == "CAF":  # -1 for the chunk of samples
        return content[: at + 4] + b"\xff" * 8 + content[at + 12 :]
    if kind == "W64":  # of the file after its GUID, and of the chunk after its own
        return content[:16] + b"\xff" * 8 + content[24 : at + 16] + b"\xff" * 8 + content[at + 24 :]
    table = content.index(b"ds64") + 8  # sizes of file and samples, and the number of samples
    return content[:table] + bytes(24) + content[table + 24 :]


@pytest.mark.parametrize("kind", ["AU", "CAF", "W64", "RF64"])
def test_scan_speech__length_not_known_to_its_writer__read_to_its_end(tmp_path, kind):
    path = tmp_path / f"speech.{kind.lower()}"
    soundfile.write(path, tone(2.0), 16000, format=kind, subtype="PCM_16")
    whole = read(path)
    path.write_bytes(with_unknown_length(kind, path.read_bytes()))
    assert scan_speech(path).frames == 32000
    np.testing.assert_array_equal(read(path), whole)


@pytest.mark.parametrize("kind", ["Ogg", "FLAC"])
def test_scan_speech__two_streams_in_a_file__is_refused_and_not_half_read(tmp_path, kind):
    path = tmp_path / f"speech.{kind.lower()}"
    soundfile.write(path, tone(2.0), 16000)
    assert scan_speech(path).frames == 32000
    path.write_bytes(2 * path.read_bytes())
    with pytest.raises(BadInput, match=f"2 {kind} streams in one file; expected a single one"):
        scan_speech(path)


def test_scan_speech__flac_of_unknown_length__read_to_its_end_and_refused_where_it_is_cut(tmp_path):
    path = tmp_path / "speech.flac"
    soundfile.write(path, tone(2.0), 16000)
    whole, content = read(path), path.read_bytes()
    streamed_ = content[:21] + bytes([content[21] & 0xF0]) + bytes(4) + content[26:]  # 36 bits of STREAMINFO
    path.write_bytes(streamed_)
    assert scan_speech(path).frames == 32000
    np.testing.assert_array_equal(read(path), whole)
    path.write_bytes(streamed_[: len(content) // 2])
    with pytest.raises(BadInput, match="lost sync"):
        scan_speech(path)


def altered(content, mark, past, form, value):
    """Bytes with a number of that form written so many bytes past a mark."""
    at = content.index(mark) + past
    return content[:at] + struct.pack(form, value) + content[at + struct.calcsize(form) :]


HALF_STATED = {
    "WAV": (b"data", 4, "<I", 64_000), "AIFF": (b"SSND", 4, ">I", 64_008), "AU": (b".snd", 8, ">I", 64_000),
    "CAF": (b"data", 4, ">q", 64_004), "RF64": (b"ds64", 16, "<Q", 64_000),
}  # fmt: skip
"""Where a format states the bytes of its samples, and half of those of 4 s."""


@pytest.mark.parametrize("kind", HALF_STATED)
def test_scan_speech__samples_behind_those_its_head_states__is_refused_and_not_half_read(tmp_path, kind):
    path, lead = tmp_path / f"speech.{kind.lower()}", np.random.default_rng(2).uniform(-0.5, 0.5, 64_000)
    soundfile.write(path, lead, 16000, format=kind, subtype="PCM_16")
    content = path.read_bytes()
    path.write_bytes(content + bytes(4096))  # as a card or disk fills its last sector
    assert scan_speech(path).frames == 64_000
    path.write_bytes(altered(content, *HALF_STATED[kind]))
    with pytest.raises(BadInput, match=r"ends the samples at byte \d+ of \d+, and 6400\d bytes that are no chunk"):
        scan_speech(path)
    path.write_bytes(2 * content)
    with pytest.raises(BadInput, match=r"a second (RIFF|FORM|RF64|data) at byte|no chunk|marker"):
        scan_speech(path)


def test_scan_speech__flac_that_states_half__read_to_its_end_and_said_or_refused_where_it_is_cut(tmp_path):
    path = tmp_path / "speech.flac"
    soundfile.write(path, np.random.default_rng(2).uniform(-0.5, 0.5, 64_000), 16000)
    whole, content = read(path), path.read_bytes()
    half = content[:21] + bytes([content[21] & 0xF0]) + struct.pack(">I", 32_000) + content[26:]
    like = b"\xff\xf8\x54\x08\xf7\xbf\xbf\xbf"  # the head of a frame of a number beyond all others
    like += bytes([next(last for last in range(256) if list(_flac_spans(like + bytes([last]) + bytes(20), 4096)))])
    for behind in (b"", b"TAG" + bytes(125), like + bytes(20)):
        path.write_bytes(content + behind)
        assert scan_speech(path).notes == ()
    path.write_bytes(half)
    assert scan_speech(path).notes == ("its head states 32000 samples, 64000 follow: all are read",)
    np.testing.assert_array_equal(read(path), whole)
    path.write_bytes(half[: len(half) * 4 // 5])
    with pytest.raises(BadInput, match="lost sync"):
        scan_speech(path)


@pytest.mark.parametrize("between", [bytes(500), bytes(10_000), b"hello " * 2000, bytes(range(250)) * 40])
@pytest.mark.parametrize("mode", ["CONSTANT", "VARIABLE"])
def test_scan_speech__mp3_with_other_bytes_between__is_read_to_its_end_and_they_are_said(tmp_path, between, mode):
    path = tmp_path / "m.mp3"
    loud = np.random.default_rng(1).uniform(-0.5, 0.5, 48_000)
    soundfile.write(path, loud, 16000, bitrate_mode=mode)
    content = path.read_bytes()
    path.write_bytes(content + between + content)
    found = scan_speech(path)
    assert found.duration_s == pytest.approx(6.2, abs=0.1)
    assert found.notes == (f"{len(between)} bytes at 3.10 s are no sound: passed over",)
    got = read(path)[-48_000:]
    assert np.sqrt(np.mean(got**2)) == pytest.approx(np.sqrt(np.mean(loud**2)), rel=0.2)  # its second part is there
    at = content.index(b"Info" if b"Info" in content else b"Xing") + 8
    frames = int.from_bytes(content[at : at + 4], "big")
    path.write_bytes(content[:at] + struct.pack(">I", frames // 2) + content[at + 4 :])
    assert scan_speech(path).duration_s == pytest.approx(3.1, abs=0.1)
    assert "its index states 1." in scan_speech(path).notes[0]
    path.write_bytes(content[: len(content) // 2] + bytes(20_000))
    with pytest.raises(BadInput, match=f"truncated, .* of {frames} frames"):
        scan_speech(path)


@pytest.mark.parametrize("subtype", ["VORBIS", "OPUS"])
def test_scan_speech__ogg_page_cut_missing_or_out_of_order__is_refused_with_its_place(tmp_path, subtype):
    path = tmp_path / "speech.ogg"
    soundfile.write(path, np.random.default_rng(2).uniform(-0.5, 0.5, 96_000), 16000, format="OGG", subtype=subtype)
    assert scan_speech(path).notes == ()
    content = path.read_bytes()
    pages = [b"OggS" + page for page in content.split(b"OggS")[1:]]
    half = len(pages) // 2
    for spoilt, words in (
        (content[:-100], f"truncated within the Ogg page at byte {len(content) - len(pages[-1])}"),
        (b"".join(pages[:half] + pages[half + 1 :]), f"Ogg page {half} is missing"),
        (b"".join([*pages[:-1], altered(pages[-1], b"OggS", 6, "<q", 8000)]), "states 8000 samples, one before it"),
        (b"".join([*pages[:half], altered(pages[half], b"OggS", 5, "B", 4), *pages[half + 1 :]]), "marked as the last"),
    ):
        path.write_bytes(spoilt)
        with pytest.raises(BadInput, match=words):
            scan_speech(path)
    path.write_bytes(b"".join(pages[:-1]))
    assert "no Ogg page is marked as the last" in scan_speech(path).notes[0]


def test_scan_speech__samples_without_a_head__are_refused(tmp_path):
    (tmp_path / "speech.raw").write_bytes(bytes(range(256)) * 100)
    with pytest.raises(BadInput, match="samples without a head"):
        scan_speech(tmp_path / "speech.raw")


@pytest.mark.parametrize("between", [b"", b"TAG" + bytes(125)])
def test_scan_speech__mp3_files_joined__read_to_the_end_of_the_last(tmp_path, between):
    content = []
    for seconds, rate, channels in ((2.0, 16000, 1), (3.3, 16000, 1), (2.0, 22050, 1), (2.0, 16000, 2)):
        path = tmp_path / "m.mp3"
        soundfile.write(path, np.tile(tone(seconds, rate)[:, None], channels), rate)
        content.append(path.read_bytes())
    for last in (content[1], (path.write_bytes(content[1]) and without_index(path)).read_bytes()):
        path.write_bytes(content[0] + between + last)
        found = scan_speech(path)
        assert 5.3 <= found.duration_s <= 5.6  # with the pauses of two encoders
        assert len(read(path)) == found.frames
    for last in content[2:]:
        path.write_bytes(content[0] + between + last)
        with pytest.raises(BadInput, match="two rates, or of mono and stereo"):
            scan_speech(path)


@pytest.mark.parametrize("before", [bytes(500), b"half a frame"])
def test_scan_speech__mp3_that_begins_with_something_else__is_not_half_read(tmp_path, before):
    path = tmp_path / "m.mp3"
    loud = np.r_[0.001 * tone(2.0), np.random.default_rng(1).uniform(-0.5, 0.5, 32000)]
    soundfile.write(path, loud, 16000, bitrate_mode="VARIABLE")
    content = without_index(path) and path.read_bytes()
    path.write_bytes(before + content)
    try:
        frames = scan_speech(path).frames
    except BadInput:
        return
    assert abs(frames - loud.size) <= 4 * 576


def without_index(path):
    """An MP3 without its first frame, where the index is."""
    content = path.read_bytes()
    rate = (0, 8, 16, 24, 32, 40, 48, 56, 64, 80, 96, 112, 128, 144, 160, 0)[content[2] >> 4]
    length = 72_000 * rate // 16000 + (content[2] >> 1 & 1)
    assert any(index in content[:length] for index in (b"Xing", b"Info"))
    path.write_bytes(content[length:])
    return path


@pytest.mark.parametrize("mode", ["VARIABLE", "AVERAGE", "CONSTANT"])
@pytest.mark.parametrize("seconds", [1.0, 3.3, 7.0])
def test_scan_speech__mp3_without_an_index__decoded_to_its_end(tmp_path, mode, seconds):
    loud = np.r_[0.001 * tone(0.5 * seconds), np.random.default_rng(1).uniform(-0.5, 0.5, round(8000 * seconds))]
    path = tmp_path / "m.mp3"
    soundfile.write(path, loud, 16000, bitrate_mode=mode, compression_level=0.5)
    indexed = scan_speech(path)
    got = scan_speech(without_index(path))
    assert abs(got.frames - indexed.frames) <= 4 * 576
    assert len(read(path)) == got.frames


def test_scan_speech__mp3_that_ends_early__refused_where_its_index_says_so(tmp_path):
    path = tmp_path / "m.mp3"
    soundfile.write(path, tone(3.0), 16000)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(BadInput, match="truncated"):
        scan_speech(path)
