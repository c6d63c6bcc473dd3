"""Points that fill a cube evenly: Sobol's sequence in Gray code's order, of as many dimensions as the search has.

To the bit as scipy.stats.qmc.Sobol without scrambling, which takes longer to import than a design takes otherwise.
Source: Joe and Kuo, Constructing Sobol sequences with better two-dimensional projections, SIAM J. Sci. Comput. 30,
2008: their primitive polynomials and first direction numbers.
"""

import numpy as np

from tactuator.arrays import FloatArray

_BITS = 30
_FIRST = (
    (1, (1,) * _BITS),
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
    (41, (1, 1, 5, 5, 5)),
    (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)),
    (61, (1, 3, 5, 5, 31)),
)
"""Polynomial (its bits the coefficients) and first direction numbers of each dimension."""


def even_points(dimensions: int, first: int, count: int) -> FloatArray:
    """Return the points first .. first + count - 1 of the sequence, shape (count, dimensions), each from 0 to below 1;
    dimensions: 13 at most.
    """
    index = np.arange(first, first + count)
    gray = index ^ (index >> 1)
    points = np.zeros((count, dimensions), dtype=np.int64)
    for bit in range(int(gray.max(initial=0)).bit_length()):
        directions = [_direction(dimension, bit) for dimension in range(dimensions)]
        points ^= np.where((gray >> bit) & 1, 1, 0)[:, None] * np.array(directions)
    return np.asarray(points * 2.0**-_BITS)


def _direction(dimension: int, bit: int) -> int:
    """Return what the bit of an index turns over in that dimension."""
    polynomial, first = _FIRST[dimension]
    degree, numbers = polynomial.bit_length() - 1, list(first)
    while len(numbers) <= bit:
        number = numbers[-degree]
        for k in range(1, degree + 1):
            if polynomial >> (degree - k) & 1:
                number ^= numbers[-k] << k
        numbers.append(number)
    return numbers[bit] << (_BITS - 1 - bit)
