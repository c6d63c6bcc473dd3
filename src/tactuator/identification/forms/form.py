"""The form of a transfer function, its denominator as sections, its numerator on a ladder of products of sections.

Sections keep the numbers well conditioned over many decades and eight poles, where coefficients of one polynomial do
not. Time is scaled: s is in units of `scale_rad_s`.
"""

from __future__ import annotations

from dataclasses import dataclass
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

    @property
    def free(self) -> int:
        """Return the number of poles that are estimated."""
        return self.poles - self.integrators - sum(len(one) for one in self.known)

    @property
    def pins_below(self) -> tuple[Pin, ...]:
        """Return the pins of the denominator: its coefficients, and the last one where gain and last coefficient of the
        numerator are both known.
        """
        own = tuple(pin for pin in self.pins if pin.kind == "den")
        gain, last = (next((pin for pin in self.pins if is_one(pin)), None) for is_one in (_is_gain, self._is_last))
        if gain is None or last is None:
            return own
        return (*own, Pin("den", 0, last.value / gain.value))

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
    return [*section_list(theta, form), *(np.array([1.0, *one]) for one in form.known)]


def free_poles(theta: FloatArray, form: Form) -> ComplexArray:
    """Return the estimated poles, (free,)."""
    return _roots(section_list(theta, form))


def _roots(sections: list[FloatArray]) -> ComplexArray:
    made: list[complex] = []
    for one in sections:
        if one.size == 2:
            made.append(complex(-float(one[1])))
            continue
        half, product = 0.5 * float(one[1]), float(one[2])
        under = half * half - product
        if under < 0.0:
            made += [complex(-half, (-under) ** 0.5), complex(-half, -((-under) ** 0.5))]
        else:
            # the larger root first: the smaller one as a difference would lose its digits
            large = -half - (under**0.5 if half >= 0.0 else -(under**0.5))
            made += [complex(large), complex(product / large if large else 0.0)]
    return np.array(made, dtype=np.complex128)


def is_stable(theta: FloatArray, form: Form) -> bool:
    """Return true where no estimated pole lies in the right half plane: no coefficient of a section is negative."""
    return bool(np.all(theta[: form.free] >= 0.0))


def all_poles(theta: FloatArray, form: Form) -> ComplexArray:
    """Return all poles, those at zero last, (poles,)."""
    return np.concatenate([_roots(all_sections(theta, form)), np.zeros(form.integrators)])


def sections_of(poles: NDArray[Any]) -> FloatArray:
    """Return theta of the conjugate-closed `poles`, (n,): pairs first, real poles paired by size, an odd one last."""
    values = np.asarray(poles, dtype=np.complex128)
    is_real = np.abs(values.imag) <= 1e-12 * np.abs(values)
    made: list[float] = []
    for pole in values[~is_real & (values.imag > 0.0)]:
        made += [-2.0 * pole.real, abs(pole) ** 2]
    real = np.sort(values[is_real].real).tolist()
    for k in range(0, len(real) - 1, 2):
        made += [-(real[k] + real[k + 1]), real[k] * real[k + 1]]
    return np.array([*made, -real[-1]] if len(real) % 2 else made)


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
    slow_first = sorted(all_sections(theta, form), key=lambda one: abs(one[-1]) ** (1.0 / (one.size - 1)))
    rows = [np.array([1.0, 0.0])] * form.integrators + slow_first
    made: list[tuple[FloatArray, int]] = []
    done = np.array([1.0])
    for section in rows:
        made.append((done, 0))
        if section.size == 3:
            made.append((done, 1))
        done = np.convolve(done, section)
    made.append((done, 0))
    return tuple(made)


def numerator_values(rungs: Ladder, s: ComplexArray, form: Form) -> ComplexArray:
    """Return the numerators at s (m,), shape (m, numerators)."""
    made = np.empty((s.size, form.numerators), dtype=np.complex128)
    last: FloatArray | None = None
    for j in range(form.numerators):
        polynomial, power = rungs[j]
        # both rungs of a pair stand on the same product
        if polynomial is not last:
            value, last = monic_values(polynomial, s), polynomial
        power += form.origin_zeros
        made[:, j] = value * s**power if power else value
    return made


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
    made = np.zeros(form.zeros + 1)
    for (polynomial, power), weight in zip(rungs, weights, strict=False):
        term = np.append(polynomial, np.zeros(power + form.origin_zeros))
        made[made.size - term.size :] += weight * term
    return made


def denominator_values(theta: FloatArray, form: Form, s: ComplexArray) -> ComplexArray:
    """Return the denominator at s (m,)."""
    value = s**form.integrators if form.integrators else np.ones(s.shape, dtype=np.complex128)
    for section in all_sections(theta, form):
        value = value * monic_values(section, s)
    return np.asarray(value)


def denominator_polynomial(theta: FloatArray, form: Form) -> FloatArray:
    """Return the denominator as one monic polynomial, descending."""
    made = np.append(1.0, np.zeros(form.integrators))
    for section in all_sections(theta, form):
        made = np.convolve(made, section)
    return made


def without_cancelled(poles: ComplexArray, zeros: NDArray[Any]) -> ComplexArray | None:
    """Return the poles without the real one that lies nearest to a zero; None where none is real."""
    real = np.flatnonzero(np.abs(poles.imag) <= 1e-9 * np.abs(poles))
    if not real.size or not zeros.size:
        return None
    apart = np.min(np.abs(poles[real, None] - zeros[None, :]), axis=1) / np.maximum(np.abs(poles[real]), 1e-12)
    return np.delete(poles, real[np.argmin(apart)])


def fewer_poles(poles: ComplexArray) -> tuple[ComplexArray | None, ComplexArray | None]:
    """Return the poles without the farthest and without the slowest real pole; a far pair becomes one real pole where
    none is real.
    """
    real = np.flatnonzero(np.abs(poles.imag) <= 1e-9 * np.abs(poles))
    if real.size:
        far, slow = real[np.argmax(np.abs(poles[real]))], real[np.argmin(np.abs(poles[real]))]
        return np.delete(poles, far), np.delete(poles, slow)
    if poles.size < 3:
        return None, None
    far = int(np.argmax(np.abs(poles)))
    kept = poles[np.abs(np.abs(poles) - np.abs(poles[far])) > 1e-9 * np.abs(poles[far])]
    made = np.append(kept, -np.abs(poles[far]))
    return made, made
