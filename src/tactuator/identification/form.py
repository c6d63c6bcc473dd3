"""The form of a transfer function, what is known of it beforehand, and the freedom that known values leave.

Its denominator is a product of sections, its numerator is on stages of products of sections. Sections keep the numbers
well conditioned over many decades and eight poles, where coefficients of one polynomial do not. Time is scaled: s is in
units of `scale_rad_s`. A gain at s = 0 that is known binds the numerator's weights, which are linear: they move in a
plane, and its foot follows the denominator. So all derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput

Stages = tuple[tuple[FloatArray, int], ...]
MOST_POLES = 8
"""Most poles of a form: four resonances."""


@dataclass(frozen=True)
class Form:
    """The form of a transfer function: poles, of which `integrators` at s = 0; zeros, of which `origin_zeros` at s = 0;
    dead_time: is it estimated? known: rates of real poles that are known, of scaled time; gain: the response at s = 0,
    where it is known.
    """

    poles: int
    zeros: int
    dead_time: bool = False
    integrators: int = 0
    origin_zeros: int = 0
    known: tuple[float, ...] = ()
    gain: float | None = None

    def __post_init__(self) -> None:
        if not (1 <= self.poles <= MOST_POLES and self.integrators >= 0 and self.free >= 0):
            raise BadInput(
                f"{self.poles} poles, {self.poles - self.free} of them known", f"1 to {MOST_POLES}, no more known"
            )
        if not self.origin_zeros <= self.zeros <= self.poles:
            raise BadInput(f"{self.zeros} zeros for {self.poles} poles", f"{self.origin_zeros} to {self.poles}")

    @cached_property
    def free(self) -> int:
        """Return the number of poles that are estimated."""
        return self.poles - self.integrators - len(self.known)

    @property
    def bending(self) -> int:
        """Return the number of estimated parameters on which the response does not depend in proportion."""
        return self.free + int(self.dead_time)

    @property
    def numerators(self) -> int:
        """Return the number of the numerator's coefficients."""
        return self.zeros - self.origin_zeros + 1

    @property
    def count(self) -> int:
        """Return the number of parameters that are estimated."""
        return self.free + self.numerators + int(self.dead_time) - int(self.gain is not None)


def section_list(theta: FloatArray, form: Form) -> list[FloatArray]:
    """Return the free sections (descending, monic): s^2 + a1 s + a0 for each pair in `theta`, then s + a0."""
    pairs = [np.array([1.0, theta[2 * j], theta[2 * j + 1]]) for j in range(form.free // 2)]
    return [*pairs, np.array([1.0, theta[form.free - 1]])] if form.free % 2 else pairs


def all_sections(theta: FloatArray, form: Form) -> list[FloatArray]:
    """Return the free sections and those of known poles, but for poles at s = 0."""
    return [*section_list(theta, form), *(np.array([1.0, rate]) for rate in form.known)]


def free_poles(theta: FloatArray, form: Form) -> ComplexArray:
    """Return the estimated poles, (free,)."""
    values, roots = theta.tolist(), list[complex]()
    for section in (values[j : min(j + 2, form.free)] for j in range(0, form.free, 2)):
        if len(section) == 1:
            roots.append(complex(-section[0]))
            continue
        half, product = 0.5 * section[0], section[1]
        under = half * half - product
        if under < 0.0:
            roots += [complex(-half, (-under) ** 0.5), complex(-half, -((-under) ** 0.5))]
        else:
            # the larger root first: the smaller one as a difference would lose its digits
            large = -half - (under**0.5 if half >= 0.0 else -(under**0.5))
            roots += [complex(large), complex(product / large if large else 0.0)]
    return np.array(roots, dtype=np.complex128)


def is_stable(theta: FloatArray, form: Form) -> bool:
    """Return true where no estimated pole lies in the right half plane: no coefficient of a section is negative."""
    return bool(np.all(theta[: form.free] >= 0.0))


def all_poles(theta: FloatArray, form: Form) -> ComplexArray:
    """Return all poles, those at zero last, (poles,)."""
    known = [*(-rate for rate in form.known), *[0.0] * form.integrators]
    return np.concatenate([free_poles(theta, form), known]).astype(np.complex128)


def growth(theta: FloatArray, form: Form) -> float:
    """Return the sum of the real parts of the estimated poles in the right half plane, scaled."""
    if is_stable(theta, form):
        return 0.0
    return float(np.sum(np.maximum(free_poles(theta, form).real, 0.0)))


def sections_of(poles: NDArray[Any]) -> FloatArray:
    """Return theta of the conjugate-closed `poles`, (n,): pairs first, real poles paired by size, an odd one last."""
    values = np.asarray(poles, dtype=np.complex128)
    is_real = np.abs(values.imag) <= 1e-12 * np.abs(values)
    sections: list[float] = []
    for pole in values[~is_real & (values.imag > 0.0)]:
        sections += [-2.0 * pole.real, abs(pole) ** 2]
    real = np.sort(values[is_real].real).tolist()
    for k in range(0, len(real) - 1, 2):
        sections += [-(real[k] + real[k + 1]), real[k] * real[k + 1]]
    return np.array([*sections, -real[-1]] if len(real) % 2 else sections)


def separated(poles: ComplexArray) -> ComplexArray:
    """Return the poles with those that coincide moved apart by 1e-4 of their size: residues need single poles.

    The error of the response is of the square of that.
    """
    moved = poles.copy()
    for i in range(moved.size):
        for j in range(i):
            size = max(abs(moved[i]), 1e-9)
            if abs(moved[i] - moved[j]) < 2e-4 * size:
                middle = 0.5 * (moved[i] + moved[j])
                step = 1e-4 * max(abs(middle), 1e-6)
                apart = 1j * step if abs(middle.imag) <= 1e-9 * abs(middle) else step
                moved[i], moved[j] = middle + apart, middle - apart
    return moved


def stages_of(theta: FloatArray, form: Form) -> Stages:
    """Return numerators of ascending degree as products of sections, slow ones first: (polynomial, power of s) each."""
    slow_first = sorted(all_sections(theta, form), key=lambda factor: abs(factor[-1]) ** (1.0 / (factor.size - 1)))
    rows = [np.array([1.0, 0.0])] * form.integrators + slow_first
    stages: list[tuple[FloatArray, int]] = []
    done = np.array([1.0])
    for section in rows:
        stages.append((done, 0))
        if section.size == 3:
            stages.append((done, 1))
        done = np.convolve(done, section)
    stages.append((done, 0))
    return tuple(stages)


def numerator_values(stages: Stages, s: ComplexArray, form: Form) -> ComplexArray:
    """Return the numerators at s (m,), shape (m, numerators)."""
    values = np.empty((s.size, form.numerators), dtype=np.complex128)
    last: FloatArray | None = None
    for j in range(form.numerators):
        polynomial, power = stages[j]
        # both stages of a pair have the same product
        if polynomial is not last:
            value, last = monic_values(polynomial, s), polynomial
        power += form.origin_zeros
        values[:, j] = value * s**power if power else value
    return values


def monic_values(polynomial: FloatArray, s: ComplexArray) -> ComplexArray:
    """Return the values at s (m,) of a polynomial (descending) whose first coefficient is one."""
    if polynomial.size == 1:
        return np.ones(s.shape, dtype=np.complex128)
    value = s + polynomial[1]
    for coefficient in polynomial[2:]:
        value = value * s + coefficient
    return np.asarray(value)


def numerator_polynomial(stages: Stages, weights: FloatArray, form: Form) -> FloatArray:
    """Return the numerator with those weights (numerators,) as one polynomial, descending, of degree `zeros`."""
    numerator = np.zeros(form.zeros + 1)
    for (polynomial, power), weight in zip(stages, weights, strict=False):
        term = np.append(polynomial, np.zeros(power + form.origin_zeros))
        numerator[numerator.size - term.size :] += weight * term
    return numerator


def numerator_basis(stages: Stages, form: Form) -> FloatArray:
    """Return the numerators of weight one on each stage as columns, descending, (zeros + 1, numerators)."""
    return np.stack([numerator_polynomial(stages, unit, form) for unit in np.eye(form.numerators)], axis=1)


def numerator_weights(stages: Stages, polynomial: FloatArray, form: Form) -> FloatArray:
    """Return the weights (numerators,) of the numerator that is this polynomial, descending, of degree `zeros`."""
    basis = numerator_basis(stages, form)[: form.numerators]
    return np.asarray(np.linalg.solve(basis, polynomial[: form.numerators]), dtype=np.float64)


def denominator_values(theta: FloatArray, form: Form, s: ComplexArray) -> ComplexArray:
    """Return the denominator at s (m,)."""
    value = s**form.integrators if form.integrators else np.ones(s.shape, dtype=np.complex128)
    for section in all_sections(theta, form):
        value = value * monic_values(section, s)
    return np.asarray(value)


def denominator_polynomial(theta: FloatArray, form: Form) -> FloatArray:
    """Return the denominator as one monic polynomial, descending."""
    denominator = np.append(1.0, np.zeros(form.integrators))
    for section in all_sections(theta, form):
        denominator = np.convolve(denominator, section)
    return denominator


def without_cancelled(poles: ComplexArray, zeros: NDArray[Any]) -> ComplexArray | None:
    """Return the poles without the one that lies nearest to a zero, or its pair; None where there is no zero."""
    if not poles.size or not zeros.size:
        return None
    apart = np.min(np.abs(poles[:, None] - zeros[None, :]), axis=1) / np.maximum(np.abs(poles), 1e-12)
    nearest = poles[np.argmin(apart)]
    return np.asarray(poles[np.minimum(abs(poles - nearest), abs(poles - nearest.conj())) > 1e-9 * abs(nearest)])


def fewer_poles(poles: ComplexArray) -> tuple[ComplexArray | None, ComplexArray | None]:
    """Return the poles less the farthest, and less the slowest real one; where none is real a far pair becomes one."""
    real = np.flatnonzero(np.abs(poles.imag) <= 1e-9 * np.abs(poles))
    if real.size:
        far, slow = real[np.argmax(np.abs(poles[real]))], real[np.argmin(np.abs(poles[real]))]
        return np.delete(poles, far), np.delete(poles, slow)
    if poles.size < 3:
        return None, None
    far = int(np.argmax(np.abs(poles)))
    kept = poles[np.abs(np.abs(poles) - np.abs(poles[far])) > 1e-9 * np.abs(poles[far])]
    fewer = np.append(kept, -np.abs(poles[far]))
    return fewer, fewer


MANY = 4
"""Poles from which on a form may have as many zeros."""


@dataclass(frozen=True)
class Known:
    """Knowledge beforehand: numbers of poles and zeros (None: chosen), poles and zeros at s = 0, dead time, rates of
    real poles (1/s), and the gain at s = 0 in the scale of the signals."""

    poles: int | None = None
    zeros: int | None = None
    integrators: int = 0
    origin_zeros: int = 0
    delay_s: float | None = None
    rates: tuple[float, ...] = ()
    gain: float | None = None

    @property
    def without_values(self) -> Known:
        """Return the same without gain and poles that are known, but for poles and zeros at s = 0."""
        return replace(self, rates=(), gain=None)

    @property
    def least_poles(self) -> int:
        """Return the least number of poles that a form has."""
        return max(1, self.integrators + len(self.rates), self.origin_zeros, self.zeros or 0)

    def in_scale(self, scale_rad_s: float) -> Known:
        """Return the same in scaled time."""
        return replace(self, rates=tuple(rate / scale_rad_s for rate in self.rates))

    def forms(self, poles: int) -> Iterator[Form]:
        """Yield the forms of that many poles that are allowed, without and with a dead time to estimate."""
        most = self.zeros if self.zeros is not None else min(poles - 1, 2 + self.origin_zeros)
        least = self.zeros if self.zeros is not None else min(self.origin_zeros, poles)
        for late in (False, True) if self.delay_s is None else (False,):
            for zeros in range(least, max(most, least) + 1):
                yield from self._form(poles, zeros, late)

    def full_forms(self, poles: int, late: bool) -> Iterator[Form]:
        """Yield the forms of that many poles with as many zeros or one less: what structures with many modes show.

        late: with a dead time to estimate.
        """
        if self.zeros is None and poles >= max(MANY, self.integrators, self.origin_zeros + 1):
            for zeros in (poles - 1, poles):
                yield from self._form(poles, zeros, late and self.delay_s is None)

    def like(self, form: Form, poles: ComplexArray) -> Iterator[tuple[Form, FloatArray]]:
        """Yield the form with as many poles and zeros that has what is known, and where to start it: at the free
        `poles` of the other, of the same scaled time, less the known ones.
        """
        for known_form in self._form(form.poles, form.zeros, form.dead_time):
            rest: ComplexArray | None = poles
            for rate in self.rates:
                rest = None if rest is None else _less(rest, rate)
            if rest is not None:
                yield known_form, sections_of(rest)

    def _form(self, poles: int, zeros: int, late: bool) -> Iterator[Form]:
        if zeros <= poles and poles >= self.integrators + len(self.rates):
            yield Form(poles, zeros, late, self.integrators, self.origin_zeros, self.rates, self.gain)

    def allows(self, form: Form) -> bool:
        """Return true for a form that does not contradict what is known."""
        return (
            (self.poles is None or form.poles == self.poles)
            and (self.zeros is None or form.zeros == self.zeros)
            and form.zeros >= self.origin_zeros
            and form.free >= 0
            and not (form.dead_time and self.delay_s is not None)
        )


def _less(poles: ComplexArray, rate: float) -> ComplexArray | None:
    """Return the poles without the real one nearest to -rate; of none but pairs the nearest leaves a real one. None
    where there is nothing to take off.
    """
    pairs, real = poles[poles.imag > 1e-9 * np.abs(poles)], poles[np.abs(poles.imag) <= 1e-9 * np.abs(poles)]
    if real.size:
        real = np.delete(real, np.argmin(np.abs(real + rate)))
    elif pairs.size:
        nearest = int(np.argmin(np.abs(pairs + rate)))
        real, pairs = np.append(real, -np.abs(pairs[nearest])), np.delete(pairs, nearest)
    else:
        return None
    return np.concatenate([pairs, np.conj(pairs), real]).astype(np.complex128)


def weights_left(theta: FloatArray, form: Form, stages: Stages) -> tuple[FloatArray, FloatArray]:
    """Return the numerator's weights nearest to zero that have the known gain, (numerators,), and an orthonormal basis
    of the changes that they are free to make, (numerators, k).
    """
    if form.gain is None:
        return np.zeros(form.numerators), np.eye(form.numerators)
    row, wanted, _ = _gain_condition(theta, form, form.gain, stages)
    return row * wanted, np.linalg.svd(row[None])[2][1:].T


def freedom(theta: FloatArray, form: Form, stages: Stages) -> FloatArray:
    """Return how (numerator, theta, dead time), the stages as they are, move with what is free of them, (all, free)."""
    size, first = form.numerators + theta.size + int(form.dead_time), form.numerators
    if form.gain is None:
        return np.eye(size)
    _, basis = weights_left(theta, form, stages)
    row, _, slopes = _gain_condition(theta, form, form.gain, stages)
    directions = np.zeros((size, size - 1))
    directions[:first, : first - 1] = basis
    directions[:first, first - 1 : first - 1 + theta.size] = np.outer(row, slopes)
    directions[first:, first - 1 :] = np.eye(size - first)
    return directions


def _gain_condition(theta: FloatArray, form: Form, gain: float, stages: Stages) -> tuple[FloatArray, float, FloatArray]:
    """Return a row of unit length (numerators,) and what it has to make of the numerator's weights for that gain at
    s = 0, and how this moves with theta, (free,).
    """
    row = numerator_basis(stages, form)[-1]
    size = max(float(np.linalg.norm(row)), 1e-300)
    lasts = np.array([section[-1] for section in all_sections(theta, form)])
    slopes, free = np.zeros(theta.size), -(-form.free // 2)
    for j in range(free):
        slopes[min(2 * j + 1, form.free - 1)] = np.prod(np.delete(lasts, j))
    return row / size, gain * float(np.prod(lasts)) / size, gain * slopes / size
