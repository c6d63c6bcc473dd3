"""Round-off and limit cycles: one channel's loop stepped in the arithmetic of a number format.

The plant is the sampled one in double precision, without noise, friction or converters, and the same loop is stepped in
double precision with the format's own rounded coefficients: what is left over is the arithmetic's alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from operator import mul

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel, Display
from tactuator.signals.discretise import held_state_space

Step = Callable[[float, float], float]

_SETTLE_S, _LISTEN_S = (0.5, 1.0), 0.5
_TONE_HZ = 37.0


def double_step(prefilter: FloatArray, feedback: FloatArray | None, most_v: float) -> Step:
    """Return a function (reference, position) -> command in double precision, of rows in d, within most_v volts."""
    first = _Double(prefilter)
    second = None if feedback is None else _Double(feedback)

    def step(reference: float, position: float) -> float:
        wanted = first(reference)
        if second is not None:
            wanted = second(wanted - position)
        return max(-most_v, min(most_v, wanted))

    return step


class _Double:
    """A cascade in delta form, double precision."""

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


def run_loop(channel: Channel, display: Display, step: Step, reference: FloatArray) -> FloatArray:
    """Return y (n,), volts, of the sampled plant with `step` around it; the display's delay and the plant's dead time
    between them.
    """
    whole, fraction = whole_delay(channel, display)
    a, b, c, d = held_state_space(channel.plant, 1.0 / display.rate_hz, fraction)
    rows, drive, seen = a.tolist(), b.tolist(), c.tolist()
    if len(drive) == 2:
        return _run_second_order(rows, drive, seen, d, whole, step, reference)
    state, queue = [0.0] * len(drive), [0.0] * whole
    position = []
    for value in reference.tolist():
        held = queue[0] if queue else 0.0
        y = sum(map(mul, seen, state)) + d * held
        position.append(y)
        queue.append(step(value, y))
        held = queue.pop(0)
        state = [sum(map(mul, row, state)) + gain * held for row, gain in zip(rows, drive, strict=True)]
    return np.array(position)


def whole_delay(channel: Channel, display: Display) -> tuple[int, float]:
    """Return the samples by which the command is late, the display's and the plant's, and what is left of a sample."""
    samples = channel.plant.delay_s * display.rate_hz
    whole = int(samples + 1e-9)
    fraction = samples - whole
    return display.delay_samples + whole, fraction if fraction > 1e-9 else 0.0


def _run_second_order(
    rows: list[list[float]],
    drive: list[float],
    seen: list[float],
    through: float,
    delay_samples: int,
    step: Step,
    reference: FloatArray,
) -> FloatArray:
    """Return what `run_loop` returns, of a plant with two states; most have two, and it is twice as quick."""
    ((a11, a12), (a21, a22)), (b1, b2), (c1, c2) = rows, drive, seen
    x1 = x2 = 0.0
    queue = deque([0.0] * delay_samples)
    position = []
    for value in reference.tolist():
        y = c1 * x1 + c2 * x2 + through * (queue[0] if queue else 0.0)
        position.append(y)
        queue.append(step(value, y))
        held = queue.popleft()
        x1, x2 = a11 * x1 + a12 * x2 + b1 * held, a21 * x1 + a22 * x2 + b2 * held
    return np.array(position)


def roundoff_reference(rate_hz: float, level: float) -> tuple[FloatArray, slice, slice]:
    """Return a tone of `level` upon a constant of `level`, then silence; and the stretches to be examined for round-off
    and for limit cycles.
    """
    listen = round(_LISTEN_S * rate_hz)
    first, silent = (round(settle_s * rate_hz) + listen for settle_s in _SETTLE_S)
    tone = level * np.sin(2.0 * np.pi * _TONE_HZ * np.arange(first) / rate_hz)
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
