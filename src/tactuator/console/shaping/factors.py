"""A feedback controller as a gain and factors, each with a frequency that can be dragged.

    C(z) = g * product of factors

A factor has unit gain at rest, an integrator unit gain at 1 Hz. Roots are exp(s / rate) for s of a frequency and a
damping, as in the structure that the synthesis uses, so that a factor keeps its place at any rate.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import ComplexArray
from tactuator.errors import BadInput
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
_LOWEST_HZ = 1e-3
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
            {"kind": one.kind, **dict(zip(PARAMETERS[one.kind], one.values, strict=True))} for one in self.factors
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


def shape_of(document: Mapping[str, object]) -> LoopShape:
    """Return the shape of plain values. Raises BadInput for a kind that is not known or a value that is no number."""
    listed = document.get("factors")
    if not isinstance(listed, list):
        raise BadInput(f"factors is {listed!r}", "a list of factors")
    sign = document.get("sign", 1)
    return LoopShape(_number(document, "gain_db"), tuple(_factor(one) for one in listed), 1 if sign == 1 else -1)


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
        raise BadInput(f"{name} is {value!r}", "a finite number")
    return float(value)


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise BadInput(f"{name} is {value:g}", f"{low:g} to {high:g}")


def _pair(hz: float, damping: float) -> list[complex]:
    omega = 2.0 * np.pi * hz
    inner = omega * np.sqrt(complex(damping**2 - 1.0))
    return [complex(-damping * omega + inner), complex(-damping * omega - inner)]


def _single(hz: float) -> list[complex]:
    return [complex(-2.0 * np.pi * hz)]


def _lead(one: Factor) -> Roots:
    apart = float(np.sqrt(one["ratio"]))
    return _single(one["hz"] / apart), _single(one["hz"] * apart)


def _notch(one: Factor) -> Roots:
    shallow = one["damping"] * 10.0 ** (-one["depth_db"] / 20.0)
    return _pair(one["hz"], shallow), _pair(one["hz"], one["damping"])


def _in_z(one: Factor) -> list[complex]:
    root: ComplexArray = np.array([complex(one["re"], one["im"])])
    return [complex(root[0])] if one["im"] == 0.0 else [complex(root[0]), complex(root[0].conjugate())]


_ROOTS: Mapping[str, Callable[[Factor], Roots]] = {
    "integrator": lambda one: ([], []),
    "zero": lambda one: (_single(one["hz"]), []),
    "pole": lambda one: ([], _single(one["hz"])),
    "zeros": lambda one: (_pair(one["hz"], one["damping"]), []),
    "poles": lambda one: ([], _pair(one["hz"], one["damping"])),
    "lead": _lead,
    "notch": _notch,
    "zero in z": lambda one: (_in_z(one), []),
    "pole in z": lambda one: ([], _in_z(one)),
}
