"""Knowledge of a form beforehand, and so which forms may be tried."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.forms.form import Form, Pin, Section, sections_of

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
        placed = self.integrators + sum(len(one) for one in self.sections)
        lead = max((pin.power for pin in self.pins if pin.kind == "lead"), default=0)
        return max(1, placed, self.origin_zeros + lead, (self.zeros or 0) + lead)

    def in_scale(self, scale_rad_s: float) -> Known:
        """Return the same in scaled time."""
        sections = tuple(tuple(a / scale_rad_s ** (k + 1) for k, a in enumerate(one)) for one in self.sections)
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
        for made in self._form(form.poles, form.zeros, form.dead_time):
            rest: ComplexArray | None = poles
            for section in self.sections:
                rest = None if rest is None else _less(rest, np.roots([1.0, *section]).astype(np.complex128))
            if rest is not None:
                yield made, sections_of(rest)

    def _form(self, poles: int, zeros: int, late: bool) -> Iterator[Form]:
        """Yield the form of so many poles and zeros, if it can have all that is known."""
        placed = self.integrators + sum(len(one) for one in self.sections)
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
