"""A feedback controller as a gain and factors, each with a frequency that a person can drag.

    C(z) = g * product of factors

A factor has unit gain at rest, an integrator unit gain at 1 Hz. Roots are exp(s / rate) for s of a frequency and a
damping, as in the structure that the synthesis uses, so that a factor keeps its place at any rate. A designed
controller is taken apart into such factors; a point of the curve that is dragged is brought where it is wanted by a
lead or lag in its place, and the gain.
"""

from __future__ import annotations

import cmath
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from tactuator.errors import BadInput
from tactuator.signals.decibels import db
from tactuator.signals.systems import SampledSystem

PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "integrator": (),
    "zero": ("hz",),
    "pole": ("hz",),
    "zeros": ("hz", "damping"),
    "poles": ("hz", "damping"),
    "lead": ("hz", "ratio"),
    "notch": ("hz", "damping", "depth_db"),
    "zero in z": ("re", "im"),
    "pole in z": ("re", "im"),
}
"""The parameters of each kind of factor. lead: `hz` is the middle, `ratio` that of its pole to its zero; below 1 it is
a lag. notch: `damping` is that of its poles."""
FACTORS_MAX = 16
HIGHEST_SHARE = 0.49
"""The highest frequency of a factor, as a share of the sampling rate."""
_ALLOWED = {
    "damping": (0.01, 10.0),
    "ratio": (0.02, 50.0),
    "depth_db": (0.0, 60.0),
    "re": (-2.0, 2.0),
    "im": (0.0, 2.0),
}
_GAIN_DB = 200.0
_LOWEST_HZ, _LOWEST_MOVED_HZ = 1e-3, 0.01
_SAME_PLACE = 0.02
_AT_ONE, _REAL = 1e-9, 1e-12
Roots = tuple[list[complex], list[complex]]


@dataclass(frozen=True)
class Factor:
    """One factor: its kind, and the values of its parameters in the order of `PARAMETERS`."""

    kind: str
    values: tuple[float, ...] = ()

    def __getitem__(self, name: str) -> float:
        return self.values[PARAMETERS[self.kind].index(name)]


@dataclass(frozen=True)
class LoopShape:
    """A controller as a person shapes it: its gain in dB, its sign, and its factors."""

    gain_db: float
    factors: tuple[Factor, ...] = ()
    sign: int = 1

    def system(self, rate_hz: float) -> SampledSystem:
        """Return C at a sampling rate. Raises BadInput for a value out of its range, or more zeros than poles."""
        self._check(rate_hz)
        zeros: list[complex] = []
        poles: list[complex] = []
        gain = self.sign * 10.0 ** (self.gain_db / 20.0)
        for factor in self.factors:
            more, less = _ROOTS[factor.kind](factor)
            if factor.kind == "integrator":
                poles.append(1.0)
                gain *= 2.0 * np.pi / rate_hz
            elif factor.kind.endswith("in z"):
                zeros, poles = zeros + more, poles + less
            else:
                zeros += np.exp(np.array(more) / rate_hz).tolist()
                poles += np.exp(np.array(less) / rate_hz).tolist()
                gain *= at_rest(less, rate_hz) / at_rest(more, rate_hz)
        if len(zeros) > len(poles):
            raise BadInput(f"the controller has {len(zeros)} zeros and {len(poles)} poles", "no more zeros than poles")
        return SampledSystem(np.array(zeros), np.array(poles), gain, rate_hz)

    def document(self) -> dict[str, object]:
        """Return plain values for the page."""
        factors = [
            {"kind": factor.kind, **dict(zip(PARAMETERS[factor.kind], factor.values, strict=True))}
            for factor in self.factors
        ]
        return {"gain_db": self.gain_db, "sign": self.sign, "factors": factors}

    def _check(self, rate_hz: float) -> None:
        if len(self.factors) > FACTORS_MAX:
            raise BadInput(f"the controller has {len(self.factors)} factors", f"up to {FACTORS_MAX}")
        if self.sign not in (-1, 1):
            raise BadInput(f"the controller's sign is {self.sign}", "1 or -1")
        _within("gain_db", self.gain_db, -_GAIN_DB, _GAIN_DB)
        for factor in self.factors:
            for name, value in zip(PARAMETERS[factor.kind], factor.values, strict=True):
                low, high = _ALLOWED.get(name, (_LOWEST_HZ, HIGHEST_SHARE * rate_hz))
                _within(f"{factor.kind}: {name}", value, low, high)


def drag_ranges(rate_hz: float) -> dict[str, tuple[float, float]]:
    """Return the least and greatest value to which each parameter of a factor can be dragged."""
    return {"hz": (_LOWEST_MOVED_HZ, HIGHEST_SHARE * rate_hz)} | _ALLOWED


def shape_of(document: Mapping[str, object]) -> LoopShape:
    """Return the shape of plain values. Raises BadInput for a kind that is not known or a value that is no number."""
    listed = document.get("factors")
    if not isinstance(listed, list):
        raise BadInput(f"factors is {listed!r}", "a list of factors")
    sign = document.get("sign", 1)
    return LoopShape(_number(document, "gain_db"), tuple(_factor(entry) for entry in listed), 1 if sign == 1 else -1)


def at_rest(roots: list[complex], rate_hz: float) -> float:
    """Return the product of 1 - exp(s / rate) over roots s (rad/s), which come in conjugate pairs."""
    return float(np.real(np.prod(-np.expm1(np.array(roots, dtype=np.complex128) / rate_hz))))


def _factor(entry: object) -> Factor:
    if not isinstance(entry, dict) or not isinstance(kind := entry.get("kind"), str) or kind not in PARAMETERS:
        raise BadInput(f"factor {entry!r}", f"one of {', '.join(PARAMETERS)}")
    return Factor(kind, tuple(_number(entry, name) for name in PARAMETERS[kind]))


def _number(entry: Mapping[str, object], name: str) -> float:
    value = entry.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise BadInput(f"{value!r}", "a finite number", key=name)
    return float(value)


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise BadInput(f"{value:g}", f"{low:g} to {high:g}", key=name)


def _pair(hz: float, damping: float) -> list[complex]:
    omega = 2.0 * np.pi * hz
    inner = omega * np.sqrt(complex(damping**2 - 1.0))
    return [complex(-damping * omega + inner), complex(-damping * omega - inner)]


def _single(hz: float) -> list[complex]:
    return [complex(-2.0 * np.pi * hz)]


def _lead(factor: Factor) -> Roots:
    apart = float(np.sqrt(factor["ratio"]))
    return _single(factor["hz"] / apart), _single(factor["hz"] * apart)


def _notch(factor: Factor) -> Roots:
    shallow = factor["damping"] * 10.0 ** (-factor["depth_db"] / 20.0)
    return _pair(factor["hz"], shallow), _pair(factor["hz"], factor["damping"])


def _in_z(factor: Factor) -> list[complex]:
    root = complex(factor["re"], factor["im"])
    return [root] if root.imag == 0.0 else [root, root.conjugate()]


_ROOTS: Mapping[str, Callable[[Factor], Roots]] = {
    "integrator": lambda factor: ([], []),
    "zero": lambda factor: (_single(factor["hz"]), []),
    "pole": lambda factor: ([], _single(factor["hz"])),
    "zeros": lambda factor: (_pair(factor["hz"], factor["damping"]), []),
    "poles": lambda factor: ([], _pair(factor["hz"], factor["damping"])),
    "lead": _lead,
    "notch": _notch,
    "zero in z": lambda factor: (_in_z(factor), []),
    "pole in z": lambda factor: ([], _in_z(factor)),
}


def taken_apart(system: SampledSystem) -> LoopShape:
    """Return the shape whose system is `system`, but for rounding: integrators, real roots and pairs by frequency and
    damping; roots that have neither (at z = -1, say) stay as they are in z.
    """
    rate_hz = system.rate_hz
    gain = system.gain
    factors: list[Factor] = []
    for side, roots, power in (("zero", system.zeros, 1.0), ("pole", system.poles, -1.0)):
        for root in (complex(root) for root in roots if root.imag > -_REAL):
            if side == "pole" and abs(root - 1.0) < _AT_ONE:
                factors.insert(0, Factor("integrator"))
                gain *= rate_hz / (2.0 * np.pi)
                continue
            factor = _by_frequency(side, root, rate_hz)
            if factor.kind in ("zero", "pole", "zeros", "poles"):
                gain *= at_rest(_logarithms(root, rate_hz), rate_hz) ** power
            factors.append(factor)
    return LoopShape(20.0 * float(np.log10(abs(gain))), tuple(factors), 1 if gain > 0.0 else -1)


def _by_frequency(side: str, root: complex, rate_hz: float) -> Factor:
    """Return a root, or a pair of which it is the upper half, by frequency and damping where it has them."""
    as_it_is = Factor(f"{side} in z", (root.real, 0.0 if abs(root.imag) < _REAL else root.imag))
    if abs(root) < np.finfo(float).tiny or (abs(root.imag) < _REAL and root.real < 0.0):
        return as_it_is
    s = _logarithms(root, rate_hz)[0]
    hz = abs(s) / (2.0 * np.pi)
    if s.real >= 0.0 or hz > HIGHEST_SHARE * rate_hz:
        return as_it_is
    if abs(root.imag) < _REAL:
        return Factor(side, (hz,))
    damping = -s.real / abs(s)
    low, high = _ALLOWED["damping"]
    return Factor(f"{side}s", (hz, damping)) if low <= damping <= high else as_it_is


def _logarithms(root: complex, rate_hz: float) -> list[complex]:
    s = complex(np.log(np.complex128(root)) * rate_hz)
    return [complex(s.real)] if abs(root.imag) < _REAL else [s, s.conjugate()]


def with_point_at(
    shape: LoopShape, plant: SampledSystem, frequency_hz: float, turn_deg: float, level_db: float
) -> LoopShape:
    """Return the shape whose loop, at `frequency_hz`, is turned by `turn_deg` (positive: less lag) and has the level
    `level_db`.

    A lead that is there already in that place is changed, so that a drag of many steps leaves one. A turn beyond what
    one lead or lag gives ends at the most that it gives.
    """
    rate_hz = plant.rate_hz
    frequency_hz = float(np.clip(frequency_hz, _LOWEST_MOVED_HZ, HIGHEST_SHARE * rate_hz))
    place = _place_of_lead(shape, frequency_hz)
    now = 1.0 if place is None else shape.factors[place]["ratio"]
    ratio = _ratio_of(frequency_hz, _phase_deg(frequency_hz, now, rate_hz) + turn_deg, rate_hz)
    lead = Factor("lead", (frequency_hz, ratio))
    factors = list(shape.factors)
    if place is not None:
        factors[place] = lead
    elif abs(np.log(ratio)) > 1e-6:
        factors.append(lead)
    turned = replace(shape, factors=tuple(factors))
    there = np.abs(turned.system(rate_hz).response(frequency_hz) * plant.response(frequency_hz))
    return replace(turned, gain_db=turned.gain_db + level_db - float(db(there)))


def _place_of_lead(shape: LoopShape, frequency_hz: float) -> int | None:
    for place, factor in enumerate(shape.factors):
        if factor.kind == "lead" and abs(np.log(factor["hz"] / frequency_hz)) < _SAME_PLACE:
            return place
    return None


def _phase_deg(frequency_hz: float, ratio: float, rate_hz: float) -> float:
    """Return the phase of a lead at its middle, degrees: that of its zero less that of its pole."""
    turn = 2.0 * math.pi * frequency_hz / rate_hz
    z, apart = cmath.exp(1j * turn), math.sqrt(ratio)
    return math.degrees(cmath.phase((z - math.exp(-turn / apart)) / (z - math.exp(-turn * apart))))


def _ratio_of(frequency_hz: float, phase_deg: float, rate_hz: float) -> float:
    """Return the ratio of a lead whose phase at its middle is `phase_deg`, or the nearest that there is."""
    low, high = np.log(_ALLOWED["ratio"])
    missing = [_phase_deg(frequency_hz, float(np.exp(end)), rate_hz) - phase_deg for end in (low, high)]
    if missing[0] >= 0.0 or missing[1] <= 0.0:
        return _ALLOWED["ratio"][0] if missing[0] >= 0.0 else _ALLOWED["ratio"][1]
    logarithm = scipy.optimize.brentq(
        lambda x: _phase_deg(frequency_hz, float(np.exp(x)), rate_hz) - phase_deg, low, high, xtol=1e-9
    )
    return float(np.exp(logarithm))
