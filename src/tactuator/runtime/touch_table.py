"""Figures of the core's feed-forward for a finger (core/touch/feed_forward.h), from a controller's model."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController, FeedForward
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.coefficients import FEEDBACK_SECTIONS_MAX, delta_coefficients_single
from tactuator.signals.discretise import matrix_exponential

FORGETTING_MAX = 0.999 / lib.TACT_TOUCH_LEVEL_RATE
"""Share of the memory that is forgotten in a turn, at most: the level beside it follows that many times sooner."""


def _figures(channel: ChannelController, rate_hz: float, place: int) -> tuple[bytes, dict[str, Any]]:
    """Return the counts of `tact_touch` (delay, turns, turn, lines of hum), and its figures by name in the order of an
    image, rounded to float32. Raises BadInput for what the core cannot hold.
    """
    model = channel.feed_forward
    assert model is not None
    where = f"controller, channel {channel.name!r}: touch: "
    if channel.feedback_sos is None:
        raise BadInput(f"{where}there is no feedback", "a controller with a loop")
    if len(model.hum_hz) > lib.TACT_TOUCH_HUM_MAX:
        raise BadInput(f"{where}{len(model.hum_hz)} lines of hum", f"at most {lib.TACT_TOUCH_HUM_MAX}")
    sections = delta_coefficients_single(channel.feedback_sos, FEEDBACK_SECTIONS_MAX, f"{where}feedback")
    if not 1 <= model.turns <= 255:
        raise BadInput(f"{where}turns is {model.turns}", "1 to 255")
    period_s, turn_s = 1.0 / rate_hz, model.turns * (1.0 / rate_hz)
    figures = _poles(model, period_s) | {
        "slow": 2.0 * np.pi * model.slow_hz * turn_s,
        "forgetting": min(turn_s / model.forgetting_s, FORGETTING_MAX),
        "gate": model.gate_v**2,
        "ridge": model.ridge_v**2,
        "shape": model.shape,
        "fading": turn_s / model.fading_s,
        "slew": turn_s / model.slew_s,
        "weight_max": model.weight_max,
        "push_max_v": model.push_max_v,
        "hum_gain": 4.0 * np.pi * model.hum_band_hz * turn_s,
    }
    if not all(np.all(np.abs(value) <= float(np.finfo(np.float32).max)) for value in figures.values()):
        raise BadInput(f"{where}a figure is beyond single precision", "what it holds")
    angles = 2.0 * np.pi * np.array(model.hum_hz, dtype=np.float64) * model.turns / rate_hz
    hum = np.stack([np.cos(angles), np.sin(angles)], axis=1).astype(np.float32)
    counts = bytes([model.delay_samples, model.turns, place % model.turns, len(hum)])
    return counts, {name: np.float32(value) for name, value in figures.items()} | {"feedback": sections, "hum": hum}


def _pushes(model: FeedForward, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return what the designed finger's two pushes are, volts for a volt of command, of change in a sample, of place.

    The place is taken half a sample on, in the middle of a change.
    """
    mass, damping, stiffness = model.load
    drag, spring = model.damping / model.gain / period_s, model.stiffness / model.gain
    rest = np.array([damping / model.gain / period_s + 0.5 * stiffness / model.gain, stiffness / model.gain])
    return mass * np.array([1.0, drag + 0.5 * spring, spring]), rest


def _poles(model: FeedForward, period_s: float) -> dict[str, Any]:
    """Return how the three poles G = c/(d + c), d = z - 1, are fed and summed.

    Of the held plant B/A with B = b1 d + b, the balance is G^3 (B u - A y)/b. Since d G = c (1 - G), B G^3 and A G^3
    are sums of G, G^2 and G^3: u and y are fed into the third, second and first pole with these shares. The model's
    position yd passes G^3; the pushes are sums of its c^2 (1 - G)^2 G, c (1 - G) G^2 and G^3, since A yd = B ud.
    """
    b1, b, a1, a2 = held_second_order(model, period_s)
    corner = 2.0 * np.pi * model.corner_hz * period_s
    lead = corner * b1 / b
    inverse = np.array([corner * corner, corner * a1, a2]) / b
    inverted = np.array([inverse[0], inverse[1] - 2.0 * inverse[0], inverse[0] - inverse[1] + inverse[2]])
    change = np.array([lead, 1.0, 0.0]) * corner
    place = np.array([0.0, lead, 1.0])
    mass, rest = _pushes(model, period_s)
    return {
        "plant": np.array([b1, b, a1, a2]),
        "corner": corner,
        "command": corner * np.array([lead, 1.0 - lead]),
        "position": corner * inverted,
        "mass": model.mass_fed * mass,
        "rest": rest,
        "first": mass[0] * inverse - mass[1] * change - mass[2] * place,
        "second": rest[0] * change + rest[1] * place,
    }


def held_second_order(model: FeedForward, period_s: float) -> FloatArray:
    """Return b1, b1 + b0, a1', a2' of the held plant (b1 z + b0)/(d^2 + a1' d + a2') with d = z - 1, shape (4,)."""
    a = np.array([[0.0, 1.0, 0.0], [-model.stiffness, -model.damping, model.gain], [0.0, 0.0, 0.0]]) * period_s
    less_one = matrix_exponential(a) - np.eye(3)
    m, b = less_one[:2, :2], less_one[:2, 2]
    return np.array([b[0], m[0, 1] * b[1] - m[1, 1] * b[0], -np.trace(m), np.linalg.det(m)])


def touch_bytes(channel: ChannelController, rate_hz: float, place: int) -> bytes:
    """Return the part of an image that says how a channel feeds forward; nothing where it does not.

    place: the channel's, so that the channels learn in turn. Raises BadInput for what the core cannot hold.
    """
    if channel.feed_forward is None:
        return b""
    counts, figures = _figures(channel, rate_hz, place)
    return counts + np.concatenate([np.ravel(value) for value in figures.values()]).astype("<f4").tobytes()


def touch_table(channel: ChannelController, rate_hz: float, place: int) -> Any:
    """Return the `tact_touch` of a channel; one whose feedback_count is zero where nothing is fed forward.

    Raises as `touch_bytes` does.
    """
    table = ffi.new("tact_touch *")
    if channel.feed_forward is None:
        return table
    (table.delay, table.turns, table.turn, table.hum_count), figures = _figures(channel, rate_hz, place)
    table.feedback_count = len(figures["feedback"])
    for section, row in zip(table.feedback, figures.pop("feedback").tolist(), strict=False):
        section.b0, section.b1, section.b2, section.a1, section.a2 = row
    for line, row in zip(table.hum, figures.pop("hum").tolist(), strict=False):
        line[0], line[1] = row
    for name, value in figures.items():
        setattr(table, name, value.tolist())
    if not lib.tact_touch_settle(table):
        raise BadInput(f"controller, channel {channel.name!r}: touch: its counts cannot be run", "as designed")
    return table
