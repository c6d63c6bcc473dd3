"""Feedback loops: responses and stability, for continuous and for sampled time; `loop_figures` has their margins.

r -> F -> (+) -> e -> C -> u -> P -> y        L = C P, S = 1/(1 + L), T = L/(1 + L), H = F T
           ^-                        |
           +-------------------------+

Stability follows from zeros and poles alone, with no polynomial expanded. Sampled loops are treated in d = z - 1, where
slow poles keep their digits at any rate: a cascade of first-order factors is closed in state space, for its
eigenvalues.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
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


_LONGEST_STEP = 2**22
"""Samples of the longest half of a square wave: 87 s at 48 kHz. A pole that is slower still leaves an offset."""


def step_response(loop: FeedbackLoop, duration_s: float) -> FloatArray:
    """Return the position after a unit step of F's output, one value a sample: T's steady answer to a square wave whose
    halves outlast 20 time constants of the slowest pole.

    Raises UnstableLoop, or BadInput for a continuous loop.
    """
    loop.require_stable()
    opened = loop.open_loop
    if not isinstance(opened, SampledSystem):
        raise BadInput("a continuous loop has no samples", "a sampled one")
    samples = round(duration_s * opened.rate_hz)
    decay = 1.0 - float(np.abs(1.0 + closed_poles(opened)).max())
    half = max(samples, min(_LONGEST_STEP, 2 ** math.ceil(math.log2(20.0 / decay))))
    answer = loop.complementary(np.fft.rfftfreq(2 * half, 1.0 / opened.rate_hz))
    position = np.fft.irfft(answer * np.fft.rfft(np.repeat([1.0, 0.0], half)), 2 * half)
    return np.asarray(position[:samples] - position[-1])


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
