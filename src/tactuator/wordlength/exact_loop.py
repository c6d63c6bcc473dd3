"""The loop in double precision, of a format's own rounded coefficients: what a format's loop is compared with.

As long as no command comes to its limit the loop is linear, and its states are run at once, in the difference from
sample to sample, which keeps the digits of slow poles. Where a command reaches the limit, it is stepped.
"""

from __future__ import annotations

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel, Display
from tactuator.runtime._core import ffi, lib
from tactuator.signals.discretise import held_state_space
from tactuator.wordlength.roundoff import double_step, run_loop, whole_delay

Rows = FloatArray


def exact_loop(
    channel: Channel, display: Display, prefilter: Rows, feedback: Rows | None, most_v: float, reference: FloatArray
) -> FloatArray:
    """Return y (n,), volts, of `run_loop` with `double_step` of these rows, within most_v volts."""
    whole, fraction = whole_delay(channel, display)
    plant = held_state_space(channel.plant, 1.0 / display.rate_hz, fraction)
    loop = _Loop(prefilter, feedback, plant, whole)
    states = loop.run(reference)
    if states is None or np.max(np.abs(states @ loop.command[:-1] + loop.command[-1] * reference)) >= most_v:
        return run_loop(channel, display, double_step(prefilter, feedback, most_v), reference)
    return np.asarray(states @ loop.position)


class _Loop:
    """The linear loop: change (n, n + 1) of its states in a sample by states and reference; position (n,), command
    (n + 1,) by the same.
    """

    def __init__(
        self,
        prefilter: Rows,
        feedback: Rows | None,
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
        one = np.zeros(self.count + 1)
        one[place] = 1.0
        return one

    def _cascade(self, rows: Rows, value: FloatArray, first: int) -> FloatArray:
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
        taken = (ffi.from_buffer("double[]", one) for one in (matrix, drive, nothing))
        rest = (ffi.from_buffer("double[]", one) for one in (driver, state, states))
        refused = lib.tact_states_run(self.count, *taken, driver.size, *rest)
        return None if refused else states
