"""Filters as cascades of second-order sections: the integrator in the last one, exact, and the anti-windup gains.

While the command is held at its limit, the last section's two states follow (delta form, d = z - 1)

    s1 += s2 + b1 e - a1 u + g1 (clamped - u),    s2 += b2 e + g2 (clamped - u),    u = b0 e + s1,

so that they run with the characteristic polynomial d^2 + (a1 + g1) d + g2 instead of d (d + a1). The rule: the
integrator's pole moves to -r with r = 1 - exp(-2 pi crossover / rate), and the section's own pole -a1 to -q with
q = max(a1, r): while saturated, nothing in it forgets more slowly than at the speed of the loop's own crossover. Hence
g1 = r + q - a1 and g2 = r q.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.controller import AntiWindup
from tactuator.signals.systems import SampledSystem, exact_sum


def cascade(system: SampledSystem) -> FloatArray:
    """Return the second-order sections of `system` (shape (n, 6), a0 = 1), each of unit gain at rest but the first,
    which holds the gain of all: the signal keeps its size from section to section. Delay is left out.
    """
    sections = np.array(system.sections())
    for index in range(1, len(sections)):
        at_rest = exact_sum(*sections[index, :3]) / (exact_sum(*sections[index, 3:]) or np.inf)
        size = abs(at_rest)
        if 1e-6 < size < 1e6:
            sections[index, :3] /= at_rest
            sections[0, :3] *= at_rest
    return sections


_AT_ONE = 1e-9
"""Distance of a root from one that rounding explains."""
_GRAIN = 2.0**-45
"""Step to which the pole beside an integrator is rounded."""


def feedback_sections(feedback: SampledSystem) -> FloatArray:
    """Return the sections of C, shape (n, 6): the integrator, if there is one, in the last, with b and a summing
    exactly.

    The integrator is put together with the slowest real pole, which winds up as it does, and the two slowest zeros.
    """
    integrators = np.flatnonzero(np.abs(feedback.poles - 1.0) < _AT_ONE)
    if integrators.size == 0:
        return cascade(feedback)
    others = np.delete(feedback.poles, integrators[0])
    real = np.flatnonzero(np.abs(others.imag) < 1e-12)
    partner = others[real[np.argmax(np.abs(others[real]))]].real if real.size else 0.0
    if real.size:
        others = np.delete(others, real[np.argmax(np.abs(others[real]))])
    room = 2 if real.size else 1
    slowest, rest = _slowest(feedback.zeros, room)
    last = _integrator_section(slowest, partner if real.size else None)
    if others.size == 0:
        last[:3] *= feedback.gain
        return last[None]
    return np.vstack([cascade(SampledSystem(rest, others, feedback.gain, feedback.rate_hz)), last])


def _slowest(zeros: ComplexArray, count: int) -> tuple[ComplexArray, ComplexArray]:
    """Return up to `count` (1 or 2) zeros nearest z = 1, never half of a pair, and the others."""
    order = np.argsort(np.abs(zeros - 1.0), kind="stable")
    zeros = zeros[order]
    real = np.flatnonzero(np.abs(zeros.imag) < 1e-12)
    paired = np.flatnonzero(np.abs(zeros.imag) >= 1e-12)
    if count == 2 and paired.size and (real.size < 2 or paired[0] < real[0]):
        taken = paired[:2]
    else:
        taken = real[:count]
    return zeros[taken], np.delete(zeros, taken)


def _integrator_section(zeros: ComplexArray, partner: float | None) -> NDArray[np.float64]:
    order = 1 if partner is None else 2
    numerator = np.real(np.poly(zeros)) if zeros.size else np.ones(1)
    numerator = np.concatenate([np.zeros(order + 1 - numerator.size), numerator])  # missing zeros are delays
    if partner is None:
        return np.array([*numerator, 0.0, 1.0, -1.0, 0.0])
    pole = float(np.round(partner / _GRAIN) * _GRAIN)  # so that 1 - (1 + p) + p is zero in doubles
    return np.array([*numerator, 1.0, -(1.0 + pole), pole])


def anti_windup(sections: FloatArray, crossover_hz: float, rate_hz: float) -> AntiWindup:
    """Return the gains of the rule above; zero where the last section holds no integrator."""
    _, _, _, a0, a1, a2 = sections[-1]
    pole = exact_sum(a0, a0, a1) / float(a0)
    if abs(exact_sum(a0, a1, a2)) > _AT_ONE * abs(pole):
        return AntiWindup((0.0, 0.0))
    rate = -float(np.expm1(-2.0 * np.pi * crossover_hz / rate_hz))
    faster = max(pole, rate)
    return AntiWindup((rate + (faster - pole), rate * faster))
