"""A reference taken over by a rig: an own copy of it, and every fault in it found."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.runtime.simulation import REFERENCE_MAX, take_reference

SIXTY_DB_SL = 10.0 ** (60.0 / 20.0)

whole = st.lists(st.floats(-SIXTY_DB_SL, SIXTY_DB_SL), max_size=70)
faults = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).filter(lambda x: not abs(x) <= SIXTY_DB_SL + 1e-3),
    st.sampled_from([np.nan, -np.nan, np.inf, -np.inf, 1000.001, -1000.001, 1e308]),
)


@given(whole)
def test_take_reference__within_sixty_db_sl__is_a_copy_bit_for_bit(values: list[float]) -> None:
    given_rows = np.array(values)
    own = take_reference(given_rows)
    assert own.tobytes() == given_rows.tobytes()
    assert not np.shares_memory(own, given_rows)


@given(whole, faults, st.data())
def test_take_reference__one_fault_anywhere__is_refused(values: list[float], fault: float, data: st.DataObject) -> None:
    values.insert(data.draw(st.integers(0, len(values))), fault)
    with pytest.raises(BadInput, match="not finite or beyond 60 dB SL; allowed: finite, at most 1000 threshold units"):
        take_reference(np.array(values))


@pytest.mark.parametrize("value", [SIXTY_DB_SL, -SIXTY_DB_SL, np.nextafter(REFERENCE_MAX, 2.0 * REFERENCE_MAX), 5e-324])
def test_take_reference__what_single_precision_takes_for_the_largest__is_taken(value: float) -> None:
    assert take_reference(np.array([[value]]))[0, 0] == value
