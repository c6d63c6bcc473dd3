"""An exciter on a simulated sound card, its controller, and the study that tests run on it from start to end."""

import numpy as np

from tactuator.model.controller import Controller
from tactuator.synthesis.design import design_controller
from tests.rig.sound.exciter import Exciter
from tests.rig.sound.turned_card import sound_display

RATE_HZ = 48000.0
EXCITER = Exciter(resonance_hz=90.0, q=4.0, drive=3e4, second_share=0.0, delay_s=0.003, noise=0.0, hum=0.0)


def controller(latency_samples: int) -> Controller:
    """Designed for the exciter's own equations, with its displacement as the sensor."""
    w = 2.0 * np.pi * EXCITER.resonance_hz
    plant = {"num": [EXCITER.drive], "den": [1.0, w / EXCITER.q, w * w], "delay_s": EXCITER.delay_s}
    channel = {"finger": "index", "input": 3, "sensor_gain_v_per_mm": 1.0, "plant": plant}
    tables = {"threshold": {"curve": "bolanowski-1988", "band_hz": [40.0, 300.0]}, "prefilter": {"poles": 8}}
    scale = {"output_full_scale_v": EXCITER.volts, "input_full_scale_v": EXCITER.felt_full_scale_mm}
    sound = {"lead_s": 2.0, "latency_samples": latency_samples}
    return design_controller(sound_display(["index"], RATE_HZ, EXCITER.volts, channel, tables, **scale, **sound))
