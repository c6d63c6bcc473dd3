"""Linear systems as zeros, poles and gain; continuous or sampled time is part of the type.

Near z = 1 a section's polynomial b0 + b1 z^-1 + b2 z^-2 is a small difference of large numbers: at 64 kHz and 0.4 Hz
nine digits go. Written in the backward difference d = 1 - z^-1,

    b0 + b1 z^-1 + b2 z^-2 = (b0 + b1 + b2) - (b1 + 2 b2) d + b2 d^2,

whose first coefficient is summed without rounding error, nothing cancels, and d itself is computed from sines.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray, frequencies
from tactuator.errors import BadInput
from tactuator.plain import brief


def exact_sum(*terms: float) -> float:
    """Return the sum of doubles, rounded once."""
    return float(sum((Fraction(float(term)) for term in terms), Fraction(0)))


def backward_difference(frequency_hz: ArrayLike, rate_hz: float) -> ComplexArray:
    """Return 1 - exp(-j w) with w = 2 pi f / rate, to full relative precision; the shape of `frequency_hz`."""
    half = np.pi * np.asarray(frequency_hz, dtype=np.float64) / rate_hz
    sine = np.sin(half)
    return np.asarray(2.0 * sine * (sine + 1j * np.cos(half)))


def check_sections(sos: ArrayLike) -> FloatArray:
    """Return `sos` as a float array of shape (n, 6), rows b0, b1, b2, a0, a1, a2. Raises BadInput if it is not one."""
    sections = np.asarray(sos, dtype=np.float64)
    if sections.ndim != 2 or sections.shape[1] != 6:
        raise BadInput(f"sections have shape {sections.shape}", "(n, 6), rows b0, b1, b2, a0, a1, a2")
    if not np.all(np.isfinite(sections)):
        raise BadInput("sections hold a number that is not finite")
    if np.any(sections[:, 3] == 0.0):
        raise BadInput("a section has a0 = 0", "any other number")
    return sections


def sections_response(sos: ArrayLike, frequency_hz: ArrayLike, rate_hz: float) -> ComplexArray:
    """Return the complex response of a cascade of sections at `frequency_hz` (any shape, hertz): its relative error is
    below 1e-12 up to 64 kHz. sos: (n, 6), rows b0, b1, b2, a0, a1, a2 in powers of z^-1.
    """
    difference = backward_difference(frequency_hz, rate_hz)
    response = np.ones_like(difference)
    for b0, b1, b2, a0, a1, a2 in check_sections(sos):
        numerator = exact_sum(b0, b1, b2) - exact_sum(b1, b2, b2) * difference + b2 * difference**2
        denominator = exact_sum(a0, a1, a2) - exact_sum(a1, a2, a2) * difference + a2 * difference**2
        response = response * numerator / denominator
    return response


def section_roots(c0: float, c1: float, c2: float) -> ComplexArray:
    """Return the roots in z of c0 + c1 z^-1 + c2 z^-2 times the power of z that its first non-zero coefficient leaves.

    Found for d = z - 1 with an exact discriminant: slow roots keep their digits at any rate, a root at z = 1 is exact.
    """
    if c2 == 0.0 or c0 == 0.0:
        if c0 != 0.0:
            return np.array([-c1 / c0, 0.0], dtype=np.complex128)
        return np.array([] if c1 == 0.0 else [-c2 / c1], dtype=np.complex128)
    lead = Fraction(float(c0))
    half = (2 * lead + Fraction(float(c1))) / lead / 2
    last = (lead + Fraction(float(c1)) + Fraction(float(c2))) / lead
    square = half * half - last
    size = float(np.sqrt(abs(float(square))))
    if square < 0:
        return np.array([complex(1.0 - float(half), size), complex(1.0 - float(half), -size)])
    far = -(float(half) + np.copysign(size, float(half)))
    near = float(last) / far if far != 0.0 else 0.0
    return np.array([1.0 + far, 1.0 + near], dtype=np.complex128)


_ON_AXIS = 2e-14
"""Imaginary part of a real root, over its size: rounding."""
_CANNOT_COMBINE = "{left} and {right} cannot be combined; expected two systems of the same kind of time and rate"
Quotient = tuple[ComplexArray, ComplexArray]


def _roots(values: ArrayLike, name: str) -> ComplexArray:
    roots = np.atleast_1d(np.asarray(values, dtype=np.complex128))
    if roots.ndim != 1 or not np.all(np.isfinite(roots)):
        raise BadInput(f"{name} must be a list of finite numbers; got {values!r}")
    _check_conjugate(roots, name)
    roots.flags.writeable = False
    return roots


def _check_conjugate(roots: ComplexArray, name: str) -> None:
    scale = 1e-6 * (1.0 + np.abs(roots))
    upper = np.sort_complex(roots[roots.imag > scale])
    lower = np.sort_complex(np.conj(roots[roots.imag < -scale]))
    if upper.size != lower.size or not np.allclose(upper, lower, rtol=1e-6):
        raise BadInput(f"complex {name} must come in conjugate pairs; got {list(roots)}")


def _polynomial(values: ArrayLike, name: str) -> FloatArray:
    coefficients = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if coefficients.ndim != 1 or not np.all(np.isfinite(coefficients)):
        raise BadInput(f"{name} must be a list of finite numbers; got {values!r}")
    coefficients = np.trim_zeros(coefficients, "f")
    if coefficients.size == 0:
        raise BadInput("zero", "a polynomial with a coefficient that is not", key=name)
    return coefficients


def _expanded(roots: ComplexArray) -> FloatArray:
    return np.atleast_1d(np.real(np.poly(roots))).astype(np.float64)


def _one_of_each_pair(roots: ComplexArray, count: int) -> ComplexArray:
    """Return the roots above the real axis, then the real ones, with zeros up to the roots of `count` sections."""
    is_real = np.abs(roots.imag) <= _ON_AXIS * np.abs(roots)
    pairs, real = np.sort_complex(roots[~is_real & (roots.imag > 0.0)]), roots[is_real].real
    return np.concatenate([pairs, np.sort(np.append(real, np.zeros(2 * (count - pairs.size) - real.size)))])


def _two_nearest(roots: ComplexArray, apart: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the root least far `apart` with its conjugate, or with the next real one, and the other roots."""
    order = np.argsort(apart, kind="stable")
    nearest = order[:1]
    if roots[nearest[0]].imag > 0.0:
        return np.append(roots[nearest], roots[nearest].conj()), np.delete(roots, nearest)
    nearest = order[roots[order].imag == 0.0][:2]
    return roots[nearest], np.delete(roots, nearest)


def _delayed(sos: FloatArray, samples: int) -> FloatArray:
    """Return the sections times z^-samples, by shifting numerators: missing zeros are at the origin."""
    for row in sos:
        while samples and row[2] == 0.0:
            row[:3] = np.roll(row[:3], 1)
            samples -= 1
    return sos


@lru_cache(maxsize=8)
def _on_circle(frequency_hz: bytes, shape: tuple[int, ...], rate_hz: float) -> tuple[ComplexArray, ComplexArray]:
    """Return z at the frequencies, and z - 1: the systems of a loop are asked at the same ones, one after the other."""
    frequency = np.frombuffer(frequency_hz).reshape(shape)
    z = np.exp(2j * np.pi * frequency / rate_hz)
    return z, backward_difference(frequency, rate_hz) * z


class _System:
    """Base of both kinds of time: zeros, poles and a real gain."""

    zeros: NDArray[Any]
    poles: NDArray[Any]
    gain: float

    def _settle(self) -> None:
        object.__setattr__(self, "zeros", _roots(self.zeros, "zeros"))
        object.__setattr__(self, "poles", _roots(self.poles, "poles"))
        if not np.isfinite(self.gain):
            raise BadInput(f"{self.gain}", "a finite number", key="gain")
        object.__setattr__(self, "gain", float(self.gain))

    def _key(self) -> tuple[Any, ...]:
        return (self.zeros.tobytes(), self.poles.tobytes(), self.gain)

    def fraction(self, frequency_hz: ArrayLike) -> Quotient:
        raise NotImplementedError

    def response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the complex response at `frequency_hz` (any shape, hertz), dead time included; infinite on a pole."""
        numerator, denominator = self.fraction(frequency_hz)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(numerator / denominator)

    @property
    def is_proper(self) -> bool:
        return self.zeros.size <= self.poles.size


@dataclass(frozen=True, eq=False)
class ContinuousSystem(_System):
    """A continuous system gain * prod(s - zeros) / prod(s - poles) * exp(-s delay_s).

    zeros, poles: complex, rad/s, shape (m,) and (n,); kept as read-only complex arrays.
    gain: of the leading coefficients. delay_s: dead time, seconds.
    """

    zeros: NDArray[Any]
    poles: NDArray[Any]
    gain: float
    delay_s: float = 0.0

    __repr__ = brief

    def __post_init__(self) -> None:
        self._settle()
        if not (np.isfinite(self.delay_s) and self.delay_s >= 0.0):
            raise BadInput(f"{self.delay_s}", "zero or more seconds", key="delay_s")

    @classmethod
    def from_polynomials(cls, num: ArrayLike, den: ArrayLike, delay_s: float = 0.0) -> ContinuousSystem:
        """Return the system num(s)/den(s), coefficients in descending powers of s."""
        numerator, denominator = _polynomial(num, "num"), _polynomial(den, "den")
        gain = numerator[0] / denominator[0]
        try:
            return cls(np.roots(numerator), np.roots(denominator), float(gain), delay_s)
        except np.linalg.LinAlgError:
            raise BadInput("num or den has coefficients too far apart for a computer", "fewer decades") from None

    def polynomials(self) -> tuple[FloatArray, FloatArray]:
        """Return (num, den) in descending powers of s, den monic: for printing and files, not for computing with."""
        return self.gain * _expanded(self.zeros), _expanded(self.poles)

    def fraction(self, frequency_hz: ArrayLike) -> Quotient:
        """Return numerator (with gain and dead time) and denominator of the response: finite even at a pole."""
        s = 2j * np.pi * frequencies(frequency_hz)
        numerator = self.gain * np.exp(-s * self.delay_s)
        for zero in self.zeros:
            numerator = numerator * (s - zero)
        denominator = np.ones(s.shape, dtype=np.complex128)
        for pole in self.poles:
            denominator = denominator * (s - pole)
        return np.asarray(numerator, dtype=np.complex128), denominator

    @property
    def is_stable(self) -> bool:
        """Return whether every pole lies strictly in the left half-plane."""
        return bool(np.all(self.poles.real < 0.0))

    def __mul__(self, other: object) -> ContinuousSystem:
        if not isinstance(other, ContinuousSystem):
            raise BadInput(_CANNOT_COMBINE.format(left=self, right=other))
        zeros, poles = np.append(self.zeros, other.zeros), np.append(self.poles, other.poles)
        return ContinuousSystem(zeros, poles, self.gain * other.gain, self.delay_s + other.delay_s)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ContinuousSystem) and (self._key(), self.delay_s) == (other._key(), other.delay_s)

    def __hash__(self) -> int:
        return hash((self._key(), self.delay_s))


@dataclass(frozen=True, eq=False)
class SampledSystem(_System):
    """A sampled system gain * prod(z - zeros) / prod(z - poles) * z^-delay_samples, at rate_hz.

    zeros, poles: complex, in the z plane, shape (m,) and (n,). held: what follows a hold, computing delay included, if
    its samples also show images of the held steps, as for an accelerometer.
    """

    zeros: NDArray[Any]
    poles: NDArray[Any]
    gain: float
    rate_hz: float
    delay_samples: int = 0
    held: ContinuousSystem | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        self._settle()
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise BadInput(f"{self.rate_hz}", "a positive number of hertz", key="rate_hz")
        if int(self.delay_samples) != self.delay_samples or self.delay_samples < 0:
            raise BadInput(f"{self.delay_samples}", "0, 1, 2, ...", key="delay_samples")

    @classmethod
    def from_sections(cls, sos: ArrayLike, rate_hz: float, delay_samples: int = 0) -> SampledSystem:
        """Return the cascade of second-order sections `sos`, shape (n, 6)."""
        sections = check_sections(sos)
        zeros = np.concatenate([np.empty(0), *(section_roots(*row[:3]) for row in sections)])
        poles = np.concatenate([np.empty(0), *(section_roots(*row[3:]) for row in sections)])
        leads = [row[:3][row[:3] != 0.0] for row in sections]
        gain = np.prod([lead[0] / row[3] if lead.size else 0.0 for lead, row in zip(leads, sections, strict=True)])
        return cls(zeros, poles, float(gain), rate_hz, delay_samples)

    def sections(self) -> FloatArray:
        """Return the second-order sections, shape (n, 6), of a proper system without its delay: the poles nearest the
        unit circle last, each with the zeros nearest it.

        As `scipy.signal.zpk2sos`, whose package takes a second to import.
        """
        if not self.is_proper:
            raise BadInput(f"a system of {self.zeros.size} zeros and {self.poles.size} poles has no causal sections")
        count = max(1, -(-self.poles.size // 2))
        poles, zeros = _one_of_each_pair(self.poles, count), _one_of_each_pair(self.zeros, count)
        sections = np.empty((count, 6))
        for row in sections[::-1]:
            nearest_one, poles = _two_nearest(poles, np.abs(1.0 - np.abs(poles)))
            nearest_it, zeros = _two_nearest(zeros, np.abs(zeros - nearest_one[0]))
            row[:] = np.append(np.poly(nearest_it).real, np.poly(nearest_one).real)
        sections[0, :3] *= self.gain
        return _delayed(sections, self.poles.size - self.zeros.size)

    def fraction(self, frequency_hz: ArrayLike) -> Quotient:
        """Return the numerator (with gain and delay) and denominator of the response: finite even where a pole lies."""
        frequency = frequencies(frequency_hz, self.rate_hz)
        z, step = _on_circle(frequency.tobytes(), frequency.shape, self.rate_hz)
        numerator = self.gain * z ** (-float(self.delay_samples))
        for zero in self.zeros:  # z - root = (1 - root) + (z - 1), and z - 1 is known to full precision
            numerator = numerator * ((1.0 - zero) + step)
        denominator = np.ones(z.shape, dtype=np.complex128)
        for pole in self.poles:
            denominator = denominator * ((1.0 - pole) + step)
        return np.asarray(numerator, dtype=np.complex128), denominator

    def moved_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the response without images of held steps, which move nothing at `frequency_hz` (any shape, hertz)."""
        if self.held is None:
            return self.response(frequency_hz)
        cycles = frequencies(frequency_hz) / self.rate_hz
        return np.asarray(self.held.response(frequency_hz) * np.sinc(cycles) * np.exp(-1j * np.pi * cycles))

    @property
    def is_stable(self) -> bool:
        """Return whether every pole lies strictly inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))

    def __mul__(self, other: object) -> SampledSystem:
        if not isinstance(other, SampledSystem) or other.rate_hz != self.rate_hz:
            raise BadInput(_CANNOT_COMBINE.format(left=self, right=other))
        zeros, poles = np.append(self.zeros, other.zeros), np.append(self.poles, other.poles)
        delay = self.delay_samples + other.delay_samples
        return SampledSystem(zeros, poles, self.gain * other.gain, self.rate_hz, delay)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SampledSystem):
            return False
        mine, theirs = (self.rate_hz, self.delay_samples), (other.rate_hz, other.delay_samples)
        return (self._key(), mine) == (other._key(), theirs)

    def __hash__(self) -> int:
        return hash((self._key(), self.rate_hz, self.delay_samples))
