"""Equations of several records of one mechanism, each with its own transient, ends and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.spectral.lines import Equations, LocalResponse


@dataclass(frozen=True, eq=False)
class JoinedEquations:
    """The equations of several records one after the other; attributes and methods as `Equations` has them."""

    parts: tuple[Equations, ...]

    @cached_property
    def frequency_hz(self) -> FloatArray:
        """Return where responses are wanted, (m,): each part's frequencies in turn."""
        return np.concatenate([one.frequency_hz for one in self.parts])

    @cached_property
    def goal(self) -> ComplexArray:
        """Return the left sides, (e,)."""
        return np.concatenate([one.goal for one in self.parts])

    @cached_property
    def of_hz(self) -> FloatArray:
        """Return the frequency of each equation, (e,)."""
        return np.concatenate([one.of_hz for one in self.parts])

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate, the same for all."""
        return self.parts[0].rate_hz

    @property
    def shift(self) -> int:
        """Return by how many samples the positions are read later, the same for all."""
        return self.parts[0].shift

    @property
    def total(self) -> int:
        """Return the number of real equations that the records give."""
        return sum(one.total for one in self.parts)

    def response_of(self, values: NDArray[Any]) -> ComplexArray:
        """Return the equations' right sides for responses (m, c): (e, c)."""
        return np.concatenate(
            [one.response_of(values[piece]) for one, piece in zip(self.parts, self._pieces, strict=True)]
        )

    def transient_of(self, values: NDArray[Any]) -> ComplexArray:
        """Return the right sides for transients (m, c), each record with weights of its own: (e, c * records)."""
        blocks = [one.transient_of(values[piece]) for one, piece in zip(self.parts, self._pieces, strict=True)]
        return np.asarray(linalg.block_diag(*blocks))

    @cached_property
    def _pieces(self) -> list[slice]:
        return slices([one.frequency_hz.size for one in self.parts])


def slices(sizes: Sequence[int]) -> list[slice]:
    """Return the places of pieces of those sizes, one after the other."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(begin, end) for begin, end in pairwise(ends)]


def equation_slices(given: Equations | JoinedEquations) -> list[slice]:
    """Return the equations of each record among all of them."""
    return slices([one.goal.size for one in given.parts])


def join(parts: Sequence[Equations]) -> Equations | JoinedEquations:
    """Return the equations of all records; of one alone its own."""
    return parts[0] if len(parts) == 1 else JoinedEquations(tuple(parts))


def join_local(parts: Sequence[LocalResponse]) -> LocalResponse:
    """Return the points of all records by frequency."""
    if len(parts) == 1:
        return parts[0]
    order = np.argsort(np.concatenate([one.frequency_hz for one in parts]), kind="stable")
    names = ("frequency_hz", "value", "variance", "noise", "excitation", "lines")
    columns = (np.concatenate([getattr(one, name) for one in parts])[order] for name in names)
    return LocalResponse(*columns)
