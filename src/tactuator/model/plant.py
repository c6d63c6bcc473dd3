"""Plants and loads: a system as the tables of a file write it, and the impedance of what touches a display."""

from __future__ import annotations

from os import PathLike
from types import NoneType
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput, within
from tactuator.parameters import (
    LARGEST,
    SMALLEST,
    Coefficient,
    Name,
    NotNegative,
    Number,
    Positive,
    from_table,
    kept_by,
    table,
)
from tactuator.signals.exchange import from_control
from tactuator.signals.systems import ContinuousSystem, SampledSystem

Quantity = Literal["displacement", "velocity", "acceleration"]
DERIVATIVES: dict[str, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Number of times that the displacement is differentiated to give the quantity."""
_FASTEST_RAD_S = 1e9
"""Size of a pole or zero that is read: a hundred times as fast as any rate could follow."""
_GROWS = 1e-7
"""Real part of a root over the largest root that rounding does not explain, where two lie at rest."""
_PARTS: TypeAdapter[Any] = TypeAdapter(tuple[Number] | tuple[Number, Number], config=ConfigDict(defer_build=True))


def _root(value: Any) -> complex:
    if isinstance(value, complex):
        return value
    try:
        return complex(*_PARTS.validate_python(tuple(value) if isinstance(value, list | tuple) else (value,)))
    except ValidationError:
        raise BadInput(f"{value!r:.60}", f"a number or [re, im], of up to {LARGEST:g}") from None


_Root = Annotated[complex, *kept_by(_root, "a number or [re, im]")]


@table("plant")
class PlantTable:
    """A plant as {num, den} in descending powers of s, or {zeros, poles, gain} (rad/s; a complex number is
    [re, im]); delay_s: its dead time.
    """

    num: tuple[Coefficient, ...] | None = None
    den: tuple[Coefficient, ...] | None = None
    zeros: tuple[_Root, ...] = ()
    poles: tuple[_Root, ...] | None = None
    gain: Coefficient | None = None
    delay_s: Annotated[NotNegative, Field(le=10.0)] = 0.0

    def system(self) -> ContinuousSystem:
        """Return the system. Raises BadInput where the table is neither one nor the other, or not a system."""
        by_polynomials = self.num is not None and self.den is not None
        by_roots = self.poles is not None and self.gain is not None
        if by_polynomials == by_roots:
            raise BadInput("neither one nor the other", "{ num, den } or { zeros, poles, gain }")
        if by_polynomials:
            return ContinuousSystem.from_polynomials(self.num or (), self.den or (), self.delay_s)
        return ContinuousSystem(np.array(self.zeros), np.array(self.poles), float(self.gain or 0.0), self.delay_s)


def system_of(value: Any, *where: str) -> ContinuousSystem:
    """Return a plant: a system, its table, (num, den) in descending powers of s, or a continuous linear system of
    python-control or scipy.signal. Raises BadInput within `where`.
    """
    with within(*where):
        system = _given_system(value)
        if not isinstance(system, ContinuousSystem):
            raise BadInput(f"a system sampled at {system.rate_hz:g} Hz", "a continuous one")
        _require_computable(system)
        return system


def _require_computable(system: ContinuousSystem) -> None:
    """Raise BadInput for a system with more zeros than poles, and for a root or a gain beyond what can be computed."""
    if not system.is_proper:
        got = f"improper ({system.zeros.size} zeros, {system.poles.size} poles)"
        raise BadInput(got, "proper, with at least as many poles as zeros")
    for name, root in [*(("a pole", pole) for pole in system.poles), *(("a zero", zero) for zero in system.zeros)]:
        if abs(root) > _FASTEST_RAD_S:
            raise BadInput(f"{root:.4g} rad/s", f"up to {_FASTEST_RAD_S:g} rad/s in size", key=name)
    if not SMALLEST <= abs(system.gain) < 1.0 / SMALLEST:
        raise BadInput(f"{system.gain:g}", f"{SMALLEST:g} to {1.0 / SMALLEST:g} in size", key="gain")


def _given_system(value: Any) -> ContinuousSystem | SampledSystem:
    if isinstance(value, ContinuousSystem):
        return value
    if isinstance(value, dict):
        return from_table(PlantTable, value).system()
    if isinstance(value, tuple | list) and len(value) == 2:
        num, den = (np.atleast_1d(part).tolist() for part in value)
        return from_table(PlantTable, {"num": num, "den": den}).system()
    if isinstance(value, str | PathLike):
        files = "; a display file names files (`tactuator init --from` writes one)"
        raise BadInput(f"{str(value)!r}", PLANT_FORMS + files)
    if isinstance(value, bytes | int | float | tuple | list | NoneType):
        raise BadInput(f"{value!r}", PLANT_FORMS)
    return from_control(value)


PLANT_FORMS = "`{ num, den }` or `{ zeros, poles, gain }`"
System = Annotated[ContinuousSystem, *kept_by(system_of, PLANT_FORMS)]
"""A continuous system, or its table."""


@table("load")
class Load:
    """An impedance, command volts per sensor volt of displacement: Z(s) = (mass s^2 + damping s + stiffness) / per.

    per: None for the gain of a plant of the form of a motor, gain/(s^2 + bs + k), to whose denominator the load is then
    simply added. Raises BadInput for a negative or infinite figure.

    >>> tt.Load("finger", mass=0.1, damping=40.0, stiffness=3000.0).damping
    40.0
    """

    name: Name
    mass: NotNegative = 0.0
    damping: NotNegative = 0.0
    stiffness: NotNegative = 0.0
    per: Positive | None = None

    def impedance(self, plant: ContinuousSystem, quantity: Quantity = "displacement") -> FloatArray:
        """Return the coefficients of Z in descending powers of s, (3,); plant: whose scale it is in where `per` is not
        stated. Raises BadInput where that plant is not of the form of a motor.
        """
        per = motor_gain(plant, quantity) if self.per is None else float(np.copysign(self.per, plant.gain))
        if per is None:
            raise BadInput(
                f"not stated for load {self.name!r}, and the plant is not of the form gain/(s^2 + bs + k), whose gain "
                "is the scale of loads",
                "a number with which (mass s^2 + damping s + stiffness)/per is in command volts per sensor volt; for a "
                "load in kg, N·s/m and N/m: newtons per command volt × sensor volts per metre",
                key="per",
            )
        return np.array([self.mass, self.damping, self.stiffness]) / per

    def applied_to(
        self, plant: ContinuousSystem, quantity: Quantity = "displacement", nominal: ContinuousSystem | None = None
    ) -> ContinuousSystem:
        """Return a plant under this load: P/(1 + P0 Z), its dead time outside; P0 gives the displacement. nominal: the
        plant whose scale the load is in; None for `plant`.

        Raises BadInput where the scale is missing, for a zero in the right half plane, and where a stable plant becomes
        unstable: a point that is pushed and touched has no such zero, and nothing passive makes it unstable.
        """
        impedance = self.impedance(nominal or plant, quantity)
        allowed = "a plant of the point that is touched, with its dead time as delay_s; or no load"
        ahead = plant.zeros[plant.zeros.real > _GROWS * np.max(np.abs(plant.zeros), initial=0.0)]
        if ahead.size:
            got = f"a list, while the plant has a zero at {ahead[0].real:+.4g} rad/s, in the right half plane"
            raise BadInput(got, allowed, key="loads")
        order = DERIVATIVES[quantity]
        zeros, extra_poles = _integrated(plant, order)
        numerator = np.real(np.poly(zeros))
        denominator = np.real(np.poly(np.append(plant.poles, extra_poles)))
        loaded = np.polyadd(denominator, np.polymul(numerator, plant.gain * impedance))
        poles = np.roots(loaded)
        if np.max(poles.real) > _GROWS * np.max(np.abs(poles)) and not np.any(plant.poles.real > 0.0):
            got = f"a list, of which one makes the plant unstable (a pole at {np.max(poles.real):+.4g} rad/s)"
            raise BadInput(got, allowed, key="loads")
        gain = plant.gain / loaded[np.nonzero(loaded)[0][0]]
        loaded_plant = ContinuousSystem(np.append(zeros, np.zeros(order)), poles, float(gain), plant.delay_s)
        with within(f"load {self.name!r}"):
            _require_computable(loaded_plant)
        return loaded_plant


def motor_gain(plant: ContinuousSystem, quantity: Quantity = "displacement") -> float | None:
    """Return the gain of a plant whose displacement is gain/(s^2 + bs + k); None for a plant of another form."""
    zeros, extra_poles = _integrated(plant, DERIVATIVES[quantity])
    return plant.gain if zeros.size == 0 and plant.poles.size + extra_poles.size == 2 else None


def _integrated(plant: ContinuousSystem, order: int) -> tuple[ComplexArray, ComplexArray]:
    """Return the zeros and the added poles of plant / s^order; zeros at the origin cancel first."""
    zeros = list(plant.zeros)
    missing = order
    for zero in plant.zeros:
        if missing and abs(zero) == 0.0:
            zeros.remove(zero)
            missing -= 1
    return np.array(zeros, dtype=np.complex128), np.zeros(missing, dtype=np.complex128)
