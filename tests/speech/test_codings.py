"""The codings against what their parameters say, and their files."""

import numpy as np
import pytest

from tactuator.cli import main
from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.speech.band_codings import BandsCoding, DirectCoding
from tactuator.speech.coding import GROUP, coding_names, coding_of, place, read_coding, write_coding
from tactuator.speech.envelope_coding import BRATAKOS_2001, YUAN_2005, EnvelopeBand, EnvelopeCoding, Voicing
from tactuator.speech.reading import sample_path
from tests.speech.rendered import cut, render_array

FINGERS = ("thumb", "index", "middle")
RATE_IN, RATE = 16000, 4000


def coded(coding, samples):
    return np.concatenate(list(coding.signals(iter([samples]), RATE_IN, RATE)))


def tone(frequency, seconds=4.0):
    return np.sin(2 * np.pi * frequency * np.arange(round(RATE_IN * seconds)) / RATE_IN)


def amplitude(signal, frequency):
    part = signal[RATE : 3 * RATE]
    return 2 * np.abs(np.mean(part * np.exp(-2j * np.pi * frequency * np.arange(len(part)) / RATE)))


def test_direct__tones__inside_kept_outside_gone_on_all_fingers_or_those_named():
    for frequency, expected in ((5.0, 1.0), (270.0, 1.0), (310.0, 0.0)):
        assert amplitude(coded(DirectCoding(), tone(frequency))[:, 0], frequency) == pytest.approx(expected, abs=1e-3)
    np.testing.assert_array_equal(DirectCoding().placement(FINGERS), [[1, 1, 1]])
    np.testing.assert_array_equal(DirectCoding(fingers=("index",)).placement(FINGERS), [[0, 1, 0]])


def test_bands__their_sum__is_direct():
    noise = np.random.default_rng(0).standard_normal(RATE_IN * 4)
    low = DirectCoding(low_hz=2.0, low_transition_hz=2.0, high_hz=290.0, high_transition_hz=20.0)
    np.testing.assert_allclose(coded(BandsCoding(), noise).sum(axis=1), coded(low, noise)[:, 0], atol=1e-9)


def test_bands__tone__on_its_finger_alone_and_gains_in_db():
    for band, frequency in enumerate((100.0, 180.0, 250.0)):
        signals = coded(BandsCoding(), tone(frequency))
        for column in range(3):
            assert amplitude(signals[:, column], frequency) == pytest.approx(float(column == band), abs=2e-3)
    gains = BandsCoding(gains_db=(6.0, 0.0, -6.0)).placement(FINGERS)
    np.testing.assert_allclose(np.diag(gains), [10**0.3, 1.0, 10**-0.3])


def test_envelope__tone_in_a_band__carrier_with_the_rectified_mean():
    coding = EnvelopeCoding((EnvelopeBand(400.0, 1600.0, 50.0, ("thumb",)),))
    got = coded(coding, tone(800.0))[:, 0]
    assert amplitude(got, 50.0) == pytest.approx(2 / np.pi, rel=0.01)  # mean of |sine|
    half = EnvelopeCoding((EnvelopeBand(400.0, 1600.0, 50.0, ("thumb",), rectifier="half"),))
    assert amplitude(coded(half, tone(800.0))[:, 0], 50.0) == pytest.approx(1 / np.pi, rel=0.01)


def test_envelope__modulated_tone__envelope_follows_to_its_smoothing():
    modulation = 1.0 + 0.8 * np.sin(2 * np.pi * 5.0 * np.arange(RATE_IN * 4) / RATE_IN)
    coding = EnvelopeCoding((EnvelopeBand(400.0, 1600.0, 200.0, ("thumb",), smooth_hz=25.0),))
    got = coded(coding, modulation * tone(800.0))[:, 0]
    smoothed = 1.0 / np.sqrt(1.0 + (5.0 / 25.0) ** 4)
    for side in (195.0, 205.0):
        assert amplitude(got, side) / amplitude(got, 200.0) == pytest.approx(0.4 * smoothed, rel=0.02)


def test_envelope__expanded__levels_apart_by_the_exponent_and_the_key_may_be_left_out(tmp_path):
    coding = EnvelopeCoding((EnvelopeBand(400.0, 1600.0, 50.0, ("thumb",)),), expansion=2.0)
    loud, quiet = (amplitude(coded(coding, size * tone(800.0))[:, 0], 50.0) for size in (0.1, 0.01))
    assert 20 * np.log10(loud / quiet) == pytest.approx(40.0, abs=0.5)
    write_coding(tmp_path / "c.toml", coding)
    assert read_coding(tmp_path / "c.toml") == coding
    with pytest.raises(BadInput, match="expansion is 5"):
        EnvelopeCoding(expansion=5.0)


def test_envelope__gates__voice_and_its_absence():
    rng = np.random.default_rng(1)
    voiced, unvoiced = tone(150.0), 0.3 * np.diff(rng.standard_normal(RATE_IN * 4 + 1))
    for gate, for_voice, for_noise in (("voiced", True, False), ("unvoiced", False, True)):
        coding = EnvelopeCoding((EnvelopeBand(100.0, 6000.0, 50.0, ("thumb",), gate=gate),))
        assert (amplitude(coded(coding, voiced)[:, 0], 50.0) > 0.3) == for_voice
        assert (np.std(coded(coding, unvoiced)[RATE:, 0]) > 0.1) == for_noise


def test_envelope__any_preset__silent_above_300_hz():
    noise = np.random.default_rng(2).standard_normal(RATE_IN * 4)
    for coding in (EnvelopeCoding(), YUAN_2005, BRATAKOS_2001):
        spectrum = np.abs(np.fft.rfft(coded(coding, noise) * np.hanning(4 * RATE)[:, None], axis=0))
        frequency = np.fft.rfftfreq(4 * RATE, 1 / RATE)
        assert 20 * np.log10(spectrum[frequency > 302].max() / spectrum.max()) < -70


def test_presets__published_parameters():
    low, high = YUAN_2005.bands
    assert (low.low_hz, low.high_hz, low.carrier_hz, low.smooth_hz, low.order) == (0.0, 350.0, 50.0, 25.0, 2)
    assert (high.low_hz, high.high_hz, high.carrier_hz, high.smooth_hz, high.order) == (3000.0, None, 250.0, 25.0, 2)
    (octave,) = BRATAKOS_2001.bands
    assert (octave.carrier_hz, octave.smooth_hz) == (200.0, 100.0)
    assert octave.high_hz == pytest.approx(2 * octave.low_hz)


@pytest.mark.parametrize("lengths", [[65536], [1, 9999, 3]])
@pytest.mark.parametrize("name", ["direct", "bands", "envelope"])
def test_coding__however_it_is_cut__same_bits(name, lengths):
    noise = np.random.default_rng(3).standard_normal(20011)
    pieces = np.concatenate(list(coding_of(name).signals(cut(noise, lengths), RATE_IN, RATE)))
    np.testing.assert_array_equal(pieces, coded(coding_of(name), noise))
    assert len(pieces) == int(np.ceil(20011 / 4))


def test_coding_file__written_and_read__same_coding(tmp_path):
    for name in ("direct", "bands", "envelope", "yuan-2005", "bratakos-2001"):
        write_coding(tmp_path / "c.toml", coding_of(name))
        assert coding_of(str(tmp_path / "c.toml")) == coding_of(name)


@pytest.mark.parametrize(
    ("name", "key", "change", "words"),
    [
        ("direct", 'kind = "direct"', 'kind = "other"', "kind is 'other'"),
        ("direct", "low_hz = 2.0\n", "", "'low_hz' is missing"),
        ("direct", "low_hz = 2.0", "low_hz = 2.0\nloww = 1", "'loww' is not a parameter"),
        ("direct", "low_hz = 2.0", 'low_hz = "two"', "low_hz is 'two'"),
        ("direct", "low_hz = 2.0", "low_hz = ", "Invalid"),
        ("yuan-2005", "order = 2\n", "", r"bands\[0\]: 'order' is missing"),
        ("yuan-2005", "carrier_hz = 50.0", "carrier_hz = 900.0", "carrier 900 Hz"),
        ("yuan-2005", 'rectifier = "full"', 'rectifier = "none"', "rectifier"),
        ("yuan-2005", "ratio = 1.0", "ratio = 0.0", "voicing"),
        ("yuan-2005", "ratio = 1.0", "", "voicing: 'ratio' is missing"),
    ],
)
def test_coding_file__amiss__refused_in_one_line(tmp_path, name, key, change, words):
    path = tmp_path / "c.toml"
    write_coding(path, coding_of(name))
    path.write_text(path.read_text().replace(key, change, 1))
    with pytest.raises(BadInput, match=words) as refusal:
        read_coding(path)
    assert "\n" not in str(refusal.value)


def test_coding_of__unknown_name_or_no_file__refused(tmp_path):
    with pytest.raises(
        BadInput, match="no coding 'vocoder'; expected direct, bands, bratakos-2001, envelope, yuan-2005, a file"
    ):
        coding_of("vocoder")
    with pytest.raises(BadInput, match="file not found"):
        coding_of(str(tmp_path / "none.toml"))


FOREIGN = """
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt


@dataclass(frozen=True)
class Loud:
    kind: Literal["loud"] = "loud"
    gain: Annotated[float, Gt(0.0)] = 2.0

    def signals(self, blocks, rate_in_hz, rate_hz):
        for block in blocks:
            yield self.gain * block[:: rate_in_hz // rate_hz, None]

    def placement(self, fingers):
        return np.ones((1, len(fingers)))
"""


def test_coding__of_another_package_that_is_none__refused(install):
    install(GROUP, "three", "THREE = 3", "THREE")
    with pytest.raises(BadInput, match="'three' refers to 3; expected a coding"):
        coding_of("three")


def test_coding__of_another_package__by_its_name_and_in_a_file_and_rendered(install, tmp_path, controller):
    install(GROUP, "loud", FOREIGN, "Loud")
    assert "loud" in coding_names()
    loud, path = coding_of("loud"), tmp_path / "loud.toml"
    write_coding(path, loud)
    assert read_coding(path) == loud
    path.write_text(path.read_text().replace("gain = 2.0", "gain = 3"))
    assert read_coding(path).gain == 3.0
    reference, _ = render_array(sample_path(), controller, loud)
    assert np.all(reference[:, 0] == reference[:, 2])
    write_controller(tmp_path / "controller.json", controller)
    words = ("--controller", tmp_path / "controller.json", "--out", tmp_path / "r.wav", "--coding", "loud")
    assert main(["render", *map(str, (sample_path(), *words))]) == 0
    for wrong in ("-1.0", '"2.0"'):
        path.write_text(path.read_text().replace("gain = 3", f"gain = {wrong}"))
        with pytest.raises(BadInput, match="gain is"):
            read_coding(path)
        path.write_text(path.read_text().replace(f"gain = {wrong}", "gain = 3"))


@pytest.mark.parametrize(
    "make",
    [
        lambda: place([("ring",)], FINGERS),
        lambda: BandsCoding(edges_hz=(2.0, 100.0)),
        lambda: BandsCoding(edges_hz=(2.0, 200.0, 100.0, 290.0)),
        lambda: EnvelopeCoding(()),
        lambda: EnvelopeBand(500.0, 400.0, 50.0, ("thumb",)),
        lambda: EnvelopeBand(0.0, None, 50.0, ("thumb",)),
        lambda: EnvelopeBand(0.0, 400.0, 50.0, ("thumb",), order=0),
        lambda: Voicing(low_hz=3000.0),
    ],
)
def test_coding__impossible_parameters__refused(make):
    with pytest.raises(BadInput, match="; "):
        make()
