"""The paper's display of one finger and its controller, and what its sampled loop must answer."""

from dataclasses import replace

import numpy as np

from tactuator.model.controller import Controller
from tactuator.model.description import Display, Environment
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.discretise import discretise
from tests.runtime import paper_display
from tests.runtime.paper_display import RATE_HZ, controller

PLANT = paper_display.channel().plant
QUIET = replace(paper_display.QUIET, noise_v_rms=0.2e-3)
STANDARD = Environment()


def display(environment: Environment = STANDARD) -> Display:
    return replace(paper_display.display(paper_display.channel(environment=environment)), name="paper")


FULL, QUIETER = controller(display()), controller(display(QUIET))
"""With everything that disturbs, and with little noise alone."""


def loop_response(made: Controller, frequency_hz):
    """(H, S), sampled, with one sample of delay."""
    feedback = made.channels[0].feedback(RATE_HZ)
    late = np.exp(-2j * np.pi * frequency_hz / RATE_HZ)
    loop = feedback.response(frequency_hz) * late * discretise(PLANT, RATE_HZ, "zoh").response(frequency_hz)
    sensitivity = 1.0 / (1.0 + loop)
    return made.channels[0].prefilter(RATE_HZ).response(frequency_hz) * loop * sensitivity, sensitivity


def loaded(made: Controller, seed: int) -> SimulatedRig:
    rig = SimulatedRig(made.display, seed)
    rig.load(made)
    return rig
