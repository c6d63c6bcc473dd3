"""A designed controller taken apart into factors that can be dragged."""

from __future__ import annotations

import numpy as np

from tactuator.console.shaping.factors import HIGHEST_SHARE, Factor, LoopShape, at_rest
from tactuator.signals.systems import SampledSystem

_AT_ONE = 1e-9
_REAL = 1e-12
_DAMPING = (0.01, 10.0)


def taken_apart(system: SampledSystem) -> LoopShape:
    """Return the shape whose system is `system`, but for rounding: integrators, real roots and pairs by frequency and
    damping; roots that have neither (at z = -1, say) stay as they are in z.
    """
    rate_hz = system.rate_hz
    gain = system.gain
    factors: list[Factor] = []
    for side, roots, power in (("zero", system.zeros, 1.0), ("pole", system.poles, -1.0)):
        for root in (complex(one) for one in roots if one.imag > -_REAL):
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
    return Factor(f"{side}s", (hz, damping)) if _DAMPING[0] <= damping <= _DAMPING[1] else as_it_is


def _logarithms(root: complex, rate_hz: float) -> list[complex]:
    """Return s of a real root, or of both of a pair."""
    s = complex(np.log(np.complex128(root)) * rate_hz)
    return [complex(s.real)] if abs(root.imag) < _REAL else [s, s.conjugate()]
