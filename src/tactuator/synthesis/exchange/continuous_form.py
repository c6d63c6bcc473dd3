"""A sampled filter in continuous form, for print: the continuous system whose bilinear transform it is."""

from __future__ import annotations

import numpy as np

from tactuator.signals.systems import ContinuousSystem, SampledSystem

_NYQUIST = 1e-7


def continuous_form(system: SampledSystem) -> ContinuousSystem:
    """Return the inverse of Tustin's transform, root by root: s = 2 rate (z - 1)/(z + 1); a root at z = -1 lies at
    infinity.

    The computing delay is left out.
    """
    twice = 2.0 * system.rate_hz
    zeros, poles = (roots[np.abs(roots + 1.0) > _NYQUIST] for roots in (system.zeros, system.poles))
    infinite = (system.zeros.size - zeros.size) - (system.poles.size - poles.size)
    ratio = np.prod(zeros + 1.0) / np.prod(poles + 1.0)
    # z - r = ((1 + r) / (twice - s)) (s - s_r): every finite root brings (1 + r), every pole left over (twice - s)
    gain = system.gain * float(np.real(ratio))
    left = zeros.size - poles.size + infinite
    gain *= (2.0 * twice) ** infinite
    s_zeros = twice * (zeros - 1.0) / (zeros + 1.0)
    s_poles = twice * (poles - 1.0) / (poles + 1.0)
    more = max(0, -left)
    s_zeros = np.concatenate([s_zeros, np.full(more, twice, dtype=np.complex128)])
    s_poles = np.concatenate([s_poles, np.full(max(0, left), twice, dtype=np.complex128)])
    return ContinuousSystem(s_zeros, s_poles, gain * (-1.0) ** left)
