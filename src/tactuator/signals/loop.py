"""Feedback loops: responses, stability and margins, for continuous and for sampled time.

r -> F -> (+) -> e -> C -> u -> P -> y        L = C P, S = 1/(1 + L), T = L/(1 + L), H = F T
           ^-                        |
           +-------------------------+

Stability follows from zeros and poles alone, with no polynomial expanded. Sampled loops are treated in d = z - 1, where
slow poles keep their digits at any rate: a cascade of first-order factors is closed in state space, for its
eigenvalues.

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
from numpy.typing import ArrayLike

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.signals.loop_figures import around_modes_hz
from tactuator.signals.systems import ContinuousSystem, SampledSystem

System = ContinuousSystem | SampledSystem


class UnstableLoop(BadInput):
    """The closed loop is unstable, so that it has no margins and no steady response."""


def closed_roots(zeros: ComplexArray, poles: ComplexArray, gain: float) -> ComplexArray:
    """Return the roots of prod(x - poles) + gain prod(x - zeros), as eigenvalues of the closed cascade.

    Raises BadInput with more zeros than poles, or where the direct path makes the loop algebraically undefined.
    """
    order = poles.size
    if zeros.size > order:
        raise BadInput(f"the open loop has {zeros.size} zeros and {order} poles", "no more zeros than poles")
    if order == 0:
        return np.empty(0, dtype=np.complex128)
    poles, zeros = _ordered(poles), _ordered(zeros)
    scale = np.maximum(np.abs(poles), np.abs(np.append(zeros, poles[zeros.size :])))
    a = np.zeros((order, order), dtype=np.complex128)
    b = np.zeros(order, dtype=np.complex128)
    path: ComplexArray = np.zeros(
        order, dtype=np.complex128
    )  # the signal entering a factor, as a function of the states
    direct = 1.0
    for index in range(order):
        unit = scale[index] or 1.0
        a[index] = path * unit
        a[index, index] += poles[index]
        b[index] = direct * unit
        if index < zeros.size:
            path = path.copy()
            path[index] += (poles[index] - zeros[index]) / unit
        else:
            path = np.zeros(order, dtype=np.complex128)
            path[index], direct = 1.0 / unit, 0.0
    through = 1.0 + gain * direct
    if abs(through) < 1e-12:
        raise BadInput("the loop's direct gain is -1, so that it has no solution", "any other")
    return np.asarray(np.linalg.eigvals(a - np.outer(b, path) * (gain / through)))


def _ordered(roots: ComplexArray) -> ComplexArray:
    return np.asarray(sorted(roots, key=lambda root: (abs(root), root.real, root.imag)), dtype=np.complex128)


def closed_poles(open_loop: System) -> ComplexArray:
    """Return the poles of 1/(1 + L): rad/s for a continuous loop without dead time; z - 1 of a sampled one, delay
    included.

    Raises BadInput for a continuous loop with dead time: it has infinitely many.
    """
    if isinstance(open_loop, SampledSystem):
        delay: ComplexArray = np.full(open_loop.delay_samples, -1.0 + 0.0j)
        poles: ComplexArray = np.concatenate([open_loop.poles - 1.0, delay])
        zeros: ComplexArray = open_loop.zeros - np.complex128(1.0)
        return closed_roots(zeros, poles, open_loop.gain)
    if open_loop.delay_s > 0.0:
        raise BadInput(f"a loop with {open_loop.delay_s:g} s of dead time has no finite list of poles", "none")
    return closed_roots(open_loop.zeros, open_loop.poles, open_loop.gain)


def is_stable(open_loop: System) -> bool:
    """Return whether unity negative feedback around `open_loop` is stable (hidden cancellations included)."""
    if isinstance(open_loop, SampledSystem):
        return is_inside(closed_poles(open_loop))
    if open_loop.delay_s == 0.0:
        return bool(np.all(closed_poles(open_loop).real < 0.0))
    return _right_half_plane_roots(open_loop) == 0


def is_inside(poles_in_d: ComplexArray) -> bool:
    """Return whether |1 + d| < 1 for every pole: 2 Re d + |d|^2 < 0, which keeps its digits for slow poles."""
    return bool(np.all(2.0 * poles_in_d.real + np.abs(poles_in_d) ** 2 < 0.0))


def _right_half_plane_roots(open_loop: ContinuousSystem) -> int:
    """Return the number of roots of 1 + L in the right half-plane of a loop with dead time, by the argument principle.

    G = (1 + L) D/Q, with D the open loop's denominator and Q a stable polynomial of the same order, has no pole there
    and tends to one; its phase turns by -pi for every root as the frequency goes from 0 to infinity.
    """
    if open_loop.zeros.size >= open_loop.poles.size:
        raise BadInput("a loop with dead time needs more poles than zeros", "a strictly proper open loop")
    sizes = np.abs(np.append(open_loop.poles, open_loop.zeros))
    floor = np.min(sizes[sizes > 0.0], initial=1.0 / open_loop.delay_s) * 1e-3
    substitute = -np.maximum(np.abs(open_loop.poles), floor)
    excess = open_loop.poles.size - open_loop.zeros.size
    corner = max(np.max(sizes), (10.0 * abs(open_loop.gain)) ** (1.0 / excess))
    steps = np.linspace(0.0, 10.0 * corner, int(min(400_000, 40_000 + 100.0 * corner * open_loop.delay_s)))
    omega = np.unique(np.concatenate([[0.0], np.geomspace(floor * 1e-2, corner * 1e2, 40_000), steps]))
    s = 1j * omega
    below = np.ones_like(s)
    for pole, other in zip(open_loop.poles, substitute, strict=True):
        below = below * (s - pole) / (s - other)
    above = np.full_like(s, open_loop.gain) * np.exp(-s * open_loop.delay_s)
    for index, other in enumerate(substitute):
        above = above * ((s - open_loop.zeros[index]) if index < open_loop.zeros.size else 1.0) / (s - other)
    turned = np.unwrap(np.angle(below + above))
    return int(np.round(-(turned[-1] - turned[0]) / np.pi))


@dataclass(frozen=True)
class FeedbackLoop:
    """Unity negative feedback of `controller` and `plant`, both continuous or both sampled at one rate.

    The computing delay belongs to one of the two (`delay_samples`). Mixing kinds of time raises BadInput.
    """

    controller: System
    plant: System

    def __post_init__(self) -> None:
        _ = self.open_loop

    @cached_property
    def open_loop(self) -> System:
        """Return L = C P as one system."""
        product: System = self.controller * self.plant  # the systems refuse a mixture
        return product

    @cached_property
    def is_stable(self) -> bool:
        """Return whether the closed loop is stable."""
        return is_stable(self.open_loop)

    def require_stable(self) -> None:
        """Raise UnstableLoop unless the closed loop is stable."""
        if not self.is_stable:
            raise UnstableLoop("the closed loop is unstable: it has no margins and no steady response", "a stable one")

    def open_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the open-loop response L at `frequency_hz` (hertz, any shape)."""
        return self.controller.response(frequency_hz) * self.plant.response(frequency_hz)

    def sensitivity(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return S = 1/(1 + L): from a disturbance of the position to the position."""
        numerator, denominator = self.open_loop.fraction(frequency_hz)
        return np.asarray(denominator / (numerator + denominator))

    def complementary(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return T = L/(1 + L): from F's output to the position, and (with a minus sign) from sensor noise to it."""
        numerator, denominator = self.open_loop.fraction(frequency_hz)
        return np.asarray(numerator / (numerator + denominator))

    def command_sensitivity(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return C S: from F's output to the command."""
        (c, c_den), (p, p_den) = self.controller.fraction(frequency_hz), self.plant.fraction(frequency_hz)
        return np.asarray(c * p_den / (c * p + c_den * p_den))

    def load_sensitivity(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return P S: from a voltage added to the command (friction, a force) to the position."""
        (c, c_den), (p, p_den) = self.controller.fraction(frequency_hz), self.plant.fraction(frequency_hz)
        return np.asarray(p * c_den / (c * p + c_den * p_den))


@dataclass(frozen=True)
class TwoDegreeLoop:
    """A prefilter ahead of a loop; without a feedback controller, ahead of the plant itself."""

    prefilter: System
    controller: System | None
    plant: System

    @cached_property
    def feedback(self) -> FeedbackLoop | None:
        """Return the loop behind the prefilter, or None."""
        return None if self.controller is None else FeedbackLoop(self.controller, self.plant)

    def position_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return H = F T (or F P): volts of y per unit of reference."""
        loop = self.feedback
        behind = self.plant.response(frequency_hz) if loop is None else loop.complementary(frequency_hz)
        return self.prefilter.response(frequency_hz) * behind

    def moved_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return what of H moves: where samples also show images of held steps, without these."""
        if isinstance(self.plant, SampledSystem) and self.plant.held is not None:
            return self.command_response(frequency_hz) * self.plant.moved_response(frequency_hz)
        return self.position_response(frequency_hz)

    def command_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return F C S (or F): volts of command per unit of reference."""
        ahead = self.prefilter.response(frequency_hz)
        return ahead if self.feedback is None else ahead * self.feedback.command_sensitivity(frequency_hz)


_NEAR, _GRID = 0.9, 1500


@dataclass(frozen=True)
class Peak:
    """The greatest value of a magnitude, and the frequency (hertz) where it stands."""

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
class Margins:
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
        loop, grid = self.loop, analysis_grid_hz(self.loop)
        response = loop.open_response(grid)
        values = np.abs((1.0 - response) / (1.0 + response))
        difference, worst_hz = _peak(lambda f: np.abs(loop.sensitivity(f) - loop.complementary(f)), grid, values)
        return DiskMargin(2.0 / difference, worst_hz)

    @cached_property
    def bandwidth_hz(self) -> float:
        """Return the frequency where |T| first falls below -3 dB, hertz."""
        half, grid = 10.0 ** (-3.0 / 20.0), analysis_grid_hz(self.loop)
        values = np.abs(self.loop.complementary(grid)) - half
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

    def __str__(self) -> str:
        return (
            f"crossover {self.crossover_hz:.2f} Hz, phase margin {self.phase_margin_deg:.2f} deg, "
            f"gain margin {self.gain_margin_db:.1f} dB, max|S| {self.sensitivity_peak:.3f} "
            f"at {self.sensitivity.frequency_hz:.1f} Hz, max|T| {self.complementary_peak:.3f}, "
            f"disk margin {self.disk.alpha:.3f} at {self.disk.frequency_hz:.1f} Hz"
        )


@lru_cache(maxsize=512)
def margins(loop: FeedbackLoop) -> Margins:
    """Return the margins of `loop`, each refined to the frequency where it is attained; computed once for equal loops.

    Raises UnstableLoop if the closed loop is unstable: such a loop has none.
    """
    loop.require_stable()
    grid = analysis_grid_hz(loop)
    response = loop.open_response(grid)
    sense = Peak(*_peak(lambda f: np.abs(loop.sensitivity(f)), grid, 1.0 / np.abs(1.0 + response)))
    complement = Peak(*_peak(lambda f: np.abs(loop.complementary(f)), grid, np.abs(response / (1.0 + response))))
    crossover, phase, delay = _phase_margin(loop, grid, response)
    gain_up, gain_down, at = _gain_margins(loop.open_loop)
    rate = loop.open_loop.rate_hz if isinstance(loop.open_loop, SampledSystem) else None
    samples = None if rate is None else delay * rate
    return Margins(crossover, phase, gain_up, gain_down, at, delay, samples, sense, complement, loop)


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


def _phase_margin(loop: FeedbackLoop, grid: FloatArray, response: ComplexArray) -> tuple[float, float, float]:
    """Return (crossover_hz, phase_margin_deg, delay_margin_s), each the worst over all crossovers."""
    crossovers = _crossings(lambda f: float(np.log(np.abs(loop.open_response(f)))), grid, np.log(np.abs(response)))
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


_FACTOR, _NARROW, _INTERVALS_MAX = 1.5, 1e-8, 50_000
_AT_REST, _STEP = 1e-9, 0.1
"""Radians by which a phase changes at one point only where a root lies on the edge of stability."""


def phase_crossovers_hz(open_loop: System) -> FloatArray:
    """Return every frequency (hertz, shape (n,)) at which L is real and negative, rest and Nyquist's included.

    The phase of every root's factor rises or falls with frequency throughout: along s = j v, or v = tan(w / 2) of a
    sampled loop (z = (1 + jv)/(1 - jv)). What rises and what falls bounds the phase between two frequencies. An
    interval whose bounds hold no odd multiple of pi holds no crossover; any other is halved until it is narrow.
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
    edges = np.geomspace(low, top, 2 + int(np.log(top / low) / np.log(_FACTOR)))
    before, after = edges[:-1], edges[1:]
    while True:
        (up, up_after), (down, down_after) = (np.split(of, 2) for of in turns(np.concatenate([before, after])))
        least, most = up - down_after - goal, up_after - down - goal
        holds = np.floor(most / (2.0 * np.pi)) >= np.ceil(least / (2.0 * np.pi))
        before, after = before[holds], after[holds]
        if before.size == 0 or before.size > _INTERVALS_MAX or after[0] < before[0] * (1.0 + _NARROW):
            jumps = (most - least)[holds] > _STEP
            places = np.sqrt(before * after)[~jumps]
            return np.append(places, 0.0) if start < 0.0 and at_rest.size == 0 else places
        middle = np.sqrt(before * after)
        before, after = np.concatenate([before, middle]), np.concatenate([middle, after])
