"""Round-off and limit cycles: one channel's loop stepped in the arithmetic of a number format.

The plant is the sampled one in double precision, without noise, friction or converters, and the same loop is run in
double precision with the format's own rounded coefficients: what is left over is the arithmetic's alone. The reference
is one whose command stays within its limit, so that the exact loop is linear: its states are run at once, in the
difference from sample to sample, which keeps the digits of slow poles.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from operator import mul

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel, Display
from tactuator.runtime._core import ffi, lib
from tactuator.signals.discretise import held_state_space

Step = Callable[[float, float], float]

_SETTLE_S, _LISTEN_S = (0.5, 1.0), 0.5
_TONE_HZ = 37.0


def double_step(prefilter: FloatArray, feedback: FloatArray | None) -> Step:
    """Return a function (reference, position) -> command in double precision, of rows in d."""
    first = _Double(prefilter)
    second = None if feedback is None else _Double(feedback)

    def step(reference: float, position: float) -> float:
        wanted = first(reference)
        return wanted if second is None else second(wanted - position)

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
    """Return y (n,), V, of the sampled plant with `step` around it; display's delay and dead time between them."""
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
    """Return a tone of `level` upon a constant of `level`, then silence; and where round-off and limit cycles show."""
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


def exact_loop(
    channel: Channel,
    display: Display,
    prefilter: FloatArray,
    feedback: FloatArray | None,
    reference: FloatArray,
) -> tuple[FloatArray, float]:
    """Return y (n,), volts, of `run_loop` with `double_step` of these rows, and the greatest command, volts."""
    whole, fraction = whole_delay(channel, display)
    plant = held_state_space(channel.plant, 1.0 / display.rate_hz, fraction)
    loop = _Loop(prefilter, feedback, plant, whole)
    states = loop.run(reference)
    if states is not None:
        commands = states @ loop.command[:-1] + loop.command[-1] * reference
        return np.asarray(states @ loop.position), float(np.max(np.abs(commands)))
    step, greatest = double_step(prefilter, feedback), [0.0]

    def noted(wanted: float, position: float) -> float:
        command = step(wanted, position)
        greatest[0] = max(greatest[0], abs(command))
        return command

    return run_loop(channel, display, noted, reference), greatest[0]


class _Loop:
    """The linear loop: change (n, n + 1) of its states by states and reference; position (n,), command (n + 1,)."""

    def __init__(
        self,
        prefilter: FloatArray,
        feedback: FloatArray | None,
        plant: tuple[FloatArray, FloatArray, FloatArray, float],
        delay_samples: int,
    ) -> None:
        a, b, c, d = plant
        cascades = 2 * len(prefilter) + 2 * (0 if feedback is None else len(feedback))
        self.count = cascades + delay_samples + b.size
        self.change = np.zeros((self.count, self.count + 1))
        held = cascades if delay_samples else None
        states = slice(cascades + delay_samples, self.count)
        self.position = np.zeros(self.count)
        self.position[states] = c
        if held is not None:
            self.position[held] = d
        value = self._cascade(prefilter, self._one(self.count), 0)
        if feedback is not None:
            value = value - np.append(self.position, 0.0)
            value = self._cascade(feedback, value, 2 * len(prefilter))
        self.command = value
        for place in range(cascades, cascades + delay_samples):
            newest = place + 1 == cascades + delay_samples
            self.change[place] = value if newest else self._one(place + 1)
            self.change[place, place] -= 1.0
        self.change[states, states] = a - np.eye(b.size)
        self.change[states] += np.outer(b, value if held is None else self._one(held))

    def _one(self, place: int) -> FloatArray:
        row = np.zeros(self.count + 1)
        row[place] = 1.0
        return row

    def _cascade(self, rows: FloatArray, value: FloatArray, first: int) -> FloatArray:
        """Set the changes of a cascade's states and return its output, as `double_step` has them."""
        for at, (b0, b1, b2, a1, a2) in zip(range(first, first + 2 * len(rows), 2), rows, strict=True):
            out = b0 * value + self._one(at)
            self.change[at] = b1 * value - a1 * out + self._one(at + 1)
            self.change[at + 1] = b2 * value - a2 * out
            value = out
        return value

    def run(self, reference: FloatArray) -> FloatArray | None:
        """Return the states (samples, n) from rest, or None where there are more than the core takes."""
        matrix, drive, nothing = (
            np.ascontiguousarray(part) for part in (self.change[:, :-1], self.change[:, -1], np.zeros(self.count))
        )
        driver, state = np.ascontiguousarray(reference, dtype=np.float64), np.zeros(self.count)
        states = np.empty((driver.size, self.count))
        taken = (ffi.from_buffer("double[]", array) for array in (matrix, drive, nothing))
        rest = (ffi.from_buffer("double[]", array) for array in (driver, state, states))
        refused = lib.tact_states_run(self.count, *taken, driver.size, *rest)
        return None if refused else states
