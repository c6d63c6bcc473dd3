"""The least mean |S| that a controller of any order could reach under a channel's limits: a bound from below.

A loop that is stable at every lower gain has S = exp(X) with X = x + iy analytic outside the unit circle, |y| < pi, and
X = 0 at infinity, to the order of the loop's delay, and at the plant's zeros outside the circle. The mean |S| in dB is
linear in x, and x fixes y (Bode's relation of gain and phase: Bode, Network Analysis and Feedback Amplifier Design,
1945, chapter 14). This leaves a linear program over x, given on nodes and linear in log tan(angle/2) between them.

Limits: |S| at lines and max|S| bound x; |T| = |1 - exp(X)| < 1, at lines and where a node by itself would bring all of
the noise, is a convex set; both as they are. max|T| > 1 is relaxed to the convex hull of what it allows. The phase
margin is left out: the hull of what it allows is everything. The power |1 - exp(X)|^2 in the noise gain is relaxed to
its convex envelope, by the steepest of many planes that lie below it, added where they are passed. Loads count one by
one; the greatest of their bounds is told.

What is numerical: x has 60 nodes. With 90 the bound was 0.1 to 0.7 dB lower on five plants, so that it is told 1 dB
lower. It is no proof. Why three sections stay far above it: decision 0345.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.controller import Controller
from tactuator.synthesis.family import Member, plant_family
from tactuator.synthesis.limits import DB, Limit
from tactuator.synthesis.screening import Task

NODES = 60
ALLOWANCE_DB = 1.0
_BELOW, _INSIDE, _SPLIT = 8, 24, 8
_ROUNDS, _MARGIN, _FALL_DB = 25, 0.02, 0.5
_LOOSE = 1.05
_ANGLES = np.linspace(-np.pi, np.pi, 241)


def with_bounds(controller: Controller) -> Controller:
    """Return the controller with `bound_db` in the report of every channel that has a loop: the least mean |S| over the
    rejection band, dB, that any controller could reach, or None where nothing is known of it."""
    display, channels = controller.display, []
    for channel, designed in zip(display.channels, controller.channels, strict=True):
        family = plant_family(channel, display.rate_hz, display.delay_samples)
        task = Task.of(family, channel.feedback, display.rate_hz, display.objectives.resonance_peak)
        bound = None if designed.feedback_sos is None else bound_db(task)
        channels.append(replace(designed, report={**designed.report, "bound_db": bound}))
    return replace(controller, channels=tuple(channels))


def bound_db(task: Task, nodes: int = NODES) -> float | None:
    """Return the least mean |S| over the rejection band, dB, for the worst plant; None where a loop need not be stable
    at every lower gain, or where nothing that is linear tells of one."""
    if not task.must_bear_less:
        return None
    bounds = [_Program(task, member, nodes).least_db() for member in task.family]
    known = [value for value in bounds if value is not None]
    return max(known) - ALLOWANCE_DB if known else None


class _Program:
    """The linear program of one plant: unknowns are x on the nodes and each node's share of the noise's power."""

    def __init__(self, task: Task, member: Member, nodes: int) -> None:
        self._member, self._rate_hz = member, task.rate_hz
        self._lines = [limit for limit in task.limits if limit.frequency_hz is not None]
        whole = {limit.quantity: limit.asked for limit in task.limits if limit.frequency_hz is None}
        self._peak_s, self._peak_t = whole.get("sensitivity_peak", 100.0), whole.get("resonance_peak", 100.0)
        self._noise_gain = whole.get("command_noise_gain_max")
        low, high = task.rejection_band_hz
        spread = [np.geomspace(low / 30.0, low, _BELOW), np.geomspace(low, high, _INSIDE)]
        spread.append(np.geomspace(high, 0.4999 * task.rate_hz, nodes - _BELOW - _INSIDE))
        self._hz = np.unique(np.concatenate([*spread, [limit.frequency_hz or low for limit in self._lines]]))
        self._u = self._place(self._hz)
        self._turn = _turn(self._u)
        self._cost = self._weights(self._place(np.geomspace(low, high, 400))).mean(axis=0)

    def _place(self, frequency_hz: FloatArray) -> FloatArray:
        return np.asarray(np.log(np.tan(np.pi * frequency_hz / self._rate_hz)))

    def _weights(self, places: FloatArray) -> FloatArray:
        """Return what interpolates x at places (p,) from the nodes, (p, n)."""
        return np.array([np.interp(places, self._u, unit) for unit in np.eye(self._u.size)]).T

    def least_db(self) -> float | None:
        size = self._u.size
        above, most = self._fixed_rows()
        analytic = self._analytic()
        equal = np.hstack([analytic, np.zeros((analytic.shape[0], size))])
        top = np.full(size, np.log(self._peak_s))
        for limit in self._lines:
            if limit.quantity == "|S|":
                top[self._node(limit)] = min(np.log(self._peak_s), limit.asked / DB)
        ranges = [(-60.0, float(value)) for value in top] + [(0.0, None)] * size
        slopes, shares, planes = _planes(self._peak_s, self._peak_t), self._shares(), np.zeros(0)
        value: float | None = None
        for _ in range(_ROUNDS):
            cost = np.append(self._cost, np.zeros(size))
            zero = np.zeros(equal.shape[0])
            done = scipy.optimize.linprog(cost, above, most, equal, zero, bounds=ranges, method="highs")
            # more rows cannot lower it: from a fall on the solver has lost its digits, and may not come to an end
            if done.x is None or (value is not None and done.fun * DB < value - _FALL_DB):
                return value
            value = max(float(done.fun) * DB, -np.inf if value is None else value)
            x, power = done.x[:size], done.x[size:]
            heights = np.outer(slopes[0], x) + np.outer(slopes[1], self._turn @ x) + slopes[2][:, None]
            steepest = np.argmax(heights, axis=0)
            planes = shares * heights[steepest, np.arange(size)]
            passed = np.flatnonzero(planes > power + _MARGIN / (10.0 * size))
            if passed.size == 0 or np.sum(np.maximum(planes, 0.0)) < 1.0 + _MARGIN:
                break
            rows, levels = self._cuts(passed, [of[steepest[passed]] for of in slopes], shares)
            above, most = np.vstack([above, rows]), np.append(most, levels)
        return value

    def _cuts(
        self, passed: NDArray[np.intp], planes: list[FloatArray], shares: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the rows, and their right sides, that put planes below the power at the nodes `passed`."""
        size, weight = self._u.size, shares[passed]
        rows = np.zeros((passed.size, 2 * size))
        rows[:, :size] = (weight * planes[1])[:, None] * self._turn[passed]
        rows[np.arange(passed.size), passed] += weight * planes[0]
        rows[np.arange(passed.size), size + passed] -= 1.0
        scale = np.abs(rows).max(axis=1)
        return rows / scale[:, None], -weight * planes[2] / scale

    def _node(self, limit: Limit) -> int:
        return int(np.argmin(np.abs(self._hz - (limit.frequency_hz or 0.0))))

    def _shares(self) -> FloatArray:
        """Return the weight of each node's |T|^2 in the square of the noise gain, over its limit's, (n,)."""
        if self._noise_gain is None:
            return np.zeros(self._hz.size)
        width = np.gradient(self._hz)
        width[0], width[-1] = 0.5 * (self._hz[1] - self._hz[0]), 0.5 * (self._hz[-1] - self._hz[-2])
        level = np.abs(self._member.sampled.response(self._hz)) * self._noise_gain
        return np.asarray(width / (0.5 * self._rate_hz) / level**2)

    def _fixed_rows(self) -> tuple[FloatArray, FloatArray]:
        """Return the rows of |y| <= pi, of max|T|, of |T| below one and of the whole power, and their right sides."""
        size, unit = self._u.size, np.eye(self._u.size)
        rows, most = [self._turn, -self._turn], [np.full(size, np.pi), np.full(size, np.pi)]
        for slope, level in _hull(_greatest(self._peak_s, self._peak_t)):
            rows, most = [*rows, unit - slope * self._turn], [*most, np.full(size, level)]
        discs = list(enumerate((-0.5 * np.log(np.maximum(self._shares(), 1e-300))).tolist()))
        discs += [(self._node(limit), limit.asked / DB) for limit in self._lines if limit.quantity == "|T|"]
        for node, level in (disc for disc in discs if disc[1] < 0.0):
            edge = np.log(1.0 + np.exp(level + 1j * np.linspace(0.0, 2.0 * np.pi, 721)))
            for angle in np.linspace(0.0, 2.0 * np.pi, 25):
                rows.append((np.cos(angle) * unit[node] + np.sin(angle) * self._turn[node])[None])
                most.append(np.array([np.max((edge * np.exp(-1j * angle)).real)]))
        whole = np.vstack(rows)
        power = np.append(np.zeros(size), np.ones(size))
        return np.vstack([np.hstack([whole, np.zeros_like(whole)]), power]), np.append(np.concatenate(most), 1.0)

    def _analytic(self) -> FloatArray:
        """Return the rows that are zero: the coefficients of X at infinity before the loop's first answer, and X at the
        plant's zeros outside the circle."""
        plant, u = self._member.sampled, self._u
        fine = np.append(np.concatenate([np.linspace(a, b, _SPLIT + 1)[:-1] for a, b in pairwise(u)]), u[-1])
        step = np.gradient(fine)
        step[0], step[-1] = 0.5 * (fine[1] - fine[0]), 0.5 * (fine[-1] - fine[-2])
        angle, density = 2.0 * np.arctan(np.exp(fine)), step / np.cosh(fine)
        kernels: list[FloatArray] = []
        for order in range(plant.delay_samples + plant.poles.size - plant.zeros.size):
            kernels.append(np.cos(order * angle))
        for zero in plant.zeros[(np.abs(plant.zeros) > 1.0 + 1e-9) & (plant.zeros.imag >= 0.0)]:
            around: ComplexArray = np.exp(1j * angle) / zero
            back: ComplexArray = np.exp(-1j * angle) / zero
            at_zero: ComplexArray = 1.0 + around / (1.0 - around) + back / (1.0 - back)
            kernels += [at_zero.real, at_zero.imag] if zero.imag > 0.0 else [at_zero.real]
        rows = (np.array(kernels) * density) @ self._weights(fine)
        ends, tail = np.exp(u[0]), 2.0 * np.exp(-u[-1])
        for row, kernel in zip(rows, kernels, strict=True):  # below the first node x goes on; above the last it stays
            row[:2] += 2.0 * ends * kernel[0] * (np.array([1.0, 0.0]) + np.array([1.0, -1.0]) / (u[1] - u[0]))
            row[-1] += tail * kernel[-1]
        return np.asarray(rows / np.abs(rows).max(axis=1, keepdims=True))


def _turn(u: FloatArray) -> FloatArray:
    """Return the matrix from x at nodes `u` to y there: (1/pi) of the integral of dx/du log coth(|u - at|/2)."""
    away = u[None, :] - u[:, None]
    whole = np.where(away == 0.0, 0.0, np.sign(away) * 2.0 * (_chi(np.ones(1)) - _chi(np.exp(-np.abs(away)))))
    whole[:, 0] = -2.0 * _chi(np.ones(1))  # the first slope goes on below
    by_slope = np.diff(whole, axis=1) / np.pi / np.diff(u)
    matrix = np.zeros((u.size, u.size))
    matrix[:, 1:] += by_slope
    matrix[:, :-1] -= by_slope
    return matrix


def _chi(q: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (scipy.special.spence(1.0 - q) - scipy.special.spence(1.0 + q)))


def _greatest(peak_s: float, peak_t: float) -> FloatArray:
    """Return the greatest x that both peaks allow at each of _ANGLES; a max|T| of one or less is left out."""
    greatest = np.full(_ANGLES.size, np.log(peak_s))
    if peak_t > 1.0:
        cosine = np.cos(_ANGLES)
        greatest = np.minimum(greatest, np.log(cosine + np.sqrt(cosine**2 + peak_t**2 - 1.0)))
    return greatest


def _hull(greatest: FloatArray) -> list[tuple[float, float]]:
    """Return (slope, level) of lines x <= level + slope y that lie on what is allowed."""
    slopes = np.linspace(-2.0, 2.0, 17)
    return [(float(slope), float(np.max(greatest - slope * _ANGLES))) for slope in slopes]


@cache
def _planes(peak_s: float, peak_t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return planes p x + q y + r that lie below |1 - exp(x + iy)|^2 wherever the peaks allow: p, q, r, (k,) each."""
    greatest = _greatest(peak_s, peak_t)
    below = np.concatenate([[0.0], np.geomspace(1e-3, 8.0, 60), [400.0]])
    round_zero = np.geomspace(1e-7, 1.5, 60)[:, None] * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False))
    inner = round_zero.ravel()
    inner = inner[inner.real <= np.interp(inner.imag, _ANGLES, greatest)]
    points = np.concatenate([(greatest[:, None] - below + 1j * _ANGLES[:, None]).ravel(), inner, [0.0]])
    power = np.abs(1.0 - np.exp(points)) ** 2
    size, angle = np.geomspace(1e-7, 3.0, 46)[:, None], np.linspace(-0.5 * np.pi, 0.5 * np.pi, 17)
    p, q = np.maximum(size * np.cos(angle), 0.0).ravel(), (size * np.sin(angle)).ravel()
    p[p < 1e-12] = 0.0
    r = np.array([np.min(power - a * points.real - b * points.imag) for a, b in zip(p, q, strict=True)])
    return p, q, _LOOSE * np.minimum(r, 0.0)  # a little lower for what lies between the points
