"""Freedom that known values leave to the parameters of a transfer function.

Those of the numerator bind its weights, which are linear: they move in a plane, and its foot follows the denominator
where the gain is known. Those of the denominator bind the coefficients of its sections, of which it is a sum of
products, of the first degree in each. So all derivatives are exact.
"""

from __future__ import annotations

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.forms.form import (
    Form,
    Ladder,
    all_sections,
    denominator_polynomial,
    numerator_polynomial,
)

_ROUNDS = 60
_EXACT = 1e-14


def bound(form: Form) -> bool:
    """Return true where values of the denominator's coefficients are known."""
    return bool(form.pins_below)


def weights_left(theta: FloatArray, form: Form, rungs: Ladder) -> tuple[FloatArray, FloatArray]:
    """Return the numerator's weights nearest to zero that obey what is known, (numerators,), and an orthonormal basis
    of the changes that they are free to make, (numerators, k).
    """
    rows, wanted, _ = _conditions(theta, form, rungs)
    if not rows.size:
        return np.zeros(form.numerators), np.eye(form.numerators)
    left, values, right = np.linalg.svd(rows)
    foot = right[: values.size].T @ (left.T @ wanted / np.maximum(values, 1e-300))
    return np.asarray(foot), np.asarray(right[values.size :].T)


def freedom(theta: FloatArray, form: Form, rungs: Ladder) -> FloatArray:
    """Return how (numerator, theta, dead time), the ladder as it is, move with what is free of them, (all, free)."""
    late = int(form.dead_time)
    if not form.pins:
        return np.eye(form.numerators + theta.size + late)
    _, basis = weights_left(theta, form, rungs)
    sections = theta_left(theta, form)
    count, first = basis.shape[1], form.numerators
    made = np.zeros((first + theta.size + late, count + sections.shape[1] + late))
    made[:first, :count] = basis
    made[first : first + theta.size, count : count + sections.shape[1]] = sections
    rows, _, slopes = _conditions(theta, form, rungs)
    if rows.size:
        made[:first, count : count + sections.shape[1]] = np.linalg.pinv(rows) @ slopes @ sections
    if late:
        made[-1, -1] = 1.0
    return made


def _conditions(theta: FloatArray, form: Form, rungs: Ladder) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rows (p, numerators) and wanted values (p,) of the numerator's weights, and how these move with theta, (p,
    free).
    """
    pins = form.pins_above
    rows, wanted, slopes = (
        np.zeros((len(pins), form.numerators)),
        np.zeros(len(pins)),
        np.zeros((len(pins), theta.size)),
    )
    if not pins:
        return rows, wanted, slopes
    basis = np.stack([numerator_polynomial(rungs, unit, form) for unit in np.eye(form.numerators)], axis=1)
    last = float(np.prod([one[-1] for one in all_sections(theta, form)]))
    for k, pin in enumerate(pins):
        rows[k] = basis[{"gain": -1, "lead": 0}.get(pin.kind, -1 - pin.power)]
        wanted[k] = pin.value * (last if pin.kind == "gain" else 1.0)
        size = max(float(np.linalg.norm(rows[k])), 1e-300)
        if pin.kind == "gain":
            slopes[k] = pin.value * _coefficient_slopes(theta, form, 0) / size
        rows[k] /= size
        wanted[k] /= size
    return rows, wanted, slopes


def _coefficient_slopes(theta: FloatArray, form: Form, power: int) -> FloatArray:
    """Return the derivatives of the denominator's coefficient of s^power by theta, (free,)."""
    here = denominator_polynomial(theta, form)[-1 - power]
    made = np.zeros(theta.size)
    for j in range(theta.size):
        # of the first degree in each coefficient: without it, and with it alone
        without = theta.copy()
        without[j] = 0.0
        rest = denominator_polynomial(without, form)[-1 - power]
        without[j] = 1.0
        made[j] = denominator_polynomial(without, form)[-1 - power] - rest
    return made if np.isfinite(here) else np.full(theta.size, np.nan)


def theta_left(theta: FloatArray, form: Form) -> FloatArray:
    """Return a basis of the changes of theta that keep the known coefficients of the denominator, (free, k)."""
    rows = [_coefficient_slopes(theta, form, pin.power) for pin in form.pins_below]
    if not rows:
        return np.eye(theta.size)
    scale = np.maximum(np.abs(theta), 1e-9)
    matrix = np.stack(rows) * scale
    matrix /= np.maximum(np.linalg.norm(matrix, axis=1), 1e-300)[:, None]
    _, values, right = np.linalg.svd(matrix)
    return np.asarray(right[values.size :].T * scale[:, None])


def settled(theta: FloatArray, form: Form) -> FloatArray | None:
    """Return the theta nearest to this one, each coefficient by its size, that has the known coefficients of the
    denominator; None where none is found.
    """
    if not bound(form):
        return theta
    pins = form.pins_below
    wanted = np.array([pin.value for pin in pins])
    now, positive = theta.copy(), bool(np.all(theta > 0.0))
    for _ in range(_ROUNDS):
        values = denominator_polynomial(now, form)
        there = np.array([values[-1 - pin.power] for pin in pins])
        if np.all(np.abs(there - wanted) <= _EXACT * wanted):
            return now
        scale = np.maximum(np.abs(now), 1e-9)
        rows = np.stack([_coefficient_slopes(now, form, pin.power) for pin in pins]) * scale
        if positive and np.all(there > 0.0):
            # sums of products of positive numbers: the steps in logarithms keep them positive
            step = np.linalg.lstsq(rows / there[:, None], np.log(wanted / there), rcond=None)[0]
            now = now * np.exp(np.clip(step, -2.0, 2.0))
        else:
            now = now + scale * np.linalg.lstsq(rows, wanted - there, rcond=None)[0]
        if not np.all(np.isfinite(now)):
            return None
    return now if np.all(np.abs(there - wanted) <= 1e3 * _EXACT * wanted) else None
