"""Converters over every code, against a quantiser written with integers alone."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.model.description import Converter
from tactuator.runtime._core import lib
from tactuator.runtime.tables import converter_table


def exact_code(volts: float, bits: int, range_v: float) -> int:
    """Nearest code, halves away from zero as in the device, saturated."""
    half = 2 ** (bits - 1)
    steps = Fraction(volts) * half / Fraction(range_v)
    size = int(abs(steps) + Fraction(1, 2))
    return max(-half, min(half - 1, size if steps > 0 else -size))


def sensed(converter: Converter, volts: np.ndarray) -> np.ndarray:
    table = converter_table(converter)
    return np.array([lib.tact_converter_sense(table, lib.tact_finite_double(v, 1e6)) for v in volts])


def commanded(converter: Converter, volts: np.ndarray) -> np.ndarray:
    table = converter_table(converter)
    return np.array([lib.tact_converter_code(table, lib.tact_finite(v, 1e6)) for v in volts])


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_converter__every_code_and_its_edges__are_those_of_the_integers(bits: int) -> None:
    half = 2 ** (bits - 1)
    codes = np.arange(-half, half)
    step = 10.0 / half
    for inside in (-0.49, 0.0, 0.49):
        assert np.array_equal(sensed(Converter(bits=bits), (codes + inside) * step), codes)
    assert np.array_equal(commanded(Converter(bits=bits), codes * step), codes)


@given(st.floats(-12.0, 12.0), st.sampled_from([8, 12, 16, 18, 24]), st.sampled_from([1.0, 2.5, 3.3, 10.0]))
def test_converter__any_voltage__is_the_nearest_code(volts: float, bits: int, range_v: float) -> None:
    converter = Converter(bits=bits, range_v=range_v)
    near = {exact_code(volts * (1.0 + tilt), bits, range_v) for tilt in (-1e-15, 0.0, 1e-15)}
    assert sensed(converter, np.array([volts]))[0] in near
    single = float(np.float32(volts))
    near = {exact_code(single * (1.0 + tilt), bits, range_v) for tilt in (-3e-7, 0.0, 3e-7)}
    assert commanded(converter, np.array([volts]))[0] in {code + off for code in near for off in (-1, 0, 1)}


@pytest.mark.parametrize("bits", [8, 16, 24])
def test_converter__command_halfway_between_two_codes__is_the_even_one(bits: int) -> None:
    half = 2 ** (bits - 1)
    codes = np.unique(np.concatenate([np.arange(-9, 9), np.linspace(1 - half, half - 2, 100).astype(int)]))
    volts = np.float32((codes + 0.5) * (8.0 / half))
    halfway = volts == (codes + 0.5) * (8.0 / half)  # in single precision
    expected = np.array([round(code + 0.5) for code in codes.tolist()])
    assert halfway.sum() > 50
    assert np.array_equal(commanded(Converter(bits=bits, range_v=8.0), volts)[halfway], expected[halfway])


def test_converter__beyond_the_range__saturates_both_ways() -> None:
    beyond = np.array([9.9999, 10.0, 1e6, np.inf, -10.0, -10.1, -np.inf, np.nan])
    expected = [32767, 32767, 32767, 32767, -32768, -32768, -32768, 0]
    assert sensed(Converter(), beyond).tolist() == expected
    assert commanded(Converter(), beyond).tolist() == expected
