"""Displays that the design's tests share: the examples of the documentation, built in place."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from tactuator.model.controller import Controller
from tactuator.model.description import Channel, Display
from tactuator.model.requirements import FeedbackRequirements, PrefilterRequirements
from tactuator.runtime.simulation import Simulation
from tactuator.signals.decibels import db
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis import paper
from tactuator.synthesis.design import design_controller
from tests.runtime.paper_display import FINGERS
from tests.runtime.paper_display import channel as finger

PAPER_LIMITS = FeedbackRequirements(
    phase_margin_deg=50.0,
    sensitivity_peak=1.405,
    mains_hz=(60.0, 120.0, 180.0),
    mains_max_db=(-11.94, -24.09, -31.19),
    rejection_hz=(10.0,),
    rejection_max_db=(-6.85,),
    command_noise_gain_max=30.0,
)
"""What the paper's C keeps, sampled at 4 kHz with a sample of delay (facts, section 1)."""

FINGER_LIMITS = replace(
    PAPER_LIMITS,
    sensitivity_peak=1.45,
    mains_max_db=(-11.0, -23.0, -30.0),
    rejection_hz=(1.0, 5.0, 10.0),
    rejection_max_db=(-23.5, -10.0, -4.4),
)


def channel(name: str = "index", **changes: Any) -> Channel:
    return finger(name, **({"feedback": FINGER_LIMITS} | changes))


def three_fingers(**changes: Any) -> Display:
    """The display of the paper with its siblings, loaded and unloaded."""
    made = Display(4000.0, tuple(channel(name) for name, *_ in FINGERS), 1, "three fingers")
    return replace(made, **changes)


def paper_alone(**changes: Any) -> Display:
    """The paper's plant alone, with the limits that the paper's C keeps."""
    return Display(4000.0, (channel(loads=(), feedback=PAPER_LIMITS, **changes),), 1, "paper")


def of(plant: ContinuousSystem, poles: int = 8, rate_hz: float = 4000.0, **changes: Any) -> Display:
    made = channel(plant=plant, loads=(), prefilter=PrefilterRequirements(poles), **changes)
    return Display(rate_hz, (made,), 1, "other")


def with_structure(display: Display, structure: str) -> Display:
    channels = (replace(one, feedback=replace(one.feedback, structure=structure)) for one in display.channels)
    return replace(display, channels=tuple(channels))


@cache
def three_finger_controller(poles: int = 8) -> Controller:
    return design_controller(three_fingers(), poles)


@cache
def paper_controller(poles: int = 4) -> Controller:
    """The paper's C on the paper's plant, with a prefilter of our own."""
    assert paper.PREFILTER_POLES == 4
    return design_controller(with_structure(paper_alone(), "paper"), poles)


def moved_db(controller: Controller, display: Display, hertz: float, level_db_sl: float) -> float:
    """Return how much further than asked the simulated display moves, by least squares on its true position."""
    simulation, seconds = Simulation(display, seed=1), max(2.0, 8.0 / hertz)
    simulation.load(controller)
    time = np.arange(round(seconds * display.rate_hz)) / display.rate_hz
    tone = 10.0 ** (level_db_sl / 20.0) * np.sin(2.0 * np.pi * hertz * time) * np.minimum(1.0, time / 0.2)
    moved = simulation.play(tone[:, None], None).displacement_mm[time.size // 2 :, 0]
    phase = 2.0 * np.pi * hertz * time[time.size // 2 :]
    parts = np.linalg.lstsq(np.column_stack([np.cos(phase), np.sin(phase), np.ones(phase.size)]), moved)[0]
    return float(db(np.hypot(*parts[:2]) / display.channels[0].threshold.curve.displacement_mm(hertz))) - level_db_sl
