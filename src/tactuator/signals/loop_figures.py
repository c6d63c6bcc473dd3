"""Figures of loops: of many at once by their responses on one grid of frequencies, and of one to the last digit.

`LoopFigures`, for a search, a draw and a chart, are as good as their grid, which has to be dense around lightly damped
roots (`around_modes_hz`). `margins` begins from them, on a grid of its loop, and refines each to the frequency where it
is attained.

Disk margin: Seiler, Packard & Gahinet (2020), "An introduction to disk margins", IEEE Control Systems 40(5), after
Blight, Dailey & Gangsaas (1994): the balanced (S - T) margin alpha = 2 / max|S - T| means that the loop stays stable
for every simultaneous gain factor between (2 - alpha)/(2 + alpha) and its inverse, and for every phase change within
2 atan(alpha/2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.result import Fact, Result
from tactuator.signals.loop import FeedbackLoop, System, closed_poles
from tactuator.signals.systems import ContinuousSystem, SampledSystem

_LIGHT = 3.0
"""A root whose imaginary part is so many times its real part is followed by the grid: damping below 0.32."""


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
        # a closed pole that is unstable takes a turn of pi; a grid from above rest to below half the rate lacks half
        # of it
        return np.asarray(np.abs(self.turned - wanted) < 0.6 * np.pi)

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


_NEAR, _GRID = 0.9, 1500


@dataclass(frozen=True)
class Peak:
    """The greatest value of a magnitude, and its frequency (hertz)."""

    value: float
    frequency_hz: float


@dataclass(frozen=True)
class DiskMargin:
    """Disk margin of a loop: alpha (dimensionless), the frequency where it is attained, and what it guarantees.

    gain_db: gain may change by this much either way (inf if alpha >= 2). phase_deg: phase may change by this much.
    """

    alpha: float
    frequency_hz: float

    @property
    def gain_db(self) -> float:
        """Return the gain change in dB, either way, that the disk allows."""
        return float("inf") if self.alpha >= 2.0 else float(20.0 * np.log10((2.0 + self.alpha) / (2.0 - self.alpha)))

    @property
    def phase_deg(self) -> float:
        """Return the phase change in degrees, either way, that the disk allows."""
        return float(np.degrees(2.0 * np.arctan(self.alpha / 2.0)))


@dataclass(frozen=True)
class Margins(Result):
    """Margins of a stable loop.

    crossover_hz: where |L| = 1 with the smallest phase margin (nan if it never is). phase_margin_deg: inf then.
    gain_margin_db: by how much the gain may rise (inf: any); gain_reduction_db: by how much it may fall (-inf: any).
    phase_crossover_hz: where gain_margin_db is attained. delay_margin_s: the extra dead time that the loop bears.
    delay_margin_samples: the same in samples, None for a continuous loop. bandwidth_hz: where |T| first falls below
    -3 dB (nan if it does not). Disk and bandwidth are computed where they are asked for.
    """

    crossover_hz: float
    phase_margin_deg: float
    gain_margin_db: float
    gain_reduction_db: float
    phase_crossover_hz: float
    delay_margin_s: float
    delay_margin_samples: float | None
    sensitivity: Peak
    complementary: Peak
    loop: FeedbackLoop = field(repr=False)

    @cached_property
    def disk(self) -> DiskMargin:
        """Return the disk margin."""
        loop = self.loop
        grid, figures = _on_grid(loop)
        values = np.abs(figures.sensitivity - figures.complementary)[0]
        difference, worst_hz = _peak(lambda f: np.abs(loop.sensitivity(f) - loop.complementary(f)), grid, values)
        return DiskMargin(2.0 / difference, worst_hz)

    @cached_property
    def bandwidth_hz(self) -> float:
        """Return the frequency where |T| first falls below -3 dB, hertz."""
        half, (grid, figures) = 10.0 ** (-3.0 / 20.0), _on_grid(self.loop)
        values = np.abs(figures.complementary[0]) - half
        crossings = _crossings(lambda f: float(np.abs(self.loop.complementary(f))) - half, grid, values)
        return crossings[0] if crossings and values[0] > 0.0 else float("nan")

    @property
    def least_gain(self) -> float:
        """Return the share of the loop's gain below which it turns unstable: 0.0 where it bears any lower gain."""
        return float(10.0 ** (self.gain_reduction_db / 20.0))

    @property
    def sensitivity_peak(self) -> float:
        """Return the peak of the sensitivity, max |S|."""
        return self.sensitivity.value

    @property
    def complementary_peak(self) -> float:
        """Return the peak of the complementary sensitivity, max |T|."""
        return self.complementary.value

    def facts(self) -> list[Fact]:
        """Return the figures."""
        return [
            Fact("crossover_hz", self.crossover_hz, "crossover", "Hz", ".2f", True),
            Fact("phase_margin_deg", self.phase_margin_deg, "phase margin", "deg", ".2f", True),
            Fact("gain_margin_db", self.gain_margin_db, "gain margin", "dB", ".1f", True),
            Fact("sensitivity_peak", self.sensitivity_peak, "max|S|", "", ".3f", True),
            Fact("sensitivity_peak_hz", self.sensitivity.frequency_hz, "max|S| at", "Hz", ".1f", True),
            Fact("complementary_peak", self.complementary_peak, "max|T|", "", ".3f", True),
            Fact("disk_margin", self.disk.alpha, "disk margin", "", ".3f", True),
            Fact("disk_margin_hz", self.disk.frequency_hz, "disk margin at", "Hz", ".1f", True),
        ]


@lru_cache(maxsize=512)
def margins(loop: FeedbackLoop) -> Margins:
    """Return the margins of `loop`, each refined to the frequency where it is attained; computed once for equal loops.

    Raises UnstableLoop if the closed loop is unstable: such a loop has none.
    """
    loop.require_stable()
    grid, figures = _on_grid(loop)
    sense = Peak(*_peak(lambda f: np.abs(loop.sensitivity(f)), grid, np.abs(figures.sensitivity[0])))
    complement = Peak(*_peak(lambda f: np.abs(loop.complementary(f)), grid, np.abs(figures.complementary[0])))
    crossover, phase, delay = _phase_margin(loop, grid, figures)
    gain_up, gain_down, at = _gain_margins(loop.open_loop)
    rate = loop.open_loop.rate_hz if isinstance(loop.open_loop, SampledSystem) else None
    samples = None if rate is None else delay * rate
    return Margins(crossover, phase, gain_up, gain_down, at, delay, samples, sense, complement, loop)


def _on_grid(loop: FeedbackLoop) -> tuple[FloatArray, LoopFigures]:
    """Return the grid of a loop, (f,), and its figures there, (1, f)."""
    grid = analysis_grid_hz(loop)
    return grid, LoopFigures(loop.open_response(grid)[None])


def analysis_grid_hz(loop: FeedbackLoop) -> FloatArray:
    """Return the frequencies (hertz) on which a loop is examined: even in log frequency over every root's decade, and
    dense around each open- and closed-loop pole, in proportion to its damping.
    """
    open_loop = loop.open_loop
    if isinstance(open_loop, SampledSystem):
        top = open_loop.rate_hz / 2.0
        roots = [root for root in np.append(open_loop.poles, open_loop.zeros) if abs(root) > 1e-3]
        closed = closed_poles(open_loop) + 1.0
        roots.extend(root for root in closed if abs(root) > 1e-3)
        s: ComplexArray = np.asarray(np.log(np.array(roots, dtype=np.complex128)) * open_loop.rate_hz)
    else:
        s = np.concatenate([open_loop.poles, open_loop.zeros])
        if open_loop.delay_s == 0.0:
            s = np.concatenate([s, closed_poles(open_loop)])
        top = float(np.max(np.abs(s), initial=1.0)) * 30.0 / (2.0 * np.pi)
        top = max(top, 3.0 / open_loop.delay_s) if open_loop.delay_s > 0.0 else top
    sizes = np.abs(s)[np.abs(s) > 1e-6 * np.max(np.abs(s), initial=0.0)] / (2.0 * np.pi)
    low = min(np.min(sizes, initial=top / 1e3) / 30.0, top / 1e3)
    around = around_modes_hz(s)
    return np.unique(np.concatenate([np.geomspace(low, top, _GRID), around[(around > low) & (around < top)]]))


def _peak(magnitude: Callable[[FloatArray], FloatArray], grid: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return the greatest value and its frequency, refined around the three highest maxima of the grid."""
    best = int(np.argmax(values))
    greatest, at = float(values[best]), float(grid[best])
    inner = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])) + 1
    near = inner[values[inner] >= _NEAR * greatest]  # the grid is too dense for a lower one to win
    for index in near[np.argsort(-values[near])][:3]:
        bounds = np.log(grid[[index - 1, index + 1]])
        result = scipy.optimize.minimize_scalar(
            lambda x: -float(magnitude(np.exp(np.array([x])))[0]),
            bounds=tuple(bounds),
            method="bounded",
            options={"xatol": 1e-9},
        )
        if -result.fun > greatest:
            greatest, at = -float(result.fun), float(np.exp(result.x))
    return greatest, at


def _crossings(function: Callable[[float], float], grid: FloatArray, values: FloatArray) -> list[float]:
    """Return the frequencies where `function` changes its sign, given its values on the grid."""
    signs = np.signbit(values)
    places = np.flatnonzero(signs[1:] != signs[:-1])
    return [_crossing(lambda x: function(float(np.exp(x))), *np.log(grid[[i, i + 1]]).tolist()) for i in places]


def _crossing(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the frequency of a zero between two logarithms of frequency; an end where only rounding differs."""
    at_low, at_high = function(low), function(high)
    if np.signbit(at_low) == np.signbit(at_high):
        return float(np.exp(low if abs(at_low) < abs(at_high) else high))
    return float(np.exp(scipy.optimize.brentq(function, low, high, xtol=1e-13)))


def _phase_margin(loop: FeedbackLoop, grid: FloatArray, figures: LoopFigures) -> tuple[float, float, float]:
    """Return (crossover_hz, phase_margin_deg, delay_margin_s), each the worst over all crossovers."""
    crossovers = _crossings(lambda f: float(np.log(np.abs(loop.open_response(f)))), grid, figures.log_l[0])
    if not crossovers:
        return float("nan"), float("inf"), float("inf")
    lag = [float(np.degrees(np.angle(-loop.open_response(f)))) for f in crossovers]
    worst = int(np.argmin(np.abs(lag)))
    delays = [(angle % 360.0) / 360.0 / f for angle, f in zip(lag, crossovers, strict=True)]
    return crossovers[worst], abs(lag[worst]), min(delays)


def _gain_margins(open_loop: System) -> tuple[float, float, float]:
    """Return (gain_margin_db, gain_reduction_db, phase_crossover_hz) from the crossings of the negative real axis."""
    frequency = phase_crossovers_hz(open_loop)
    room = -20.0 * np.log10(np.abs(open_loop.response(frequency)))
    up = np.where(room >= 0.0, room, np.inf)
    at = float(frequency[np.argmin(up)]) if np.any(room >= 0.0) else float("nan")
    return float(np.min(up, initial=np.inf)), float(np.max(room[room < 0.0], initial=-np.inf)), at


def least_gain(open_loop: System) -> float:
    """Return the share of its gain below which a loop that is stable turns unstable: 0.0 where it bears any lower gain.

    A pole of the closed loop reaches the edge of stability at the gain -1/L, wherever L is real and negative.
    """
    return float(10.0 ** (_gain_margins(open_loop)[1] / 20.0))


_FACTOR, _PARTS, _NARROW, _INTERVALS_MAX = 1.5, 16, 1e-8, 50_000
_AT_REST, _STEP = 1e-9, 0.1
"""Radians by which a phase changes at one point only where a root lies on the edge of stability."""


def phase_crossovers_hz(open_loop: System) -> FloatArray:
    """Return every frequency (hertz, shape (n,)) at which L is real and negative, rest and Nyquist's included.

    The phase of every root's factor rises or falls with frequency throughout: along s = j v, or v = tan(w / 2) of a
    sampled loop (z = (1 + jv)/(1 - jv)). What rises and what falls bounds the phase between two frequencies. An
    interval whose bounds hold no odd multiple of pi holds no crossover; any other is divided until it is narrow.
    """
    zeros, poles, gain = open_loop.zeros, open_loop.poles, open_loop.gain
    roots, signs = np.concatenate([zeros, poles]), np.repeat([1.0, -1.0], [zeros.size, poles.size])
    if isinstance(open_loop, ContinuousSystem):
        top = 30.0 * float(np.max(np.abs(roots), initial=1.0))
        top = max(top, 20.0 / open_loop.delay_s) if open_loop.delay_s > 0.0 else top
        moving = roots[roots != 0.0]
        factors = -1.0 / moving
        at_rest = signs[roots == 0.0]
        start = gain * _sign(-moving)
        crossed = _crossed(factors, signs[roots != 0.0], at_rest, start, top, open_loop.delay_s)
        return np.sort(crossed) / (2.0 * np.pi)
    parts, beside = [], float(np.sum(signs)) - 2.0 * open_loop.delay_samples
    for side in (1.0, -1.0):  # from rest upwards, from Nyquist downwards: L(-z) is the conjugate of L there
        stays = np.abs(1.0 - side * roots) < _AT_REST
        moving = side * roots[~stays]
        factors = np.append((1.0 + moving) / (1.0 - moving), 1.0)
        start = gain * side ** (zeros.size - poles.size - open_loop.delay_samples) * _sign(np.complex128(1.0) - moving)
        angle = 2.0 * np.arctan(_crossed(factors, np.append(signs[~stays], beside), signs[stays], start))
        parts.append((angle if side > 0.0 else np.pi - angle) * open_loop.rate_hz / (2.0 * np.pi))
    return np.sort(np.concatenate(parts))


def _sign(values: ComplexArray) -> float:
    """Return the sign of the product of values that come in conjugate pairs."""
    return (-1.0) ** int(np.sum(values[values.imag == 0.0].real < 0.0))


def _crossed(
    factors: ComplexArray, signs: FloatArray, at_rest: FloatArray, start: float, top: float = 1.0, delay: float = 0.0
) -> FloatArray:
    """Return where start (jv)^sum(at_rest) prod((1 + jv factors)^signs) exp(-jv delay) is real and negative, v from 0
    to `top`, shape (n,)."""
    rises = signs * np.where(factors.real == 0.0, np.sign(factors.imag), factors.real) > 0.0
    sizes = np.abs(signs)
    goal = np.pi * float(start > 0.0) - 0.5 * np.pi * float(np.sum(at_rest))

    def turns(v: FloatArray) -> tuple[FloatArray, FloatArray]:
        angles = np.abs(np.angle(1.0 + 1j * v[:, None] * factors)) * sizes
        return angles[:, rises].sum(axis=1), angles[:, ~rises].sum(axis=1) + v * delay

    low = 1e-6 * min(top, 1.0 / float(np.max(np.abs(factors), initial=1.0 / top)))
    edges = np.geomspace(low, top, 2 + int(np.log(top / low) / np.log(_FACTOR)))[None]
    while True:
        up, down = (of.reshape(edges.shape) for of in turns(edges.ravel()))
        least, most = up[:, :-1] - down[:, 1:] - goal, up[:, 1:] - down[:, :-1] - goal
        holds = np.floor(most / (2.0 * np.pi)) >= np.ceil(least / (2.0 * np.pi))
        before, after = edges[:, :-1][holds], edges[:, 1:][holds]
        if before.size == 0 or before.size > _INTERVALS_MAX or after[0] < before[0] * (1.0 + _NARROW):
            jumps = (most - least)[holds] > _STEP
            places = np.sqrt(before * after)[~jumps]
            return np.append(places, 0.0) if start < 0.0 and at_rest.size == 0 else places
        edges = np.geomspace(before, after, _PARTS + 1, axis=1)
