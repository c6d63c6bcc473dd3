"""Feed-forward for a finger: the figures that a display gives, and the bounds on what it can do.

A load Z at the finger port changes H by T_load/T = 1/(1 + P S Z/B) of the unloaded loop. The command u_ff = Z yd / B,
with yd what the unloaded loop does with the same reference, takes that back exactly and is affine in the load, so that
two weights on the designed finger (mass; damping with stiffness) are enough, and no filter is switched.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import PREVIEW_MAX, FeedForward
from tactuator.model.description import Channel, Display
from tactuator.model.plant import Load
from tactuator.signals.decibels import from_db
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.synthesis.family import UNLOADED

LEARN_HZ = 1000.0
"""Rate at which a channel learns; a channel of a display learns in each sample's turn."""
WEIGHT_MAX = 1.6
"""Fingers have 0.5 to 1.5 times the designed one's figures."""
FORGETTING_S, FADING_S, SLEW_S = 0.02, 30.0, 0.018
GATE_DB_SL, RIDGE_DB_SL = 18.0, 0.0
"""Levels of a sinusoid: the memory is twice the shortest at the gate; at the ridge zero weighs as much as what is
heard."""
SHAPE = 0.05
MASS_FED = 0.7
"""Share of what the learnt mass takes that is fed forward: where all of it is, what is felt of speech passes 1 dB for
the first milliseconds after a finger is lifted (decision 0008)."""
_CORNER, _SLOW_HZ = 0.4, 8.0
"""Corners of what is learnt from: over the end of the band, and in hertz."""
_POINTS = 61
"""Frequencies over the band of which the median is taken."""
_WHOLE = 1e-9
"""Round-off of a delay in samples."""


def require_adaptive(display: Display, channel: Channel, *, is_looped: bool) -> int:
    """Return the samples from command to reading. Raises BadInput where a channel cannot be adaptive: no loop, no load,
    what is no second-order motor with a displacement sensor, a delay beyond the preview.

    Half a sample counts as one: a model half a sample early errs by 0.015 dB, one that is late by 0.05 dB.
    """
    where = f"channel {channel.name!r}: [touch] adaptive, "
    plant = channel.plant
    if not is_looped:
        raise BadInput(f"{where}and no loop (structure is 'none')", "a loop, which knows the position")
    if not channel.loads:
        raise BadInput(f"{where}and no load is described (loads)", "one to design for")
    if channel.quantity != "displacement" or plant.zeros.size or plant.poles.size != 2:
        raise BadInput(
            f"{where}and a plant of {plant.poles.size} poles and {plant.zeros.size} zeros to a {channel.quantity}",
            "2 poles, no zero, displacement",
        )
    if not np.all(plant.poles.real <= 0.0):
        raise BadInput(f"{where}and an unstable plant", "poles that do not grow")
    delay = display.delay_samples + math.floor(plant.delay_s * display.rate_hz + 0.5 + _WHOLE)
    if not 1 <= delay <= PREVIEW_MAX:
        raise BadInput(
            f"{where}and {delay} samples from command to reading",
            f"1 to {PREVIEW_MAX}, which is what the model looks ahead",
        )
    return delay


def design_feed_forward(display: Display, channel: Channel, loop: TwoDegreeLoop) -> FeedForward:
    """Return the model from which a channel feeds forward; loop: the designed one, unloaded and sampled.

    Raises BadInput where `require_adaptive` does.
    """
    delay = require_adaptive(display, channel, is_looped=loop.feedback is not None)
    poles = channel.plant.poles
    gain, damping, stiffness = channel.plant.gain, float(-np.sum(poles).real), float(np.prod(poles).real)
    load = channel.impedance(channel.loads[0]) * gain
    high = channel.threshold.band_hz[1]
    turns = max(1, round(display.rate_hz / LEARN_HZ))
    lines = [f for f in channel.environment.hum_hz if f < 0.4 * display.rate_hz / turns]
    draft = FeedForward(
        gain=gain,
        damping=damping,
        stiffness=stiffness,
        load=(float(load[0]), float(load[1]), float(load[2])),
        delay_samples=delay,
        turns=turns,
        corner_hz=_CORNER * high,
        slow_hz=_SLOW_HZ,
        forgetting_s=FORGETTING_S,
        gate_v=1.0,
        ridge_v=1.0,
        shape=SHAPE,
        fading_s=FADING_S,
        slew_s=SLEW_S,
        weight_max=WEIGHT_MAX,
        push_max_v=0.0,
        hum_hz=tuple(lines[:4]),
        mass_fed=MASS_FED,
    )
    heard_v = _heard_v(draft, channel, loop, display.rate_hz)
    most_v = WEIGHT_MAX * push_bound_v(draft, loop, display) * float(from_db(display.objectives.comfort_db_sl))
    return replace(
        draft,
        gate_v=heard_v * float(from_db(GATE_DB_SL)),
        ridge_v=heard_v * float(from_db(RIDGE_DB_SL)),
        push_max_v=min(most_v, channel.converter.range_v),
    )


def push_responses(model: FeedForward, loop: TwoDegreeLoop, frequency_hz: FloatArray) -> ComplexArray:
    """Return the two pushes, volts for a threshold unit of reference, at `frequency_hz` (n,): shape (2, n)."""
    s = 2j * np.pi * frequency_hz
    moved = loop.position_response(frequency_hz) / model.gain
    mass, damping, stiffness = model.load
    return np.array([mass * s**2 * moved, (damping * s + stiffness) * moved])


def load_weights(model: FeedForward, load: Load) -> FloatArray:
    """Return the weights, (2,), of the designed finger's mass and of its damping with stiffness that are nearest to a
    load, within what is allowed; nearest at frequencies where the damping is felt, not the stiffness.
    """
    mass, damping, _ = model.load
    nearest = [load.mass / mass if mass else 0.0, load.damping / damping if damping else 0.0]
    scale = model.gain / (load.per or model.gain)
    return np.asarray(np.clip(scale * np.array(nearest), 0.0, model.weight_max), dtype=np.float64)


def fed_push(
    model: FeedForward, free: TwoDegreeLoop, load: Load, frequency_hz: FloatArray, rate_hz: float
) -> ComplexArray:
    """Return what is fed forward under a load once its weights are found, at `frequency_hz` (n,): volts of command for
    a threshold unit, as early as the model knows it. free: the loop that the model knows.
    """
    shares = load_weights(model, load) * [model.mass_fed, 1.0]
    push = np.tensordot(shares, push_responses(model, free, frequency_hz), 1)
    advance = np.exp(2j * np.pi * frequency_hz * (model.delay_samples + 0.5) / rate_hz)
    return np.asarray(push * advance)


def adapted_response(
    model: FeedForward, free: TwoDegreeLoop, loaded: TwoDegreeLoop, load: Load, frequency_hz: FloatArray, rate_hz: float
) -> ComplexArray:
    """Return H under a load once its weights are found, at `frequency_hz` (n,): volts of y for a threshold unit.

    free: the loop that the model knows; loaded: the one that there is. A push meets the motor as a held command does,
    half a sample after its beginning.
    """
    assert loaded.feedback is not None
    push = fed_push(model, free, load, frequency_hz, rate_hz)
    through = loaded.feedback.load_sensitivity(frequency_hz)
    return np.asarray(loaded.position_response(frequency_hz) + through * push)


def fed_response(
    model: FeedForward | None,
    channel: Channel,
    free: TwoDegreeLoop,
    loaded: TwoDegreeLoop,
    load: str,
    frequency_hz: FloatArray,
    rate_hz: float,
) -> ComplexArray | None:
    """Return H under a load of the channel, by name, where it is fed forward; None where nothing is, or for no load."""
    if model is None or load == UNLOADED:
        return None
    return adapted_response(model, free, loaded, channel.load(load), frequency_hz, rate_hz)


def _heard_v(model: FeedForward, channel: Channel, loop: TwoDegreeLoop, rate_hz: float) -> float:
    """Return the rms of what a sinusoid at threshold pushes, seen through the three poles: the median over the band."""
    low = min(_SLOW_HZ, 0.5 * channel.threshold.band_hz[1])
    frequency = np.geomspace(low, channel.threshold.band_hz[1], _POINTS)
    d = np.exp(2j * np.pi * frequency / rate_hz) - 1.0
    corner = 2.0 * np.pi * model.corner_hz / rate_hz
    slow = 2.0 * np.pi * model.slow_hz / rate_hz
    seen = np.abs((corner / (d + corner)) ** 3 * d / (d + slow)) ** 2
    power = np.sum(np.abs(push_responses(model, loop, frequency)) ** 2, axis=0) * seen / 2.0
    return float(np.sqrt(np.median(power)))


def push_bound_v(model: FeedForward, loop: TwoDegreeLoop, display: Display) -> float:
    """Return the greatest sum of what is fed of both pushes, volts, that a reference within one threshold unit can
    bring about: the sum of the magnitudes of the impulse response."""
    # seconds of the impulse response that are summed
    count = 1 << int(np.ceil(np.log2(4.0 * display.rate_hz)))
    frequency = np.asarray(np.fft.rfftfreq(count, 1.0 / display.rate_hz), dtype=np.float64)
    frequency[0] = 1e-3 * frequency[1]
    response = np.tensordot([model.mass_fed, 1.0], push_responses(model, loop, frequency), 1)
    response[0] = response[0].real
    return float(np.sum(np.abs(np.fft.irfft(response, count))))
