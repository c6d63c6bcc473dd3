"""A coding: a way from speech to signals, and from signals to fingers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput


class Coding(Protocol):
    """A way from speech to signals, and from signals to fingers."""

    @property
    def kind(self) -> str:
        """Return the kind of coding: direct, bands or envelope."""
        ...

    def signals(self, blocks: Iterator[FloatArray], rate_in_hz: int, rate_hz: int) -> Iterator[FloatArray]:
        """Yield mono blocks (n,) as blocks (m, signals) at the display's rate."""
        ...

    def placement(self, fingers: tuple[str, ...]) -> FloatArray:
        """Return the gain of each signal on each finger, shape (signals, fingers)."""
        ...


def place(wanted: list[tuple[str, ...]], fingers: tuple[str, ...]) -> FloatArray:
    """Return ones and zeros, shape (signals, fingers): signal i goes to the fingers wanted[i]. Raises BadInput for a
    finger that is not there.
    """
    matrix = np.zeros((len(wanted), len(fingers)))
    for row, names in zip(matrix, wanted, strict=True):
        for name in fingers if "all" in names else names:
            if name not in fingers:
                raise BadInput(f"finger {name!r} is not on the display", f"all, {', '.join(fingers)}")
            row[fingers.index(name)] = 1.0
    return matrix
