"""Two neighbouring floats, read at once."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactuator.runtime._core import ffi, lib

SINGLES = st.floats(width=32)


@given(first=SINGLES, second=SINGLES, at=st.integers(0, 3))
def test_pair__any_two_floats__are_read_as_they_lie(first, second, at):
    floats = ffi.new("float[8]", [7.0] * 8)
    floats[2 * at], floats[2 * at + 1] = first, second
    pair = lib.tact_float_pair_get(floats + 2 * at)
    assert np.array_equal([pair.first, pair.second], [first, second], equal_nan=True)
    assert [np.signbit(pair.first), np.signbit(pair.second)] == [np.signbit(first), np.signbit(second)]
