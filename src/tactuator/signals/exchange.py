"""To and from python-control, from scipy.signal, and a sampled filter in continuous form, for print.

python-control is optional and imported when asked for. Systems go over as state space built factor by factor, not as
polynomials: its transfer functions lose all their digits for a prefilter in series with a loop at 4 kHz.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from tactuator.errors import BadInput
from tactuator.signals.systems import ContinuousSystem, SampledSystem

System = ContinuousSystem | SampledSystem


def to_control(system: System) -> Any:
    """Return the system as a python-control StateSpace (dt = 0, or the sampling period; delay as poles at z = 0).

    Raises BadInput without python-control, for an improper system, or for continuous dead time, which it cannot hold.

    >>> tt.to_control(controller.loop("index").controller).dt
    0.00025
    """
    control = _control()
    if isinstance(system, ContinuousSystem) and system.delay_s > 0.0:
        raise BadInput(f"python-control holds no dead time of {system.delay_s:g} s", "a system without")
    if not system.is_proper:
        raise BadInput(
            f"a system of {system.zeros.size} zeros and {system.poles.size} poles has no state space",
            "no more zeros than poles",
        )
    step: float = 1.0 / system.rate_hz if isinstance(system, SampledSystem) else 0
    series = control.ss([], [], [], [[system.gain]], step)
    for zeros, poles in _factors(system):
        series = series * control.ss(*_factor_matrices(zeros, poles), step)
    for _ in range(system.delay_samples if isinstance(system, SampledSystem) else 0):
        series = series * control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]], step)
    return series


def from_control(system: Any) -> System:
    """Return a linear system of python-control or scipy.signal, of one input and one output, as a system of ours.

    Raises BadInput for another object, for more inputs or outputs, or for an unspecified sampling period.

    >>> tt.from_control(tt.to_control(controller.loop("index").controller)).rate_hz
    4000.0
    """
    if hasattr(system, "to_zpk"):  # scipy.signal; its continuous systems have no period
        counts, period = (system.inputs, system.outputs), 0.0 if system.dt is None else system.dt
    elif hasattr(system, "ninputs") and hasattr(system, "poles"):
        counts, period = (system.ninputs, system.noutputs), system.dt
    else:
        raise BadInput(f"of type {type(system).__name__}", "a linear system of python-control or scipy.signal")
    if counts != (1, 1):
        raise BadInput(f"of {counts[0]} inputs and {counts[1]} outputs", "one of each")
    if period is None or period is True:
        raise BadInput(f"{period}", "0 for continuous time, or seconds", key="sampling period")
    if hasattr(system, "to_zpk"):
        with warnings.catch_warnings(action="error"):
            try:
                factors = system.to_zpk()
            except Warning:  # a state space whose numerator would begin with what is left of rounding
                raise BadInput("a state space without exact zeros", "its zeros, poles and gain") from None
        zeros, poles, gain = factors.zeros, factors.poles, float(factors.gain)
    else:
        zeros, poles = np.asarray(system.zeros()), np.asarray(system.poles())
        gain = _gain(system, zeros, poles)
    return SampledSystem(zeros, poles, gain, 1.0 / float(period)) if period else ContinuousSystem(zeros, poles, gain)


def _control() -> Any:
    try:
        return importlib.import_module("control")
    except ImportError:
        raise BadInput("python-control is not installed: pip install control") from None


def _factors(system: System) -> Iterator[tuple[Any, Any]]:
    """Yield the zeros and poles in groups of two poles, real or a conjugate pair, or of the last real one, each with as
    many zeros at most: every pair of zeros finds a place.
    """
    zeros, poles = (np.array(sorted(roots, key=abs), dtype=np.complex128) for roots in (system.zeros, system.poles))
    real = poles[poles.imag == 0.0]
    groups = [np.array([pole, np.conj(pole)]) for pole in poles[poles.imag > 0.0]]
    groups += [real[i : i + 2] for i in range(0, real.size, 2)]
    pairs, singles = zeros[zeros.imag > 0.0].tolist(), zeros[zeros.imag == 0.0].tolist()
    for group in groups:
        if group.size == 2 and pairs:
            zero = pairs.pop(0)
            yield np.array([zero, np.conj(zero)]), group
        else:
            taken = [singles.pop(0) for _ in range(min(group.size, len(singles)))]
            yield np.array(taken, dtype=np.complex128), group


def _factor_matrices(zeros: Any, poles: Any) -> tuple[Any, Any, Any, Any]:
    """Return the controllable form of prod(x - zeros) / prod(x - poles) of order one or two."""
    den, num = np.real(np.poly(poles)), np.atleast_1d(np.real(np.poly(zeros)))
    order = poles.size
    num = np.concatenate([np.zeros(order + 1 - num.size), num])
    direct = num[0]
    rest = num[1:] - direct * den[1:]
    if order == 1:
        return [[-den[1]]], [[1.0]], [[rest[0]]], [[direct]]
    return [[-den[1], -den[2]], [1.0, 0.0]], [[1.0], [0.0]], [list(rest)], [[direct]]


def _gain(system: Any, zeros: Any, poles: Any) -> float:
    size = 1.0 + float(np.max(np.abs(np.concatenate([zeros, poles])), initial=0.0))
    point = size * (1.3 + 0.7j)
    value = complex(system(point))
    return float(np.real(value * np.prod(point - poles) / np.prod(point - zeros)))


def continuous_form(system: SampledSystem) -> ContinuousSystem:
    """Return the inverse of Tustin's transform, root by root: s = 2 rate (z - 1)/(z + 1); a root at z = -1 lies at
    infinity.

    The computing delay is left out.
    """
    twice = 2.0 * system.rate_hz
    # distance from z = -1 within which a root lies there: what a zero of high multiplicity loses to rounding
    zeros, poles = (roots[np.abs(roots + 1.0) > 1e-7] for roots in (system.zeros, system.poles))
    missing = np.full(system.poles.size - system.zeros.size, twice)  # zeros at infinity of z
    s_zeros = np.append(twice * (zeros - 1.0) / (zeros + 1.0), missing)
    shape = ContinuousSystem(s_zeros, twice * (poles - 1.0) / (poles + 1.0), 1.0)
    # a quarter of the rate, z = j, is s = 2j rate
    gain = replace(system, delay_samples=0).response(0.25 * system.rate_hz) / shape.response(twice / (2.0 * np.pi))
    return replace(shape, gain=float(np.real(gain)))
