"""The C core's inner loops for identification: recursive least squares, Dahl friction, and the states of a continuous
model driven by sampled signals, exact for the stated hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import linalg

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.runtime._core import ffi, lib


def _pointer(array: FloatArray) -> Any:
    return ffi.cast("double *", ffi.from_buffer(array))


def _double(array: FloatArray) -> FloatArray:
    return np.ascontiguousarray(array, dtype=np.float64)


@dataclass(frozen=True)
class Recursion:
    """The end of `recursive_least_squares`: theta (n,), inverse information (n, n), mean squared prediction error.

    theta_history, variance_history: rows after every `every`-th sample, shape (count // every, n).
    """

    theta: FloatArray
    inverse_information: FloatArray
    prediction_variance: float
    theta_history: FloatArray
    variance_history: FloatArray


def recursive_least_squares(
    regressors: FloatArray,
    output: FloatArray,
    *,
    forgetting: float = 1.0,
    start_variance: float = 1e8,
    every: int = 1000,
) -> Recursion:
    """Solve least squares row by row: regressors (count, n), output (count,), from theta = 0 with start_variance on
    each.

    forgetting: 1 keeps everything, 0.999 halves a sample's weight in 693 samples.
    """
    rows = _double(regressors)
    values = _double(output)
    count, n = rows.shape
    if not 0.0 < forgetting <= 1.0:
        raise BadInput(f"forgetting is {forgetting:g}", "above 0, at most 1")
    if not (1 <= n <= lib.TACT_RLS_MAX and every >= 1):
        raise BadInput(f"{n} parameters, history every {every}", f"1 to {lib.TACT_RLS_MAX}, 1 or more")
    theta, m = np.zeros(n), np.eye(n) * start_variance
    theta_history, variance_history = np.zeros((count // every, n)), np.zeros((count // every, n))
    cost = np.zeros(1)
    lib.tact_rls_run(
        n, count, _pointer(rows), _pointer(values), forgetting, _pointer(theta), _pointer(m), every,
        _pointer(theta_history), _pointer(variance_history), _pointer(cost),
    )  # fmt: skip
    return Recursion(theta, m, float(cost[0]) / max(count, 1), theta_history, variance_history)


def run_states(difference: FloatArray, now: FloatArray, following: FloatArray, driver: FloatArray) -> FloatArray:
    """Return the states x[k+1] = x[k] + D x[k] + b0 u[k] + b1 u[k+1] from rest: D (n, n), b0 and b1 (n,), u (count,).

    Returns x, shape (count, n).
    """
    d, b0, b1, u = _double(difference), _double(now), _double(following), _double(driver)
    n = b0.size
    out, x = np.empty((u.size, n)), np.zeros(n)
    if lib.tact_states_run(n, _pointer(d), _pointer(b0), _pointer(b1), u.size, _pointer(u), _pointer(x), _pointer(out)):
        raise BadInput(f"{n} states", f"1 to {lib.TACT_STATES_MAX}")
    return out


def dahl_state(position: FloatArray, presliding: float) -> FloatArray:
    """Return Dahl friction's state (-1 .. 1) along `position` (count,), from 0; presliding in position's unit,
    positive.
    """
    x = _double(position)
    friction = ffi.new("tact_friction *", (1.0 / presliding, 1.0 / presliding))
    state, out = ffi.new("tact_friction_state *", (0.0, float(x[0]))), np.empty(x.size)
    lib.tact_friction_run(friction, state, _pointer(x), _pointer(out), x.size)
    return out


Hold = Literal["zero-order", "first-order"]


def companion_states(
    denominator: FloatArray, driver: FloatArray, rate_hz: float, *, hold: Hold = "zero-order", delay_s: float = 0.0
) -> FloatArray:
    """Return s^k/A(s) applied to `driver` (count,) for k = 0 .. n-1: shape (count, n), from rest.

    denominator: A, descending powers, monic, length n + 1, in rad/s. delay_s may be any fraction of a sample (with a
    first-order hold: whole samples). Source: Van Loan, Computing integrals involving the matrix exponential, 1978.
    """
    n = denominator.size - 1
    if driver.size == 0:
        return np.zeros((0, n))
    a = np.eye(n, k=1)
    a[-1] = -denominator[:0:-1]
    b = np.zeros(n)
    b[-1] = 1.0
    period = 1.0 / rate_hz
    whole, part = divmod(delay_s * rate_hz, 1.0)
    if part > 1.0 - 1e-9:
        whole, part = whole + 1, 0.0
    delayed = shift(driver, int(whole))
    first, second = _integrals(a, period)
    if hold == "first-order":
        late = second @ b / period
        return run_states(a @ first, first @ b - late, late, delayed)
    if part == 0.0:
        return run_states(a @ first, first @ b, np.zeros(n), delayed)
    early, _ = _integrals(a, part * period)
    rest, _ = _integrals(a, (1.0 - part) * period)
    carried = early @ b + a @ rest @ (early @ b)
    return run_states(a @ first, carried, rest @ b, shift(delayed, 1))


def _integrals(a: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
    """Return the integral of exp(A t) over 0 .. duration, and of that integral once more; both (n, n)."""
    n = a.shape[0]
    block = np.zeros((3 * n, 3 * n))
    block[:n, :n] = a * duration
    block[:n, n : 2 * n] = np.eye(n)
    block[n : 2 * n, 2 * n :] = np.eye(n)
    exponential = linalg.expm(block)
    return duration * exponential[:n, n : 2 * n], duration**2 * exponential[:n, 2 * n :]


def shift(values: FloatArray, samples: int) -> FloatArray:
    """Return `values` (count,) later by `samples` (earlier if negative), the first value held before the start."""
    if samples == 0:
        return values
    if samples > 0:
        return np.concatenate([np.full(min(samples, values.size), values[0]), values[: max(values.size - samples, 0)]])
    return np.concatenate([values[-samples:], np.full(min(-samples, values.size), values[-1])])
