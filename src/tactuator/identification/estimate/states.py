"""States of a continuous model driven by sampled signals, exact for the stated hold."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy import linalg

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.loops import run_states

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
