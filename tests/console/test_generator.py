"""The generator: levels against the definition of dB SL, no click, and refusals."""

import numpy as np
import pytest

from tactuator.console.generator import MOST_DB_SL, RAMP_S, Generator, peaks_of
from tactuator.console.generator import GeneratorWave as Wave
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, open_reference, write_reference

RATE = 4000.0


@pytest.fixture
def generator(controller):
    return Generator(controller.display, np.random.default_rng(7))


def played(generator, seconds, block=80):
    return np.concatenate([generator.block(block) for _ in range(round(seconds * RATE / block))])


def test_tone__after_its_ramp__is_the_sinusoid_at_that_level_on_its_channels_alone(generator):
    generator.ask(Wave("tone", 34.0, ("thumb",), 100.0))
    rows = played(generator, 1.1)[-4000:]
    power = np.mean(rows**2, axis=0)
    assert 10.0 * np.log10(2.0 * power[1]) == pytest.approx(34.0, abs=1e-3)
    assert power[[0, 2]].tolist() == [0.0, 0.0]
    assert np.argmax(np.abs(np.fft.rfft(rows[:, 1]))) == 100


def test_noise__has_the_power_of_a_sinusoid_of_its_level_and_stays_within_comfort(generator, monkeypatch):
    generator.ask(Wave("noise", 45.0, ("index", "middle")))
    rows = played(generator, 30.0)[8000:]
    level = 10.0 * np.log10(2.0 * np.mean(rows**2, axis=0)[[0, 2]])
    assert level == pytest.approx([45.0, 45.0], abs=0.3)
    assert np.max(np.abs(rows)) <= 10.0 ** (55.0 / 20.0)
    spectrum = np.abs(np.fft.rfft(rows[:, 0])) ** 2
    hertz = np.fft.rfftfreq(len(rows), 1.0 / RATE)
    assert spectrum[hertz > 600.0].sum() < 1e-3 * spectrum.sum()
    assert abs(np.corrcoef(rows[:, 0], rows[:, 2])[0, 1]) < 0.05
    monkeypatch.setitem(MOST_DB_SL, "noise", 55.0)
    generator.ask(Wave("noise", 55.0, ("index",)))
    assert np.max(np.abs(played(generator, 5.0))) == 10.0 ** (55.0 / 20.0)  # what passes comfort is held there


def test_sweep__goes_up_and_down_between_its_frequencies(generator):
    generator.ask(Wave("sweep", 20.0, ("index",), 20.0, 200.0, 2.0))
    rows = played(generator, 4.0)[:, 0]
    crossings = np.flatnonzero(np.diff(np.signbit(rows)))
    hertz = 0.5 * RATE / np.diff(crossings)
    turned = len(hertz) // 2
    assert hertz[2] == pytest.approx(21.0, rel=0.1)
    assert hertz[turned] == pytest.approx(200.0, rel=0.1)
    assert hertz[-2] == pytest.approx(21.0, rel=0.1)


@pytest.mark.parametrize(
    "after",
    [None, Wave("tone", 10.0, ("index",), 50.0), Wave("tone", 40.0, ("thumb",), 50.0), Wave("noise", 30.0, ("index",))],
)
def test_change__of_anything__makes_no_step(generator, after):
    generator.ask(Wave("tone", 40.0, ("index",), 50.0))
    before = played(generator, 0.5)
    generator.ask(after)
    rows = np.concatenate((before[-80:], played(generator, RAMP_S + 0.4)))
    most = 100.0 * 2.0 * np.pi * 50.0 / RATE * 1.3 if after is None or after.kind == "tone" else 60.0
    assert np.max(np.abs(np.diff(rows, axis=0))) < most
    if after is None:  # it is over within the ramp
        ramp = round(RAMP_S * RATE)
        assert generator.silent
        assert (np.any(rows[80 : 80 + round(0.9 * ramp)]), np.any(rows[80 + ramp :])) == (True, False)


def reference(path, controller, rows, rate_hz=RATE):
    with write_reference(path, ReferenceHead(rate_hz, tuple(c.name for c in controller.display.channels))) as writer:
        writer.write(rows)
    return str(path)


def test_file__at_a_level__is_played_sample_by_sample_with_its_greatest_there_and_ends(generator, controller, tmp_path):
    rows = (30.0 * np.random.default_rng(3).standard_normal((1000, 3))).clip(-100.0, 100.0)
    rows[0] = 100.0
    path = reference(tmp_path / "r.h5", controller, rows)
    for level, share in ((40.0, 1.0), (20.0, 0.1)):
        generator.ask(Wave("file", level, ("index", "thumb", "middle"), file=path))
        heard = played(generator, 0.5)
        np.testing.assert_allclose(heard[:1000], share * rows, rtol=1e-6)
        assert not np.any(heard[1000:])
        assert generator.silent
    rows[:, 2] = 0.0
    peaks = peaks_of(open_reference(reference(tmp_path / "quiet.h5", controller, rows)))
    assert (peaks["index"], peaks["middle"]) == (100.0, 0.0)


def test_wave__that_cannot_be_played__is_refused_and_the_one_before_goes_on(generator, controller, tmp_path):
    slow = reference(tmp_path / "r.h5", controller, np.zeros((10, 3)), 2000.0)
    before = Wave("tone", 20.0, ("index",))
    generator.ask(before)
    for wave, words in (
        (Wave("tone", 55.1, ("index",)), "-60 to 55 dB SL"),
        (Wave("noise", 46.0, ("index",)), "-60 to 45 dB SL"),
        (Wave("tone", 20.0, ("toe",)), "channels toe; allowed: index"),
        (Wave("tone", 20.0, ()), "channels none"),
        (Wave("tone", 20.0, ("index",), 1801.0), "up to 1800 Hz"),
        (Wave("sweep", 20.0, ("index",), 10.0, 10.0), "between two frequencies"),
        (Wave("sweep", 20.0, ("index",), 10.0, 100.0, 0.01), "in 0.1 to 600 s"),
        (Wave("file", 20.0, ("index",), file="nowhere.wav"), "no such file"),
        (Wave("file", 20.0, ("index",), file=slow), "2000 Hz for index, thumb, middle; allowed: 4000 Hz"),
    ):
        with pytest.raises(BadInput, match=words):
            generator.ask(wave)
        assert generator.wave == before
