"""Plants and loads: a system as the tables of a file write it, and the impedance of what touches a display."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np

from tactuator.arrays import ComplexArray
from tactuator.errors import BadInput, within
from tactuator.parameters import NotNegative, Number, from_table, kept_by, table
from tactuator.signals.systems import ContinuousSystem

Quantity = Literal["displacement", "velocity", "acceleration"]
DERIVATIVES: dict[str, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Number of times that the displacement is differentiated to give the quantity."""
HIGHEST_RATE_HZ = 1e6  # beyond it double precision has too few digits for what is slow
_Root = Number | tuple[Number, Number]


@table("plant")
class PlantTable:
    """A plant as {num, den} in descending powers of s, or {zeros, poles, gain} (rad/s; a complex number is
    [re, im]); delay_s: its dead time.
    """

    num: tuple[Number, ...] | None = None
    den: tuple[Number, ...] | None = None
    zeros: tuple[_Root, ...] = ()
    poles: tuple[_Root, ...] | None = None
    gain: Number | None = None
    delay_s: NotNegative = 0.0

    def system(self) -> ContinuousSystem:
        """Return the system. Raises BadInput where the table is neither one nor the other, or not a system."""
        by_polynomials = self.num is not None and self.den is not None
        by_roots = self.poles is not None and self.gain is not None
        if by_polynomials == by_roots:
            raise BadInput("neither one nor the other", "{ num, den } or { zeros, poles, gain }")
        if by_polynomials:
            return ContinuousSystem.from_polynomials(self.num or (), self.den or (), self.delay_s)
        if self.gain == 0.0:
            raise BadInput("0", "any other number", key="gain")
        zeros, poles = (
            np.array([complex(*root) if isinstance(root, tuple) else root for root in roots or ()])
            for roots in (self.zeros, self.poles)
        )
        return ContinuousSystem(zeros, poles, float(self.gain or 0.0), self.delay_s)


def system_of(value: Any, *where: str) -> ContinuousSystem:
    """Return a system, or that of its table. Raises BadInput within `where`."""
    if isinstance(value, ContinuousSystem):
        return value
    if isinstance(value, PlantTable):
        plant = value
    elif isinstance(value, dict):
        plant = from_table(PlantTable, value, *where)
    else:
        raise BadInput(f"{value!r}", "{ num, den } or { zeros, poles, gain }", where=where)
    with within(*where):
        return plant.system()


System = Annotated[ContinuousSystem, *kept_by(system_of, "`{ num, den }` or `{ zeros, poles, gain }`")]
"""A continuous system, or its table."""


@table("load")
class Load:
    """An impedance Z(s) = (mass s^2 + damping s + stiffness) / num[0], in the plant's own units.

    num[0] is the leading coefficient of the plant's numerator over a monic denominator, so that for a second-order
    motor the load is simply added to the denominator. Raises BadInput for a negative or infinite figure.
    """

    name: str
    mass: NotNegative = 0.0
    damping: NotNegative = 0.0
    stiffness: NotNegative = 0.0

    def applied_to(self, plant: ContinuousSystem, quantity: Quantity = "displacement") -> ContinuousSystem:
        """Return the plant under this load: P0/(1 + P0 Z), its dead time outside; P0 gives the displacement."""
        order = DERIVATIVES[quantity]
        zeros, extra_poles = _integrated(plant, order)
        numerator = np.real(np.poly(zeros))
        denominator = np.real(np.poly(np.append(plant.poles, extra_poles)))
        impedance = np.array([self.mass, self.damping, self.stiffness])
        loaded = np.polyadd(denominator, np.polymul(numerator, impedance))
        poles = np.roots(loaded)
        gain = plant.gain / loaded[np.nonzero(loaded)[0][0]]
        return ContinuousSystem(np.append(zeros, np.zeros(order)), poles, float(gain), plant.delay_s)


def _integrated(plant: ContinuousSystem, order: int) -> tuple[ComplexArray, ComplexArray]:
    """Return the zeros and the added poles of plant / s^order; zeros at the origin cancel first."""
    zeros = list(plant.zeros)
    missing = order
    for zero in plant.zeros:
        if missing and abs(zero) == 0.0:
            zeros.remove(zero)
            missing -= 1
    return np.array(zeros, dtype=np.complex128), np.zeros(missing, dtype=np.complex128)
