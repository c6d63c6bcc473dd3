"""Figures of many loops at once, by their responses on one grid of frequencies: what a search, a draw and a chart ask.

`signals.loop.margins` refines the figures of one loop to the frequencies at which they are attained; these are as good
as their grid, which has to be dense around lightly damped roots (`around_modes_hz`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray

_LIGHT = 3.0
"""A root whose imaginary part is so many times its real part is followed by the grid: damping below 0.32."""

_TURN_OFF = 0.6 * np.pi
"""A closed pole that is unstable takes a turn of pi; a grid from above rest to below half the rate lacks half of it."""


def around_modes_hz(roots: ComplexArray) -> FloatArray:
    """Return 33 frequencies, hertz, around each lightly damped root (rad/s), up to four times its half-width away."""
    light = roots[np.abs(roots.imag) > _LIGHT * np.abs(roots.real)]
    away = np.abs(light.real)[:, None] * np.linspace(-4.0, 4.0, 33)
    return np.asarray((np.abs(light.imag)[:, None] + away).ravel() / (2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class LoopFigures:
    """Loops by their open-loop responses L on a grid of ascending frequencies, shape (n, f)."""

    loop: ComplexArray

    @cached_property
    def sensitivity(self) -> ComplexArray:
        """Return S, (n, f)."""
        return np.asarray(1.0 / (1.0 + self.loop))

    @cached_property
    def complementary(self) -> ComplexArray:
        """Return T, (n, f)."""
        return np.asarray(self.loop * self.sensitivity)

    @cached_property
    def log_l(self) -> FloatArray:
        """Return log |L|, (n, f)."""
        return np.asarray(np.log(np.abs(self.loop)))

    @cached_property
    def log_s(self) -> FloatArray:
        """Return log |S|, (n, f)."""
        return np.asarray(np.log(np.abs(self.sensitivity)))

    @cached_property
    def log_t(self) -> FloatArray:
        """Return log |T|, (n, f)."""
        return self.log_l + self.log_s

    @property
    def sensitivity_peak(self) -> FloatArray:
        """Return max |S|, (n,)."""
        return np.asarray(np.max(np.abs(self.sensitivity), axis=1))

    @property
    def turned(self) -> FloatArray:
        """Return the angle, radians, by which 1 + L turns over the grid, (n,): from rest to half the rate, pi for each
        unstable pole of L and half of it for each at rest, where the closed loop is stable (Nyquist)."""
        angle = np.angle(1.0 + self.loop)
        return np.asarray(np.sum((np.diff(angle, axis=1) + np.pi) % (2.0 * np.pi) - np.pi, axis=1))

    def is_stable(self, at_rest: ArrayLike, outside: ArrayLike) -> NDArray[np.bool_]:
        """Return whether 1 + L turns as often as a stable loop's does, (n,): see `turned`. at_rest, outside: number of
        poles of L at rest and unstable ones, of each loop or of all.
        """
        wanted = np.pi * (0.5 * np.asarray(at_rest) + np.asarray(outside))
        return np.asarray(np.abs(self.turned - wanted) < _TURN_OFF)

    def phase_margin_deg(self, part: slice = slice(None)) -> tuple[FloatArray, ComplexArray]:
        """Return each loop's least phase margin on a part of the grid, (n,), and the weights (n, size) with which it
        follows log C: Re(sum w dlogC). log |L| and phase are linear between points; 180 degrees without a crossing.
        """
        loops, levels = self.loop[:, part], self.log_l[:, part]
        margins, weights = np.full(loops.shape[0], 180.0), np.zeros(loops.shape, dtype=np.complex128)
        below = np.signbit(levels)
        row, i = np.nonzero(below[:, 1:] != below[:, :-1])
        before, after = np.degrees(np.angle(-loops[row, i])), np.degrees(np.angle(-loops[row, i + 1]))  # 0 at -180
        rise = levels[row, i + 1] - levels[row, i]
        share = -levels[row, i] / rise
        turn = (after - before + 180.0) % 360.0 - 180.0
        margin = before + turn * share
        order = np.lexsort((np.abs(margin), row))
        row = row[order]
        first = np.append(True, row[1:] != row[:-1])[: row.size]
        row, worst = row[first], order[first]
        j, tau = i[worst], share[worst]
        by_log = -turn[worst] / rise[worst] - 1j * np.degrees(1.0)  # of a level (real), of a phase (imaginary)
        margins[row] = margin[worst]
        weights[row, j], weights[row, j + 1] = by_log * (1.0 - tau), by_log * tau
        return margins, weights


def continuous_phase_deg(response: ComplexArray) -> FloatArray:
    """Return the phase along the last axis without jumps, in degrees; it begins between -270 and 90."""
    phase = np.degrees(np.unwrap(np.angle(response), axis=-1))
    return np.asarray(phase - 360.0 * np.ceil((phase[..., :1] - 90.0) / 360.0))
