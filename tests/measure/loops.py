"""The paper's display and controller, and what its sampled loop must answer."""

from dataclasses import replace

import numpy as np

from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Channel, Display, Environment, Threshold
from tactuator.model.plant import Load
from tactuator.perception.curve import curve
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.systems import ContinuousSystem

RATE_HZ = 4000.0
PLANT = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
FEEDBACK = ContinuousSystem.from_polynomials(12.264 * np.array([1.0, 111.0, 530.0]), [1.0, 260.0, 0.0])
PREFILTER = ContinuousSystem.from_polynomials(
    565.49 * np.array([1.0, 199.81, 17923.0, 1.786e5]), [1.0, 1420.0, 336711.0, 1.12e7, 1.01e8]
)
QUIET = Environment(hum_hz=(), hum_v_peak=(), noise_v_rms=0.2e-3, friction_v=0.0)


STANDARD = Environment()


def display(environment: Environment = STANDARD) -> Display:
    channel = Channel(
        "index", "index", 0.19898, 12.5, PLANT, Threshold(curve("bolanowski-1988")),
        loads=(Load("finger", 0.12, 31.0, 360.0),), environment=environment,
    )  # fmt: skip
    return Display("paper", RATE_HZ, 1, (channel,))


def controller(described: Display) -> Controller:
    volts = float(described.channels[0].threshold_voltage(0.4))
    prefilter = ContinuousSystem(
        PREFILTER.zeros, PREFILTER.poles, PREFILTER.gain * volts / abs(PREFILTER.response(0.0))
    )
    return Controller(
        described,
        (
            ChannelController(
                "index",
                volts,
                bilinear(prefilter, RATE_HZ).sections(),
                bilinear(FEEDBACK, RATE_HZ).sections(),
                AntiWindup(),
                Limits(10.0, 2.4),
            ),
        ),
    )


def loop_response(made: Controller, frequency_hz):
    """(H, S), sampled, with one sample of delay."""
    feedback = made.channels[0].feedback(RATE_HZ)
    assert feedback is not None
    late = np.exp(-2j * np.pi * frequency_hz / RATE_HZ)
    loop = feedback.response(frequency_hz) * late * zero_order_hold(PLANT, RATE_HZ).response(frequency_hz)
    sensitivity = 1.0 / (1.0 + loop)
    return made.channels[0].prefilter(RATE_HZ).response(frequency_hz) * loop * sensitivity, sensitivity


def quiet() -> tuple[Display, Controller]:
    described = display(QUIET)
    return described, controller(described)


def full() -> tuple[Display, Controller]:
    described = display()
    return described, controller(replace(described))


def loaded(made: Controller, seed: int) -> SimulatedRig:
    rig = SimulatedRig(made.display, seed)
    rig.load(made)
    return rig
