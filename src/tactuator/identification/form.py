"""The form of a transfer function, what is known of it beforehand, and the freedom that known values leave.

Its denominator stands as sections, its numerator on a ladder of products of sections. Sections keep the numbers well
conditioned over many decades and eight poles, where coefficients of one polynomial do not. Time is scaled: s is in
units of `scale_rad_s`. Known values of the numerator bind its weights, which are linear: they move in a plane, and its
foot follows the denominator where the gain is known. Those of the denominator bind the coefficients of its sections, of
which it is a sum of products, of the first degree in each. So all derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput

Ladder = tuple[tuple[FloatArray, int], ...]
Section = tuple[float, ...]
"""The coefficients of a monic section but the first, descending."""
MOST_POLES = 8


@dataclass(frozen=True)
class Pin:
    """A value that is known. kind: "num" or "den", the coefficient of s^power (den: monic); "gain", the response at
    s = 0; "lead", the numerator's first coefficient where there are `power` poles more than zeros.
    """

    kind: Literal["num", "den", "gain", "lead"]
    power: int
    value: float


@dataclass(frozen=True)
class Form:
    """The form of a transfer function: poles, of which `integrators` at s = 0; zeros, of which `origin_zeros` at s = 0;
    dead_time: is it estimated? known: sections of known poles; pins: values that are known; both of scaled time.
    """

    poles: int
    zeros: int
    dead_time: bool = False
    integrators: int = 0
    origin_zeros: int = 0
    known: tuple[Section, ...] = ()
    pins: tuple[Pin, ...] = ()

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
        return self.poles - self.integrators - sum(len(section) for section in self.known)

    @property
    def pins_below(self) -> tuple[Pin, ...]:
        """Return the pins of the denominator: its coefficients, and the last one where gain and last coefficient of the
        numerator are both known.
        """
        pins = tuple(pin for pin in self.pins if pin.kind == "den")
        gain, last = (next((pin for pin in self.pins if is_one(pin)), None) for is_one in (_is_gain, self._is_last))
        if gain is None or last is None:
            return pins
        return (*pins, Pin("den", 0, last.value / gain.value))

    @property
    def pins_above(self) -> tuple[Pin, ...]:
        """Return the pins of the numerator."""
        gives_way = len(self.pins_below) > sum(pin.kind == "den" for pin in self.pins)
        return tuple(pin for pin in self.pins if pin.kind != "den" and not (gives_way and _is_gain(pin)))

    def _is_last(self, pin: Pin) -> bool:
        return (pin.kind == "num" and pin.power == 0) or (pin.kind == "lead" and self.zeros == 0)

    @property
    def bending(self) -> int:
        """Return the number of estimated parameters on which the response does not depend in proportion."""
        return self.free + int(self.dead_time) - len(self.pins_below)

    @property
    def numerators(self) -> int:
        """Return the number of the numerator's coefficients."""
        return self.zeros - self.origin_zeros + 1

    @property
    def count(self) -> int:
        """Return the number of parameters that are estimated."""
        return self.free + self.numerators + int(self.dead_time) - len(self.pins)


def _is_gain(pin: Pin) -> bool:
    return pin.kind == "gain"


def section_list(theta: FloatArray, form: Form) -> list[FloatArray]:
    """Return the free sections (descending, monic): s^2 + a1 s + a0 for each pair in `theta`, then s + a0."""
    pairs = [np.array([1.0, theta[2 * j], theta[2 * j + 1]]) for j in range(form.free // 2)]
    return [*pairs, np.array([1.0, theta[form.free - 1]])] if form.free % 2 else pairs


def all_sections(theta: FloatArray, form: Form) -> list[FloatArray]:
    """Return the free sections and those of known poles, but for poles at s = 0."""
    return [*section_list(theta, form), *(np.array([1.0, *section]) for section in form.known)]


def free_poles(theta: FloatArray, form: Form) -> ComplexArray:
    """Return the estimated poles, (free,)."""
    return np.array(_roots(theta, form), dtype=np.complex128)


def _roots(theta: FloatArray, form: Form, known: tuple[Section, ...] = ()) -> list[complex]:
    """Return the roots of the free sections, and of known ones."""
    values, roots = theta.tolist(), list[complex]()
    for section in (*(values[j : min(j + 2, form.free)] for j in range(0, form.free, 2)), *known):
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
    return roots


def is_stable(theta: FloatArray, form: Form) -> bool:
    """Return true where no estimated pole lies in the right half plane: no coefficient of a section is negative."""
    return bool(np.all(theta[: form.free] >= 0.0))


def all_poles(theta: FloatArray, form: Form) -> ComplexArray:
    """Return all poles, those at zero last, (poles,)."""
    return np.array([*_roots(theta, form, form.known), *[0.0] * form.integrators], dtype=np.complex128)


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


def ladder(theta: FloatArray, form: Form) -> Ladder:
    """Return numerators of ascending degree as products of sections, slow ones first: (polynomial, power of s) each."""
    slow_first = sorted(all_sections(theta, form), key=lambda factor: abs(factor[-1]) ** (1.0 / (factor.size - 1)))
    rows = [np.array([1.0, 0.0])] * form.integrators + slow_first
    rungs: list[tuple[FloatArray, int]] = []
    done = np.array([1.0])
    for section in rows:
        rungs.append((done, 0))
        if section.size == 3:
            rungs.append((done, 1))
        done = np.convolve(done, section)
    rungs.append((done, 0))
    return tuple(rungs)


def numerator_values(rungs: Ladder, s: ComplexArray, form: Form) -> ComplexArray:
    """Return the numerators at s (m,), shape (m, numerators)."""
    values = np.empty((s.size, form.numerators), dtype=np.complex128)
    last: FloatArray | None = None
    for j in range(form.numerators):
        polynomial, power = rungs[j]
        # both rungs of a pair stand on the same product
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


def numerator_polynomial(rungs: Ladder, weights: FloatArray, form: Form) -> FloatArray:
    """Return the numerator with those weights (numerators,) as one polynomial, descending, of degree `zeros`."""
    numerator = np.zeros(form.zeros + 1)
    for (polynomial, power), weight in zip(rungs, weights, strict=False):
        term = np.append(polynomial, np.zeros(power + form.origin_zeros))
        numerator[numerator.size - term.size :] += weight * term
    return numerator


def numerator_basis(rungs: Ladder, form: Form) -> FloatArray:
    """Return the numerators of weight one on each rung as columns, descending, (zeros + 1, numerators)."""
    return np.stack([numerator_polynomial(rungs, unit, form) for unit in np.eye(form.numerators)], axis=1)


def numerator_weights(rungs: Ladder, polynomial: FloatArray, form: Form) -> FloatArray:
    """Return the weights (numerators,) of the numerator that is this polynomial, descending, of degree `zeros`."""
    basis = numerator_basis(rungs, form)[: form.numerators]
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
    """Knowledge beforehand: numbers of poles and zeros (None: chosen), poles and zeros at s = 0, dead time; sections of
    known poles and values that are known, of time in seconds, of responses in the scale of the signals."""

    poles: int | None = None
    zeros: int | None = None
    integrators: int = 0
    origin_zeros: int = 0
    delay_s: float | None = None
    sections: tuple[Section, ...] = ()
    pins: tuple[Pin, ...] = ()

    @property
    def without_values(self) -> Known:
        """Return the same without known poles and values, but for poles and zeros at s = 0."""
        return replace(self, sections=(), pins=())

    @property
    def least_poles(self) -> int:
        """Return the least number of poles that a form has."""
        placed = self.integrators + sum(len(section) for section in self.sections)
        lead = max((pin.power for pin in self.pins if pin.kind == "lead"), default=0)
        return max(1, placed, self.origin_zeros + lead, (self.zeros or 0) + lead)

    def in_scale(self, scale_rad_s: float) -> Known:
        """Return the same in scaled time."""
        sections = tuple(tuple(a / scale_rad_s ** (k + 1) for k, a in enumerate(section)) for section in self.sections)
        powers = {"gain": 0, "lead": 2}
        pins = tuple(
            replace(pin, value=pin.value / scale_rad_s ** powers.get(pin.kind, (self.poles or 0) - pin.power))
            for pin in self.pins
        )
        return replace(self, sections=sections, pins=pins)

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
        `poles` of the other, of the same scaled time, less those that the known ones stand for.
        """
        for known_form in self._form(form.poles, form.zeros, form.dead_time):
            rest: ComplexArray | None = poles
            for section in self.sections:
                rest = None if rest is None else _less(rest, np.roots([1.0, *section]).astype(np.complex128))
            if rest is not None:
                yield known_form, sections_of(rest)

    def _form(self, poles: int, zeros: int, late: bool) -> Iterator[Form]:
        placed = self.integrators + sum(len(section) for section in self.sections)
        if zeros <= poles and poles >= placed:
            form = Form(poles, zeros, late, self.integrators, self.origin_zeros, self.sections, self.pins)
            if self._holds_pins(form):
                yield form

    def _holds_pins(self, form: Form) -> bool:
        fitting = {"num": lambda k: k <= form.zeros, "lead": lambda k: form.poles - form.zeros == k}
        return (
            all(fitting[pin.kind](pin.power) for pin in self.pins if pin.kind in fitting)
            and len(form.pins_below) <= form.free
            and len(form.pins_above) <= form.numerators
        )

    def allows(self, form: Form) -> bool:
        """Return true for a form that does not contradict what is known."""
        return (
            (self.poles is None or form.poles == self.poles)
            and (self.zeros is None or form.zeros == self.zeros)
            and form.zeros >= self.origin_zeros
            and form.free >= 0
            and not (form.dead_time and self.delay_s is not None)
            and self._holds_pins(form)
        )


def _less(poles: ComplexArray, known: ComplexArray) -> ComplexArray | None:
    """Return the poles without the real one, or the pair, nearest to the known; a pair leaves a real pole where one is
    known and none is real; None where there is nothing to take off.
    """
    pairs, real = poles[poles.imag > 1e-9 * np.abs(poles)], poles[np.abs(poles.imag) <= 1e-9 * np.abs(poles)]
    if known.size == 1 and real.size:
        real = np.delete(real, np.argmin(np.abs(real - known[0])))
    elif known.size == 2 and not pairs.size and real.size > 1:
        real = np.delete(real, np.argsort(np.abs(real - known[0]))[:2])
    elif pairs.size:
        nearest = int(np.argmin(np.abs(pairs - known[np.argmax(known.imag)])))
        real = np.append(real, -np.abs(pairs[nearest])) if known.size == 1 else real
        pairs = np.delete(pairs, nearest)
    else:
        return None
    return np.concatenate([pairs, np.conj(pairs), real]).astype(np.complex128)


_ROUNDS = 60
_EXACT = 1e-14


def weights_left(theta: FloatArray, form: Form, rungs: Ladder) -> tuple[FloatArray, FloatArray]:
    """Return the numerator's weights nearest to zero that obey what is known, (numerators,), and an orthonormal basis
    of the changes that they are free to make, (numerators, k).
    """
    rows, wanted, _ = _conditions(theta, form, rungs)
    if not rows.size:
        return np.zeros(form.numerators), np.eye(form.numerators)
    across, values, right = np.linalg.svd(rows)
    foot = right[: values.size].T @ (across.T @ wanted / np.maximum(values, 1e-300))
    return np.asarray(foot), np.asarray(right[values.size :].T)


def freedom(theta: FloatArray, form: Form, rungs: Ladder) -> FloatArray:
    """Return how (numerator, theta, dead time), the ladder as it is, move with what is free of them, (all, free)."""
    late = int(form.dead_time)
    if not form.pins:
        return np.eye(form.numerators + theta.size + late)
    _, basis = weights_left(theta, form, rungs)
    sections = theta_left(theta, form)
    count, first = basis.shape[1], form.numerators
    directions = np.zeros((first + theta.size + late, count + sections.shape[1] + late))
    directions[:first, :count] = basis
    directions[first : first + theta.size, count : count + sections.shape[1]] = sections
    rows, _, slopes = _conditions(theta, form, rungs)
    if rows.size:
        directions[:first, count : count + sections.shape[1]] = np.linalg.pinv(rows) @ slopes @ sections
    if late:
        directions[-1, -1] = 1.0
    return directions


def _conditions(theta: FloatArray, form: Form, rungs: Ladder) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rows (p, numerators) and wanted values (p,) of the numerator's weights, and slopes by theta (p, free)."""
    pins = form.pins_above
    rows, wanted, slopes = (
        np.zeros((len(pins), form.numerators)),
        np.zeros(len(pins)),
        np.zeros((len(pins), theta.size)),
    )
    if not pins:
        return rows, wanted, slopes
    basis = numerator_basis(rungs, form)
    last = float(np.prod([section[-1] for section in all_sections(theta, form)]))
    for k, pin in enumerate(pins):
        rows[k] = basis[{"gain": -1, "lead": 0}.get(pin.kind, -1 - pin.power)]
        wanted[k] = pin.value * (last if pin.kind == "gain" else 1.0)
        size = max(float(np.linalg.norm(rows[k])), 1e-300)
        if pin.kind == "gain":
            slopes[k] = pin.value * _coefficient_slopes(theta, form, 0) / size
        rows[k] /= size
        wanted[k] /= size
    return rows, wanted, slopes


def _coefficient_slopes(theta: FloatArray, form: Form, power: int) -> FloatArray:
    """Return the derivatives of the denominator's coefficient of s^power by theta, (free,)."""
    here = denominator_polynomial(theta, form)[-1 - power]
    slopes = np.zeros(theta.size)
    for j in range(theta.size):
        # of the first degree in each coefficient: without it, and with it alone
        without = theta.copy()
        without[j] = 0.0
        rest = denominator_polynomial(without, form)[-1 - power]
        without[j] = 1.0
        slopes[j] = denominator_polynomial(without, form)[-1 - power] - rest
    return slopes if np.isfinite(here) else np.full(theta.size, np.nan)


def theta_left(theta: FloatArray, form: Form) -> FloatArray:
    """Return a basis of the changes of theta that keep the known coefficients of the denominator, (free, k)."""
    rows = [_coefficient_slopes(theta, form, pin.power) for pin in form.pins_below]
    if not rows:
        return np.eye(theta.size)
    scale = np.maximum(np.abs(theta), 1e-9)
    matrix = np.stack(rows) * scale
    matrix /= np.maximum(np.linalg.norm(matrix, axis=1), 1e-300)[:, None]
    _, values, right = np.linalg.svd(matrix)
    return np.asarray(right[values.size :].T * scale[:, None])


def settled(theta: FloatArray, form: Form) -> FloatArray | None:
    """Return the theta nearest to this one, each coefficient by its size, that has the known coefficients of the
    denominator; None where none is found.
    """
    pins = form.pins_below
    if not pins:
        return theta
    wanted = np.array([pin.value for pin in pins])
    now, positive = theta.copy(), bool(np.all(theta > 0.0))
    for _ in range(_ROUNDS):
        values = denominator_polynomial(now, form)
        there = np.array([values[-1 - pin.power] for pin in pins])
        if np.all(np.abs(there - wanted) <= _EXACT * wanted):
            return now
        scale = np.maximum(np.abs(now), 1e-9)
        rows = np.stack([_coefficient_slopes(now, form, pin.power) for pin in pins]) * scale
        if positive and np.all(there > 0.0):
            # sums of products of positive numbers: the steps in logarithms keep them positive
            step = np.linalg.lstsq(rows / there[:, None], np.log(wanted / there), rcond=None)[0]
            now = now * np.exp(np.clip(step, -2.0, 2.0))
        else:
            now = now + scale * np.linalg.lstsq(rows, wanted - there, rcond=None)[0]
        if not np.all(np.isfinite(now)):
            return None
    return now if np.all(np.abs(there - wanted) <= 1e3 * _EXACT * wanted) else None
