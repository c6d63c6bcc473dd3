"""One rounding for each operation: the core's float32 sections against APyTypes' floats of 8 and 23 bits."""

import numpy as np
import pytest
from apytypes import APyFloat
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from tactuator.runtime._core import ffi, lib
from tactuator.runtime.coefficients import delta_coefficients_single
from tests.core.single_precision import Section
from tests.runtime.paper_display import feedback_sections, prefilter_sections

CASCADES = {
    "F": delta_coefficients_single(prefilter_sections(0.004), 8, "F"),
    "F at 64 kHz": delta_coefficients_single(prefilter_sections(0.004, 64_000.0), 8, "F"),
    "C": delta_coefficients_single(feedback_sections(), 4, "C"),
}
numbers = st.floats(-(2.0**99), 2.0**99, width=32)
coefficients = hnp.arrays(np.float32, st.tuples(st.integers(1, 3), st.just(5)), elements=st.floats(-300, 300, width=32))


def apy(value: float) -> APyFloat:
    return APyFloat.from_float(float(value), 8, 23)


def softly(rows: NDArray[np.float32], samples: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same written order of operations, each carried out and rounded by APyTypes."""
    cascade = [Section(tuple(map(apy, row)), apy(0.0), apy(0.0)) for row in rows]  # type: ignore[arg-type]
    out = []
    for sample in samples:
        value = apy(sample)
        for section in cascade:
            value = section.step(value)
        out.append(float(value))
    return np.array(out, dtype=np.float32)


def core(rows: NDArray[np.float32], samples: NDArray[np.float32]) -> NDArray[np.float32]:
    table = ffi.new("tact_section[]", [tuple(map(float, row)) for row in rows])
    states = ffi.new("tact_section_state[]", len(rows))
    out = np.empty_like(samples)
    arrays = (ffi.from_buffer("float[]", np.ascontiguousarray(each)) for each in (samples, out))
    lib.tact_cascade_run(table, states, len(rows), *arrays, samples.size)
    return out


def same_bits(one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    """NaN apart, whose bits processors choose."""
    both = np.isnan(one) & np.isnan(other)
    return np.array_equal(np.where(both, 0, one.view(np.uint32)), np.where(both, 0, other.view(np.uint32)))


@pytest.mark.parametrize("rows", CASCADES.values(), ids=CASCADES)
def test_section__thousands_of_samples_then_silence__rounds_once_an_operation(rows: NDArray[np.float32]) -> None:
    rng = np.random.default_rng(2)
    samples = (300.0 * rng.standard_normal(3000)).astype(np.float32)
    samples[::7] *= np.float32(1e-12)
    samples[2200:] = 0.0
    assert same_bits(core(rows, samples), softly(rows, samples))


@settings(max_examples=100, deadline=None)
@given(coefficients, hnp.arrays(np.float32, st.integers(1, 40), elements=numbers))
def test_section__any_numbers_up_to_overflow__rounds_once_an_operation(
    rows: NDArray[np.float32], samples: NDArray[np.float32]
) -> None:
    samples = np.where(np.abs(samples) < np.float32(1e-30), np.float32(0.0), samples)  # what is let in, finite.h
    assert same_bits(core(rows, samples), softly(rows, samples))


@given(first=st.floats(width=32), second=st.floats(width=32), at=st.integers(0, 3))
def test_pair__any_two_floats__are_read_as_they_lie(first, second, at):
    floats = ffi.new("float[8]", [7.0] * 8)
    floats[2 * at], floats[2 * at + 1] = first, second
    pair = lib.tact_float_pair_get(floats + 2 * at)
    assert np.array_equal([pair.first, pair.second], [first, second], equal_nan=True)
    assert [np.signbit(pair.first), np.signbit(pair.second)] == [np.signbit(first), np.signbit(second)]
