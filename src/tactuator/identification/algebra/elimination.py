"""Least squares by products of columns: what is linear is eliminated, and what is left of the others is told."""

from __future__ import annotations

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray


def fitted_beside(columns: ComplexArray, goal: ComplexArray, weight: FloatArray) -> FloatArray:
    """Return the real weights (k,) of complex columns (e, k) that fit the goal (e,) best."""
    rows = np.ascontiguousarray((np.hstack([columns, goal[:, None]]) * weight[:, None]).T).view(np.float64)
    return np.asarray(eliminated(rows @ rows.T, columns.shape[1])[0][:, 0])


def eliminated(products: FloatArray, linear: int, turning: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the least squares weights (linear, k) of the first `linear` columns for all further ones, and the products
    (k, k) of what they leave, from the products of all columns.

    turning: `turning_of` the first columns, if that is at hand.
    """
    turned = turning_of(products[:linear, :linear]) if turning is None else turning
    along = turned.T @ products[:linear, linear:]
    return turned @ along, products[linear:, linear:] - along.T @ along


def turning_of(products: FloatArray) -> FloatArray:
    """Return the weights (k, j) that make orthonormal columns of those with the products (k, k); directions that
    rounding has taken are left out.
    """
    if not products.size:
        return np.zeros((0, 0))
    size = np.sqrt(np.maximum(products.diagonal(), 0.0))
    size[size == 0.0] = 1.0
    values, vectors = np.linalg.eigh(products / (size[:, None] * size))
    kept = values > 1e-13 * max(float(values[-1]), 1e-300)
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) / size[:, None])


def orthonormal(rows: FloatArray) -> FloatArray:
    """Return an orthonormal basis (j, n) of the rows (k, n), but for directions that are lost in rounding."""
    size = np.linalg.norm(rows, axis=1)
    made = rows / np.where(size > 0.0, size, 1.0)[:, None]
    # the second round takes away what the first one's rounding left
    for _ in range(2):
        values, vectors = np.linalg.eigh(made @ made.T)
        kept = values > 1e-11 * max(float(values[-1]), 1e-300)
        made = (vectors[:, kept] / np.sqrt(values[kept])).T @ made
    return np.asarray(made)
