"""The whole calibration, on a card turned by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.errors import NoDesign
from tactuator.measure import open_loop as chain
from tactuator.measure.error import ChannelPrediction
from tactuator.measure.open_loop import Calibrated, CalibrationRequest, Flatness, NoEqualiser, _corrected, calibrate
from tactuator.signals.decibels import db
from tests.measure.open_loop.exciters import PERIOD, RATE_HZ, exciter_rig, persons_curve
from tests.rig.sound.exciter import Exciter
from tests.rig.sound.from_start_to_end import controller as designed

ASKED = CalibrationRequest((10.0, 400.0), 20.0, 50.0)


def felt_db(made: Calibrated, exciter: Exciter) -> np.ndarray:
    """The felt level less the threshold by the exciter's equations, at the frequencies of the last measurement."""
    frequency = made.channels[0].last.frequency_hz
    volts = np.abs(made.controller.channels[0].prefilter(RATE_HZ).response(frequency))
    threshold = made.controller.display.channels[0].threshold.curve.displacement_mm(frequency)
    return 20.0 * np.log10(volts * np.abs(exciter.response(frequency)) / threshold)


@pytest.mark.slow
def test_calibrate__exciter_and_a_persons_curve__is_felt_flat_by_its_equations():
    exciter = Exciter(117.3, 3.62, 3e4, second_hz=244.3, hardening=0.2, delay_s=0.0023, sensor_full_scale=1e5)
    person = persons_curve()
    made = calibrate(exciter_rig([exciter], curve=person), ASKED, np.random.default_rng(0))
    (one,) = made.channels
    assert made.flat
    assert one.estimate.by == "model"
    # the card's period and the exciter's own dead time are put back, to the sample
    assert made.controller.display.sound.latency_samples == pytest.approx(PERIOD + exciter.delay_s * RATE_HZ, abs=1.0)
    assert made.controller.display.channels[0].threshold.curve is person
    felt = felt_db(made, exciter)
    assert np.max(np.abs(felt)) < 1.0
    # the sensor says what the equations say
    assert np.max(np.abs(felt - one.last.error_db)) < 0.3


def flat(error_db: float) -> Flatness:
    frequency = np.geomspace(45.0, 280.0, 24)
    ramp = np.log(frequency / 45.0) / np.log(280.0 / 45.0)
    return Flatness(frequency, error_db * (1.0 - ramp), np.full(24, 0.01), False)


def test_corrected__measured_error__the_plant_with_that_error_in_the_band():
    controller = designed(0)
    (channel,) = controller.display.channels
    channel = replace(channel, plant=replace(channel.plant, zeros=np.zeros(1)))
    controller = replace(controller, display=replace(controller.display, channels=(channel,)))
    measured = flat(0.9)
    plant = _corrected(controller, "index", measured)
    frequency = measured.frequency_hz
    predicted = db(np.abs(ChannelPrediction.of(controller, "index").felt(frequency)))
    off = db(np.abs(plant.response(frequency) / channel.plant.response(frequency))) - (measured.error_db - predicted)
    assert np.max(np.abs(off)) < 0.3  # the prefilter's own ripple is not followed to the last
    assert np.sum(plant.zeros == 0.0) == 1


def known_rig(monkeypatch, channel, display):
    """A rig whose one channel is known already."""
    known = SimpleNamespace(channel=channel, level=None, recording=None, usable=None, estimate=None)
    monkeypatch.setattr(chain, "_known", lambda *given: known)
    monkeypatch.setattr(chain, "_put_back", lambda rig, known: known)
    return SimpleNamespace(
        display=display, channels=("index",), without_sensor=(), feed_far_ahead=lambda: None, load=lambda made: None
    ), known


def test_calibrate__no_equaliser_at_all__raises_with_what_was_measured(monkeypatch):
    display = designed(0).display
    found = replace(display.channels[0], plant=replace(display.channels[0].plant, gain=3.0))
    rig, known = known_rig(monkeypatch, found, display)

    def never(display, channels):
        raise NoDesign("no prefilter of 16 poles")

    monkeypatch.setattr(chain, "_designed", never)
    with pytest.raises(NoEqualiser, match="no prefilter of 16 poles") as caught:
        calibrate(rig, CalibrationRequest((40.0, 300.0)), np.random.default_rng(0))
    assert caught.value.display.channels == (found,)
    assert caught.value.known == (known,)


def test_calibrate__no_equaliser_for_the_corrected_plant__what_was_measured_stands(monkeypatch):
    controller = designed(0)
    (channel,) = controller.display.channels
    rig, _ = known_rig(monkeypatch, channel, controller.display)
    designs = iter([controller])

    def once(display, channels):
        for made in designs:
            return made
        raise NoDesign("no prefilter of 16 poles")

    monkeypatch.setattr(chain, "_designed", once)
    monkeypatch.setattr(chain, "_measured", lambda *given: [flat(0.9)])
    made = calibrate(rig, CalibrationRequest((40.0, 300.0)), np.random.default_rng(0))
    assert made.controller is controller
    assert made.flat
    assert made.channels[0].rounds == 0
