"""Prediction of what is felt, against the continuous plant behind a hold."""

import numpy as np
import pytest

from tactuator.io.display import parse_display
from tactuator.measure.error import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.model.plant import DERIVATIVES
from tactuator.signals.decibels import db
from tactuator.speech.limiter import channel_limits
from tactuator.synthesis.design import design_controller

RATE_HZ = 48000.0


@pytest.fixture(scope="module", params=["velocity", "acceleration"])
def exciter(request: pytest.FixtureRequest) -> Controller:
    """An exciter with a mode at 90 Hz behind a card's high-pass at 8 Hz, whose sensor differentiates."""
    times = DERIVATIVES[request.param]
    w, pass_from = 2.0 * np.pi * 90.0, 2.0 * np.pi * 8.0
    poles = [*np.roots([1.0, w / 4.0, w * w]), -pass_from]
    plant = {
        "zeros": [[0.0, 0.0]] * (times + 1),
        "poles": [[pole.real, pole.imag] for pole in map(complex, poles)],
        "gain": 30.0,
    }
    return design_controller(
        parse_display(
            {
                "display": {"name": "exciter", "rate_hz": RATE_HZ, "delay_samples": 0},
                "threshold": {"curve": "bolanowski-1988", "band_hz": [10.0, 400.0]},
                "feedback": {"structure": "none"},
                "converter": {"range_v": 10.0},
                "channel": [
                    {"name": "exciter", "quantity": request.param, "sensor_gain_v_per_mm": 1e-3, "travel_mm": 2.0,
                     "plant": plant}
                ],
            }
        )
    )  # fmt: skip


def test_felt__sensor_that_differentiates__is_the_displacement_down_to_rest(exciter: Controller) -> None:
    """Found by a calibrated exciter whose speech came out 80 dB too soft: integrated after it was sampled, the response
    grew to 114 dB at 0 Hz."""
    channel = exciter.display.channel("exciter")
    prediction = ChannelPrediction.of(exciter, "exciter")
    hertz = np.array([0.001, 0.1, 1.0, 5.0, 10.0, 90.0, 250.0, 400.0])
    s = 2j * np.pi * hertz
    prefilter = exciter.channel("exciter").prefilter(RATE_HZ).response(hertz)
    moved = channel.plant.response(hertz) / s ** DERIVATIVES[channel.quantity] / channel.sensor_gain_v_per_mm
    truth = prefilter * moved * np.sinc(hertz / RATE_HZ) / channel.threshold.curve.displacement_mm(hertz)
    assert np.abs(prediction.felt(hertz)) == pytest.approx(np.abs(truth), rel=1e-4)


def test_limits__sensor_that_differentiates__leave_what_comfort_allows(exciter: Controller) -> None:
    limits = channel_limits(exciter, "exciter", 1 << 16)
    assert 50.0 < db(limits.peak) < 55.0
