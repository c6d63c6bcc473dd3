"""The scope's samples, pictures and levels; and the generator's levels, without a click."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.console.generator import MOST_DB_SL, RAMP_S, Generator, peaks_of
from tactuator.console.generator import GeneratorWave as Wave
from tactuator.console.rig_process import Levels
from tactuator.console.scope import ScopeSamples, Trigger, newest_crossing
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, open_reference, write_reference
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.decibels import db


def filled(lengths, capacity=200, seed=0):
    every = np.random.default_rng(seed).standard_normal((sum(lengths), 3)).astype(np.float32)
    samples, at = ScopeSamples(1, capacity), 0
    for length in lengths:
        samples.add(at, every[at : at + length])
        at += length
    return samples, every


@settings(max_examples=40)
@given(
    st.lists(st.integers(0, 90), min_size=1, max_size=12), st.integers(0, 400), st.integers(1, 400), st.integers(1, 50)
)
def test_window__of_any_stretch__holds_least_and_greatest_of_its_rows(lengths, start, length, columns):
    samples, every = filled(lengths)
    held = samples.rows(0, samples.end)
    assert samples.lost == 0
    assert len(held) >= min(len(every), 200)
    np.testing.assert_array_equal(held, every[len(every) - len(held) :])
    window = samples.window(start, start + length, columns)
    assert len(window.low) <= columns
    assert window.first % window.step == 0
    for place, (low, high) in enumerate(zip(window.low, window.high, strict=True)):
        rows = every[window.first + place * window.step : window.first + (place + 1) * window.step]
        assert len(rows) == window.step
        np.testing.assert_array_equal(low, rows.min(axis=0))
        np.testing.assert_array_equal(high, rows.max(axis=0))


def test_rows__missing_or_of_another_shape__are_no_number_or_refused():
    samples, every = filled([40])
    for first, shape in ((39, (5, 3)), (40, (5, 2)), (40, (5,))):
        with pytest.raises(BadInput, match="from 40 on"):
            samples.add(first, np.zeros(shape, np.float32))
    samples.add(47, every[:10])
    assert (samples.lost, samples.end) == (7, 57)
    assert np.all(np.isnan(samples.rows(40, 47)))
    np.testing.assert_array_equal(samples.rows(47, 57), every[:10])
    window = filled([50] * 8, capacity=4000)[0].window(0, 400, 10)
    assert (window.first, window.step, len(window.low)) == (0, 48, 8)  # at most two columns late


def sampled(values):
    samples = ScopeSamples(1, 1 << 12)
    rows = np.zeros((len(values), 3), np.float32)
    rows[:, 2] = values
    samples.add(0, rows)
    return samples


def test_trigger__on_a_sine_or_noise__stands_at_its_last_crossing_or_nowhere():
    samples = sampled(np.sin(2.0 * np.pi * (np.arange(1000) - 0.5) / 100.0))
    for edge, quarter in (("rising", 0), ("falling", 2)):
        assert newest_crossing(samples, Trigger(2, 0.0, edge), 0, 1000) == 901 + 25 * quarter
    for level in (2.0, -2.0, float("inf")):
        assert newest_crossing(samples, Trigger(2, level), 0, 1000) is None
    noise = 0.008 * np.random.default_rng(1).standard_normal(4000)
    samples = sampled(-np.cos(2.0 * np.pi * np.arange(4000) / 2000.0) + noise)
    crossings = {newest_crossing(samples, Trigger(2, 0.0), 1400, stop) for stop in range(2400, 2700)}
    assert len(crossings) == 2
    assert None in crossings


RATE = 4000


def rows_of(trace):
    return np.concatenate((trace.reference, trace.command_v, trace.position_v), axis=1).astype(np.float32)


@pytest.mark.parametrize(("hertz", "level"), [(40.0, 30.0), (100.3, 25.0), (250.0, 40.0)])
def test_tone__on_the_simulated_rig__is_read_as_the_finger_feels_it(controller, hertz, level):
    rig, felt = SimulatedRig(controller.display, 1), []
    rig.load(controller)
    rig.finger("thumb").attach(felt.append)
    reference = np.zeros((2 * RATE, 3))
    reference[:, 1] = 10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * hertz * np.arange(2 * RATE) / RATE)
    trace = rig.play(reference)
    moved = np.concatenate(felt)[-RATE:] * np.hanning(RATE)
    amplitude = 2.0 * abs(np.exp(-2j * np.pi * hertz * np.arange(RATE) / RATE) @ moved) / np.hanning(RATE).sum()
    truth = float(db(amplitude / controller.display.channels[1].threshold.curve.displacement_mm(hertz)))
    found = Levels(controller.display).of_rows(rows_of(trace)[-RATE:], hertz)[1]
    assert found.tone_db_sl == pytest.approx(truth, abs=0.25)
    assert found.level_db_sl == pytest.approx(truth, abs=1.0)
    assert truth == pytest.approx(level, abs=1.0)


def test_spectrum__of_two_tones__stands_at_their_levels_over_the_threshold(controller):
    display, time = controller.display, np.arange(RATE) / RATE
    levels, rows = Levels(display), np.zeros((RATE, 9), np.float32)
    channel = display.channels[2]
    for hertz, level in ((40.0, 20.0), (160.0, -5.0)):
        volts = float(channel.threshold_voltage(hertz)) * 10.0 ** (level / 20.0)
        rows[:, 8] += volts * np.sin(2.0 * np.pi * hertz * time)
    found = levels.of_rows(rows)[2]
    for hertz, level in ((40.0, 20.0), (160.0, -5.0)):
        near = np.argmin(np.abs(np.log(levels.frequency_hz / hertz)))
        assert found.spectrum_db_sl[near - 1 : near + 2].max() == pytest.approx(level, abs=0.1)
    assert found.level_db_sl == pytest.approx(10.0 * np.log10(10.0**2.0 + 10.0**-0.5), abs=0.05)


def test_peak__of_a_tone_between_the_lines__is_its_frequency_and_level(controller):
    """The middle of the stretch it fell into was told: 98.5 Hz for 100, and 217 for 220."""
    levels, channel, time = Levels(controller.display), controller.display.channels[2], np.arange(RATE) / RATE + 0.003
    for hertz in (1.0, 2.0, 3.3, 7.5, 20.0, 43.21, 100.0, 157.5, 220.0, 299.9):
        rows = np.zeros((RATE, 9), np.float32)
        rows[:, 8] = 10.0 * float(channel.threshold_voltage(hertz)) * np.sin(2.0 * np.pi * hertz * time)
        rows[:, 8] += 1e-6 * np.random.default_rng(1).standard_normal(RATE)
        found = levels.of_rows(rows)[2]
        assert (found.peak_hz, found.peak_db_sl) == (pytest.approx(hertz, abs=0.05), pytest.approx(20.0, abs=0.05))


def test_levels__of_nothing_or_too_little__are_the_floor_or_none(controller):
    rows, levels = np.zeros((RATE, 9), np.float32), Levels(controller.display)
    rows[:, 3:6] = [0.1, -0.2, 0.3]
    rows[:, 6:] = 1.5  # a sensor's offset is no level
    quiet = levels.of_rows(rows)
    assert [each.level_db_sl for each in quiet] == [-120.0] * 3
    assert [each.command_mean_v for each in quiet] == pytest.approx([0.1, -0.2, 0.3])
    assert [each.tone_db_sl for each in quiet] == [None] * 3
    assert [each.tone_db_sl for each in levels.of_rows(rows, 2.3)] == [-120.0] * 3
    samples = ScopeSamples(3, 10 * RATE)
    for first, count in ((0, RATE - 1), (RATE, 10)):
        samples.add(first, rows[:count])
        assert levels.of(samples) is None
    assert samples.lost == 1


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


def test_file__at_a_level__is_played_with_its_greatest_there_and_ends(generator, controller, tmp_path):
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
        (Wave("tone", 20.0, ("toe",)), "channels toe; expected index"),
        (Wave("tone", 20.0, ()), "channels none"),
        (Wave("tone", 20.0, ("index",), 1801.0), "up to 1800 Hz"),
        (Wave("sweep", 20.0, ("index",), 10.0, 10.0), "between two frequencies"),
        (Wave("sweep", 20.0, ("index",), 10.0, 100.0, 0.01), "in 0.1 to 600 s"),
        (Wave("file", 20.0, ("index",), file="nowhere.wav"), "file not found"),
        (Wave("file", 20.0, ("index",), file=slow), "2000 Hz for index, thumb, middle; expected 4000 Hz"),
    ):
        with pytest.raises(BadInput, match=words):
            generator.ask(wave)
        assert generator.wave == before
