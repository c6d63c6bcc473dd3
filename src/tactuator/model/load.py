"""Loads: the impedance of whatever touches a display at the finger port."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tactuator.errors import BadInput
from tactuator.signals.systems import ContinuousSystem

Quantity = Literal["displacement", "velocity", "acceleration"]
DERIVATIVES: dict[str, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Number of times that the displacement is differentiated to give the quantity."""


@dataclass(frozen=True)
class Load:
    """An impedance Z(s) = (mass s^2 + damping s + stiffness) / num[0], in the plant's own units.

    num[0] is the leading coefficient of the plant's numerator over a monic denominator, so that for a second-order
    motor the load is simply added to the denominator. Raises BadInput for a negative or infinite figure.
    """

    name: str
    mass: float
    damping: float
    stiffness: float

    def __post_init__(self) -> None:
        for field in ("mass", "damping", "stiffness"):
            value = getattr(self, field)
            if not (np.isfinite(value) and value >= 0.0):
                raise BadInput(f"load {self.name!r}: {field} is {value:g}", "zero or more")

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
        return _differentiated(ContinuousSystem(zeros, poles, float(gain), plant.delay_s), order)


def _integrated(
    plant: ContinuousSystem, order: int
) -> tuple[np.ndarray[tuple[int], np.dtype[np.complex128]], np.ndarray[tuple[int], np.dtype[np.complex128]]]:
    """Return the zeros and the added poles of plant / s^order; zeros at the origin cancel first."""
    zeros = list(plant.zeros)
    missing = order
    for zero in plant.zeros:
        if missing and abs(zero) == 0.0:
            zeros.remove(zero)
            missing -= 1
    return np.array(zeros, dtype=np.complex128), np.zeros(missing, dtype=np.complex128)


def _differentiated(system: ContinuousSystem, order: int) -> ContinuousSystem:
    zeros = np.append(system.zeros, np.zeros(order))
    return ContinuousSystem(zeros, system.poles, system.gain, system.delay_s)
