"""The closed loop: how fast the core simulates it, beside what else one would use.

The work: one channel at 4 kHz, blocks of 4000 samples: the paper's F (4th order) and C (2nd), motor (2nd), one sample
of delay. The core does all of it with friction, noise, hum, converters and limits; so does the plain Python loop, in
double precision; `scipy.signal.dlsim` and `control.forced_response` do the linear part alone. Every time is the best
of many short ones on one core, so that a busy machine disturbs little; the ratios are those of this run.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Channel, Display, Threshold
from tactuator.perception.curve import curve
from tactuator.rig.simulated import SimulatedRig
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.simulation import Simulation, empty_block
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.systems import ContinuousSystem

RATE_HZ = 4000.0
SAMPLES = 4000
THRESHOLD_V = 0.004
MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
FEEDBACK = ContinuousSystem.from_polynomials(12.264 * np.array([1.0, 111.0, 530.0]), [1.0, 260.0, 0.0])
PREFILTER = ContinuousSystem.from_polynomials(
    565.49 * THRESHOLD_V * np.array([1.0, 199.81, 17923.0, 1.786e5]), [1.0, 1420.0, 336711.0, 1.12e7, 1.01e8]
)

Work = Callable[[], Any]


def best_s(work: Work, repeats: int) -> float:
    """Seconds of the quickest of several runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def paper_controller(display: Display) -> Controller:
    sections = (bilinear(PREFILTER, RATE_HZ).sections(), bilinear(FEEDBACK, RATE_HZ).sections())
    channel = ChannelController("index", THRESHOLD_V, *sections, AntiWindup((0.01, 0.001)), Limits(10.0, 2.4))
    return Controller(display, (channel,))


def paper_display() -> Display:
    channel = Channel("index", "index", 0.19898, 12.5, MOTOR, Threshold(curve("bolanowski-1988")))
    return Display("benchmark", RATE_HZ, 1, (channel,))


def linear_system() -> tuple[NDArray[np.float64], ...]:
    """y/r of the linear part as one discrete state space (a, b, c, d): what dlsim and forced_response take."""
    plant = zero_order_hold(MOTOR, RATE_HZ)
    loop = control.ss(*_state_space(plant.sections())) * control.ss(
        *_state_space(bilinear(FEEDBACK, RATE_HZ).sections())
    )
    delayed = loop * control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]], 1.0 / RATE_HZ)
    closed = control.feedback(delayed, 1) * control.ss(*_state_space(bilinear(PREFILTER, RATE_HZ).sections()))
    return closed.A, closed.B, closed.C, closed.D


def _state_space(sos: NDArray[np.float64]) -> tuple[Any, ...]:
    return (*signal.zpk2ss(*signal.sos2zpk(sos)), 1.0 / RATE_HZ)


def python_loop(reference: list[float]) -> list[float]:
    """The whole loop as one would write it in Python: sections, converters, friction, noise, hum."""
    f = [_delta(row) for row in bilinear(PREFILTER, RATE_HZ).sections()]
    c = [_delta(row) for row in bilinear(FEEDBACK, RATE_HZ).sections()]
    states = [[0.0, 0.0] for _ in (*f, *c)]
    (a11, a12, a21, a22), (b1, b2) = _held_motor()
    noise = np.random.default_rng(0).normal(0.0, 0.2e-3, len(reference)).tolist()
    x1 = x2 = delayed = force = before = 0.0
    felt = []
    for k, r in enumerate(reference):
        position = 2875.0 * x1
        moved = position - before
        force = (force + 0.4 * moved) / (1.0 + abs(moved) / 10e-3)
        before = position
        angle = 2.0 * math.pi * 60.0 * k / RATE_HZ
        hum = 1e-3 * math.sin(angle) + 3e-4 * math.sin(2.0 * angle) + 2e-4 * math.sin(3.0 * angle)
        code = max(-32768, min(32767, round((position + noise[k] + hum) * 3276.8)))
        value = r
        for section, state in zip(f, states, strict=False):
            value = _section(section, state, value)
        value -= code / 3276.8
        for section, state in zip(c, states[len(f) :], strict=True):
            value = _section(section, state, value)
        command = max(-10.0, min(10.0, value))
        states[-1][0] += 0.01 * (command - value)
        states[-1][1] += 0.001 * (command - value)
        put_out, delayed = delayed, max(-32768, min(32767, round(command * 3276.8))) / 3276.8
        total = put_out - force
        x1, x2 = a11 * x1 + a12 * x2 + b1 * total, a21 * x1 + a22 * x2 + b2 * total
        felt.append(position)
    return felt


def _delta(row: NDArray[np.float64]) -> tuple[float, ...]:
    b0, b1, b2, _, a1, a2 = row.tolist()
    return b0, 2.0 * b0 + b1, b0 + b1 + b2, 2.0 + a1, 1.0 + a1 + a2


def _section(section: tuple[float, ...], state: list[float], x: float) -> float:
    b0, b1, b2, a1, a2 = section
    y = b0 * x + state[0]
    state[0] += b1 * x - a1 * y + state[1]
    state[1] += b2 * x - a2 * y
    return y


def _held_motor() -> tuple[tuple[float, ...], tuple[float, float]]:
    a, b = np.array([[0.0, 1.0], [-290.0, -94.0]]), np.array([[0.0], [1.0]])
    ad, bd, *_ = signal.cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), 1.0 / RATE_HZ, "zoh")
    return tuple(ad.ravel().tolist()), (float(bd[0, 0]), float(bd[1, 0]))


def peers(reference: NDArray[np.float64]) -> dict[str, Work]:
    """What each peer has to do."""
    a, b, c, d = linear_system()
    discrete = signal.dlti(a, b, c, d, dt=1.0 / RATE_HZ)
    state_space = control.ss(a, b, c, d, 1.0 / RATE_HZ)
    return {
        "plain_python": partial(python_loop, reference.tolist()),
        "scipy_dlsim": partial(signal.dlsim, discrete, reference),
        "control_forced_response": partial(control.forced_response, state_space, U=reference),
    }


def block_api_over_core(display: Display, controller: Controller) -> dict[str, float]:
    """Share of time that a block on three channels takes in `SimulatedRig.play` beyond the core's own function.

    The core gets its arrays ready made; the rig checks and copies the reference, and gives a trace of its own.
    Both in turn, so that a busy machine disturbs both.
    """
    three = Display("benchmark", RATE_HZ, 1, tuple(replace(display.channels[0], name=name) for name in "abc"))
    loaded = Controller(three, tuple(replace(controller.channels[0], name=name) for name in "abc"))
    rig, simulation = SimulatedRig(three, seed=1), Simulation(three, seed=1)
    rig.load(loaded)
    simulation.load(loaded)
    shares = {}
    for seconds in (0.1, 1.0, 10.0):
        samples = round(seconds * RATE_HZ)
        reference = np.tile(10.0 * np.sin(2.0 * np.pi * 10.0 * np.arange(samples) / RATE_HZ)[:, None], 3)
        _filled, trace = empty_block(samples, 3)  # kept: the trace points into the block
        rows = ffi.from_buffer("double[]", reference)
        bare = partial(lib.tact_closed_loop_play, simulation._loops, 3, rows, ffi.NULL, trace, samples)
        turns = 300 if seconds < 10.0 else 30
        times = [(best_s(bare, 3), best_s(partial(rig.play, reference), 3)) for _ in range(turns)]
        core_s, rig_s = (min(each) for each in zip(*times, strict=True))
        shares[f"{seconds:g} s"] = rig_s / core_s - 1.0
    return shares


def run() -> dict[str, object]:
    """Figures of the closed loop: million loop samples per second, and ratios to the peers."""
    display = paper_display()
    controller = paper_controller(display)
    reference = 10.0 * np.sin(2.0 * np.pi * 10.0 * np.arange(SAMPLES) / RATE_HZ)
    simulation = Simulation(display, seed=1)
    simulation.load(controller)
    core_s = best_s(partial(simulation.play, reference[:, None]), 300)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        peer_s = {name: best_s(work, 25) for name, work in peers(reference).items()}
    return {
        "loop_samples_million_per_s": SAMPLES / core_s / 1e6,
        "single_loop_times_peer": {name: seconds / core_s for name, seconds in peer_s.items()},
        "block_api_over_core": block_api_over_core(display, controller),
        "goals": {
            "loop_samples_million_per_s": 20.0,
            "times_control_forced_response": 500.0,
            "block_api_over_core": 0.05,
        },
    }
