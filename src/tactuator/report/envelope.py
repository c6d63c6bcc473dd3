"""Envelopes of a family of loops: convex templates in the Nichols chart, least and greatest of a curve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactuator.arrays import FloatArray


def hull(points: FloatArray) -> FloatArray:
    """Return the corners of the convex hull of `points`, (n, 2), in turn, (k, 2); Andrew's monotone chain."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered
    chains: list[list[FloatArray]] = []
    for walk in (ordered, ordered[::-1]):
        chain: list[FloatArray] = []
        for point in walk:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
                chain.pop()
            chain.append(point)
        chains.append(chain[:-1])
    return np.array([*chains[0], *chains[1]])


def _turn(start: FloatArray, middle: FloatArray, end: FloatArray) -> float:
    first, second = middle - start, end - start
    return float(first[0] * second[1] - first[1] * second[0])


def swept(lines: Sequence[FloatArray], step: int = 6) -> list[FloatArray]:
    """Return polygons that cover everything between curves: the hulls of their pieces of `step` points.

    lines: curves over one grid of frequencies, each (2, n).
    """
    stacked = np.array(lines)
    starts = range(0, stacked.shape[2] - 1, step)
    return [hull(stacked[:, :, at : at + step + 1].transpose(0, 2, 1).reshape(-1, 2)) for at in starts]
