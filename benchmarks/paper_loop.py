"""The paper's channel as benchmarks play it: at 4 kHz, F of 4th order, C of 2nd, the motor, one sample of delay."""

from __future__ import annotations

import numpy as np

from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Channel, Display
from tactuator.signals.discretise import discretise
from tactuator.signals.systems import ContinuousSystem

RATE_HZ = 4000.0
THRESHOLD_V = 0.004
MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
FEEDBACK = ContinuousSystem.from_polynomials(12.264 * np.array([1.0, 111.0, 530.0]), [1.0, 260.0, 0.0])
PREFILTER = ContinuousSystem.from_polynomials(
    565.49 * THRESHOLD_V * np.array([1.0, 199.81, 17923.0, 1.786e5]), [1.0, 1420.0, 336711.0, 1.12e7, 1.01e8]
)


def paper_controller(display: Display) -> Controller:
    prefilter, feedback = (discretise(system, RATE_HZ, "bilinear").sections() for system in (PREFILTER, FEEDBACK))
    channel = ChannelController("index", THRESHOLD_V, prefilter, feedback, AntiWindup((0.01, 0.001)), Limits(10.0, 2.4))
    return Controller(display, (channel,))


def paper_display() -> Display:
    channel = Channel("index", 0.19898, 12.5, MOTOR)
    return Display(RATE_HZ, (channel,), 1, "benchmark")
