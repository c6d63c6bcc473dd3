"""Round-off and limit cycles: one channel's loop with the core's controller, and the same loop in double precision.

The plant is the sampled one in double precision, without noise, friction or converters; both loops have the rounded
coefficients of the image, so that their difference is the round-off of float32 alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from operator import mul

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import ChannelController
from tactuator.model.description import Channel, Display
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.tables import controller_table
from tactuator.signals.discretise import held_state_space

Step = Callable[[float, float], float]
"""Reference (threshold units) and position (V) of a sample to its command (V)."""

_SETTLE_S, _LISTEN_S = (0.5, 1.0), 0.5
"""Seconds until a run and its silence have settled, and seconds then looked at."""


def single_step(controller: ChannelController, rate_hz: float) -> Step:
    """Return a channel's F and C at rest, as the core steps them."""
    table, _ = controller_table(replace(controller, feed_forward=None, strength=None), rate_hz, 0)
    state = ffi.new("tact_controller_state *")
    return lambda reference, position: float(lib.tact_controller_step(table, state, reference, position))


def double_step(prefilter: FloatArray, feedback: FloatArray | None) -> Step:
    """Return F and C at rest in double precision, without limits; each an array (n, 5) of sections in d = z - 1."""
    first = _Sections(prefilter)
    if feedback is None:
        return lambda reference, _: first(reference)
    second = _Sections(feedback)
    return lambda reference, position: second(first(reference) - position)


class _Sections:
    """A cascade in delta form, as core/arithmetic/section.h draws it."""

    def __init__(self, rows: FloatArray) -> None:
        self._rows = [tuple(map(float, row)) for row in rows]
        self._states = [[0.0, 0.0] for _ in rows]

    def __call__(self, value: float) -> float:
        for (b0, b1, b2, a1, a2), state in zip(self._rows, self._states, strict=True):
            out = b0 * value + state[0]
            state[0] += b1 * value - a1 * out + state[1]
            state[1] += b2 * value - a2 * out
            value = out
        return value


def run_loop(channel: Channel, display: Display, step: Step, reference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return position and command (n,), V, of the sampled plant with `step` around it; the display's delay and the
    plant's dead time between them.
    """
    a, b, c, through, whole = held_state_space(channel.plant, display.rate_hz)
    rows, drive, seen = a.tolist(), b.tolist(), c.tolist()
    state, queue = [0.0] * len(drive), deque([0.0] * (display.delay_samples + whole))
    positions, commands = [], []
    for wanted in reference.tolist():
        position = sum(map(mul, seen, state)) + (through * queue[0] if queue else 0.0)
        queue.append(step(wanted, position))
        positions.append(position)
        commands.append(queue[-1])
        held = queue.popleft()
        state = [sum(map(mul, row, state)) + gain * held for row, gain in zip(rows, drive, strict=True)]
    return np.array(positions), np.array(commands)


def roundoff_reference(rate_hz: float, level: float) -> tuple[FloatArray, slice, slice]:
    """Return a tone of `level` upon a constant of `level`, then silence; and where round-off and limit cycles show."""
    listen = round(_LISTEN_S * rate_hz)
    first, silent = (round(settle_s * rate_hz) + listen for settle_s in _SETTLE_S)
    # no divisor of a usual rate, so that no two periods round alike
    tone = level * np.sin(2.0 * np.pi * 37.0 * np.arange(first) / rate_hz)
    reference = np.concatenate([level + tone, np.zeros(silent)])
    return reference, slice(first - listen, first), slice(first + silent - listen, first + silent)


def felt_db_sl(error_v: FloatArray, channel: Channel, rate_hz: float) -> float:
    """Return the level, as it is felt (dB SL), of a stretch of y's error: its spectrum over the band, each line over
    its threshold; the sinusoid of the same rms. -300 where nothing is left.
    """
    spectrum = np.fft.rfft((error_v - np.mean(error_v)) * np.hanning(error_v.size)) / error_v.size
    frequency = np.fft.rfftfreq(error_v.size, 1.0 / rate_hz)
    low, high = channel.threshold.band_hz
    inside = (frequency >= low) & (frequency <= high)
    felt = np.abs(spectrum[inside]) / channel.threshold_voltage(frequency[inside])
    power = 2.0 * float(np.sum(felt**2)) / 0.375  # the window's mean square
    return float(10.0 * np.log10(max(2.0 * power, 1e-30)))
