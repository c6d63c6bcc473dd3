"""Felt against asked: closed forms for the bands, and the acceptance of speech on the simulated display."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.measure.error import ChannelPrediction
from tactuator.measure.felt import BandAnalysis, FeltComparison, compare_felt, frame_differences_db
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.reading import sample_path
from tests.measure.loops import loaded
from tests.speech.rendered import render_array

RATE = 4000.0


def whole_levels(signal):
    analysis = BandAnalysis(RATE)
    window = analysis.window(1)
    parts = [analysis.frames(np.fft.rfft(window.rows[0])) for _ in window.push(signal[:, None])]
    parts += [analysis.frames(np.fft.rfft(window.rows[0]), min(12.0, count / RATE)) for count in window.finish()]
    return analysis, np.concatenate([p.long_db for p in parts]), np.concatenate([p.short_db for p in parts])


@pytest.mark.parametrize("frequency", [5.0, 20.0, 100.0, 200.0])
def test_band_levels__sinusoid_of_amplitude_10__is_20_db_in_its_band(frequency):
    signal = 10.0 * np.sin(2 * np.pi * frequency * np.arange(30 * 4000) / RATE)
    analysis, long_db, short_db = whole_levels(signal)
    assert len(long_db) == 60
    assert len(short_db) == 300
    centres = [band.centre_hz for band in analysis.bands]
    ends = analysis.bands[0], analysis.long_bands[-1], analysis.short_bands[-1]
    assert [round(band.centre_hz) for band in ends] == [2, 40, 251]
    column = int(np.argmin(np.abs(np.log(np.array(centres) / frequency))))
    levels = long_db if column < long_db.shape[1] else short_db
    column -= 0 if column < long_db.shape[1] else long_db.shape[1]
    np.testing.assert_allclose(levels[8:-8, column], 20.0, atol=0.15)


def test_band_levels__white_noise__power_is_kept_and_goes_with_bandwidth():
    noise = np.random.default_rng(0).standard_normal(120 * 4000)
    analysis, long_db, short_db = whole_levels(noise)
    power = np.concatenate([(10 ** (long_db / 10)).mean(axis=0), (10 ** (short_db / 10)).mean(axis=0)])
    expected = np.array([2.0 * (band.high_hz - band.low_hz) / 2000.0 for band in analysis.bands])
    np.testing.assert_allclose(10 * np.log10(power / expected), 0.0, atol=1.2)
    assert 10 * np.log10(power.sum() / expected.sum()) == pytest.approx(0.0, abs=0.15)


def test_frame_differences__only_bands_of_10_db_sl__rms_over_them():
    asked = np.array([[20.0, 30.0, 5.0], [9.0, 1.0, -np.inf]])
    felt = np.array([[23.0, 26.0, 50.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(frame_differences_db(asked, felt), [np.sqrt((9 + 16) / 2)])


def test_comparison__displacement_as_designed__no_difference_but_the_prefilters(controller):
    rng = np.random.default_rng(1)
    count = 20 * 4000
    reference = 300.0 * rng.standard_normal((count, 3))
    frequency = np.fft.rfftfreq(count, 1 / RATE)
    displacement = np.empty_like(reference)
    errors = []
    for column, channel in enumerate(controller.display.channels):
        prediction = ChannelPrediction.of(controller, channel.name)
        spectrum = np.fft.rfft(reference[:, column]) * prediction.displacement(frequency)
        displacement[:, column] = np.fft.irfft(spectrum, count)
        errors.append(np.abs(prediction.felt(frequency)))
    comparison = FeltComparison(controller)
    for start in range(0, count, 7000):
        comparison.push(reference[start : start + 7000], displacement[start : start + 7000])
    report = comparison.finish()
    for finger, error in zip(report.fingers, errors, strict=True):
        expected = 20 * np.log10(np.interp(finger.centre_hz, frequency, error))
        np.testing.assert_allclose(finger.difference_db[4:], expected[4:], atol=0.25)
        assert finger.rms_db < 0.6


def test_comparison__sink__gets_the_felt_signal_in_step_with_the_reference(controller):
    reference, _ = render_array(sample_path(), controller)
    rig = loaded(controller, 2)
    felt, pieces = [], []
    rig.finger("index").attach(pieces.append)
    rig.play(reference)
    displacement = np.zeros_like(reference)
    displacement[:, 0] = pieces[0]
    comparison = FeltComparison(controller, felt.append)
    comparison.push(reference, displacement)
    comparison.finish()
    index = np.concatenate(felt)[:, 0]
    assert len(index) == len(reference)
    assert np.corrcoef(index, reference[:, 0])[0, 1] > 0.99


def test_compare_felt__sample_on_every_finger__within_1_db_in_the_median(controller):
    reference, _ = render_array(sample_path(), controller)
    report = compare_felt(SimulatedRig(controller.display, 1), controller, [reference])
    assert report.worst_rms_db <= 1.0
    for finger, figures in zip(report.fingers, report.figures().values(), strict=True):
        values = frame_differences_db(finger.asked_short, finger.felt_short)
        assert (figures["median_db_100ms"], figures["p95_db_100ms"]) == (np.median(values), np.percentile(values, 95))
        assert figures["frames_all"] > 10
        assert figures["median_db_all"] <= 1.0
        assert figures["p95_db_all"] <= 2.0


def test_comparison__shapes_or_a_channel_that_do_not_fit__refused(controller):
    with pytest.raises(BadInput, match="; "):
        FeltComparison(controller).push(np.zeros((10, 3)), np.zeros((9, 3)))
    with pytest.raises(BadInput, match="ring"):
        ChannelPrediction.of(controller, "ring")
