"""Design: processor seconds for three channels, loops and prefilters, beside a peer that fits one prefilter only.

The peer is what one would do without the linear programs: scipy's least squares on the corners of the same number of
poles and zeros, from one start, in the same continuous-to-sampled setting; its greatest error is beside ours.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import optimize

from tactuator.model.description import Channel, Display, Threshold
from tactuator.model.plant import Load
from tactuator.model.requirements import FeedbackRequirements
from tactuator.perception.curve import curve
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis import paper
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.prefilter import bare_loop, fit_prefilter, prefilter_goal

RATE_HZ = 4000.0
POLES = 8
LIMITS = FeedbackRequirements(
    mains_hz=(60.0, 120.0, 180.0),
    mains_max_db=(-11.0, -23.0, -30.0),
    rejection_hz=(1.0, 5.0, 10.0),
    rejection_max_db=(-23.5, -10.0, -4.4),
)
FINGERS = {
    "index": (0.19898, 2875.0, 94.0, 290.0, Load("finger", 0.12, 31.0, 360.0)),
    "thumb": (0.2012, 2650.0, 101.0, 310.0, Load("finger", 0.15, 38.0, 420.0)),
    "middle": (0.1967, 3020.0, 88.0, 275.0, Load("finger", 0.11, 28.0, 340.0)),
}


def best_cpu_s(work: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Processor seconds of the quickest of several runs, and what the last one gave."""
    times, result = [], None
    for _ in range(repeats):
        start = time.process_time()
        result = work()
        times.append(time.process_time() - start)
    return min(times), result


def display() -> Display:
    channels = []
    for name, (gain, lead, damping, stiffness, load) in FINGERS.items():
        plant = ContinuousSystem.from_polynomials([lead], [1.0, damping, stiffness])
        threshold = Threshold(curve("bolanowski-1988"))
        channels.append(Channel(name, gain, 12.5, plant, threshold=threshold, loads=(load,), feedback=LIMITS))
    return Display(RATE_HZ, tuple(channels), 1, "three fingers")


def family(members: int) -> Display:
    """Return a display of one channel that may be free or loaded in members - 1 ways."""
    index = display().channels[0]
    each = [Load(f"load {k}", 0.02 + 0.004 * k, 10.0 + 0.7 * k, 50.0 + 10.0 * k) for k in range(members - 1)]
    return Display(RATE_HZ, (replace(index, loads=tuple(each)),), 1, "family")


def peer(channel: Channel) -> float:
    """Greatest error (dB) of least squares on real corners, from one start."""
    plant = discretise(channel.plant, RATE_HZ, "zoh", 1)
    goal = prefilter_goal(channel, bare_loop(discretise(paper.FEEDBACK, RATE_HZ, "bilinear"), plant), RATE_HZ)
    inside = goal.allowance_db == 0.0
    frequency, level = goal.frequency_hz[inside], goal.level_db[inside]

    def miss(logs: Any) -> Any:
        corners = np.exp(-2.0 * np.pi * np.exp(logs[:-1]) / RATE_HZ)
        system = SampledSystem(corners[:POLES], corners[POLES:], 1.0, RATE_HZ)
        return db(system.response(frequency)) + logs[-1] - level

    corners = np.log(np.geomspace(1.0, 300.0, POLES))
    found = optimize.least_squares(miss, np.concatenate([corners + 0.1, corners, [0.0]])).fun
    return float(np.ptp(found) / 2.0)


def run() -> dict[str, object]:
    shown = display()
    design_s, controller = best_cpu_s(lambda: design_controller(shown, POLES), 3)
    index = shown.channels[0]
    feedback = discretise(paper.FEEDBACK, RATE_HZ, "bilinear")
    prefilter_s, fit = best_cpu_s(lambda: fit_prefilter(index, feedback, RATE_HZ, 1, POLES), 3)
    peer_s, peer_db = best_cpu_s(lambda: peer(index), 1)
    alone_s, _ = best_cpu_s(lambda: design_controller(family(1), POLES), 2)
    family_s, _ = best_cpu_s(lambda: design_controller(family(64), POLES), 2)
    worst = max(one.report["prefilter"]["max_error_db"] for one in controller.channels)
    return {
        "three_channels": {"seconds": design_s, "worst_prefilter_error_db": worst},
        "one_prefilter": {"seconds": prefilter_s, "max_error_db": fit.max_error_db},
        "family_of_64": {"seconds": family_s, "times_family_of_1": family_s / alone_s, "goal_seconds": 1.5},
        "scipy_least_squares": {"seconds": peer_s, "max_error_db": peer_db},
        "goals": {"three_channels_seconds": 1.0, "max_error_db": 0.25},
    }
