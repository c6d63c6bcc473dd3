"""The display of the simulated card: an exciter drawn at random, with an accelerometer of 1 V for 1 m/s²."""

from __future__ import annotations

import numpy as np

from tactuator.io.display import parse_display
from tactuator.model.description import Display
from tactuator.rig.sound.demo.exciter import Exciter

RATE_HZ = 48000.0


def demo_exciter(rng: np.random.Generator) -> Exciter:
    """Return an exciter as one can buy: resonance 60 to 150 Hz, Q 2 to 8, a second mode, delay and high-pass."""
    resonance_hz = float(rng.uniform(60.0, 150.0))
    return Exciter(
        resonance_hz=resonance_hz,
        q=float(rng.uniform(2.0, 8.0)),
        drive=3e4,
        second_hz=resonance_hz * float(rng.uniform(2.0, 4.0)),
        hardening=0.2,
        delay_s=float(rng.uniform(0.002, 0.02)),
        sensor_full_scale=1e5,
    )


def demo_display(exciter: Exciter) -> Display:
    """Return its display, whose plant is a rough guess: the calibration finds it anew."""
    document = {
        "display": {"name": "simulated exciter", "rate_hz": RATE_HZ, "delay_samples": 0},
        "threshold": {"curve": "bolanowski-1988", "band_hz": [10.0, 400.0]},
        "feedback": {"structure": "none"},
        "converter": {"range_v": exciter.volts},
        "sound": {
            "output_full_scale_v": exciter.volts,
            "input_full_scale_v": 1e-3 * exciter.sensor_full_scale,
            "lead_s": 0.5,
        },
        "channel": [
            {
                "name": "exciter",
                "sensor_gain_v_per_mm": 1e-3,
                "quantity": "acceleration",
                "travel_mm": 1.0,
                "plant": {"num": [1.0], "den": [1.0, 100.0, 1e6]},
            }
        ],
    }
    return parse_display(document)
