"""Direct forms: fixed point against APyTypes, float32 against SciPy's, dead bands against the textbook."""

import numpy as np
import pytest
from apytypes import APyFixed, OverflowMode, QuantizationMode
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import signal

from tactuator.errors import BadInput
from tactuator.wordlength.formats import FixedSections, SingleSections
from tests.runtime.paper_display import feedback_sections, prefilter_sections


class FixedDirectForm:
    """One direct form I section in APyTypes: b in `bits` with a power of two of its own, a with bits - 2 fractional."""

    def __init__(self, b: NDArray[np.float64], a: NDArray[np.float64], bits: int, fed_back: bool) -> None:
        high = int(np.frexp(np.max(np.abs(b)))[1]) + 1
        self.b = [APyFixed.from_float(float(x), high, bits - high) for x in b]
        self.a = [APyFixed.from_float(float(x), 2, bits - 2) for x in a]
        self.bits, self.fed_back = bits, fed_back
        rest = APyFixed(0, int_bits=1, frac_bits=bits - 1)
        self.x, self.y, self.left = [rest, rest], [rest, rest], rest

    def step(self, x: APyFixed) -> APyFixed:
        fresh = self.b[0] * x + self.b[1] * self.x[0] + self.b[2] * self.x[1]
        fresh = fresh.cast(frac_bits=2 * self.bits - 3, quantization=QuantizationMode.TRN)
        total = fresh + self.left - self.a[0] * self.y[0] - self.a[1] * self.y[1]
        rounded = total.cast(frac_bits=self.bits - 1, quantization=QuantizationMode.RND)
        y = rounded.cast(int_bits=1, frac_bits=self.bits - 1, overflow=OverflowMode.SAT)
        rest = APyFixed(0, int_bits=1, frac_bits=self.bits - 1)
        self.left = total - y if self.fed_back and y == rounded else rest
        self.x, self.y = [x, self.x[0]], [y, self.y[0]]
        return y


@pytest.mark.parametrize("fed_back", [False, True])
@pytest.mark.parametrize("bits", [16, 32])
@given(samples=st.data())
@settings(max_examples=15, deadline=None)
def test_fixed_sections__any_words__are_apytypes_bits(samples: st.DataObject, bits: int, fed_back: bool) -> None:
    full = 2 ** (bits - 1)
    words = samples.draw(st.lists(st.integers(-full, full - 1), min_size=1, max_size=40))
    row = np.array([0.02, -0.013, 0.4, 1.0, -1.62, 0.81])
    ours = FixedSections(row[None, :], 4000.0, 32.0, bits, fed_back)
    oracle = FixedDirectForm(row[:3], row[4:], bits, fed_back)
    got = [ours(word) for word in words]
    signals = (APyFixed(word, int_bits=1, frac_bits=bits - 1) for word in words)
    assert got == [int(oracle.step(x).to_fraction() * full) for x in signals]


def test_single_sections__noise__are_scipys_float32_bits() -> None:
    rng = np.random.default_rng(3)
    for sos in (prefilter_sections(0.004), feedback_sections()):
        samples = rng.standard_normal(2000).astype(np.float32)
        ours = SingleSections(sos)
        got = np.array([ours(value) for value in samples])
        assert got.dtype == np.float32
        assert np.array_equal(got, signal.sosfilt(sos.astype(np.float32), samples))


@pytest.mark.parametrize("pole", [0.9, 0.99])
def test_fixed_sections__one_pole_in_silence__sticks_in_the_textbooks_dead_band(pole) -> None:
    # Oppenheim & Schafer, Discrete-Time Signal Processing, section 6.10: |y| <= 1/2 / (1 - |a|), and it is reached
    decay = {}
    for fed_back in (False, True):
        cascade = FixedSections(np.array([[1.0, 0.0, 0.0, 1.0, -pole, 0.0]]), 4000.0, 32.0, 16, fed_back)
        decay[fed_back] = [cascade(word) for word in [20_000] + [0] * 2000][-1]
    assert decay[False] == pytest.approx(0.5 / (1.0 - pole), abs=1.01)
    assert abs(decay[True]) <= 1


def test_fixed_sections__what_no_word_holds__is_refused() -> None:
    with pytest.raises(BadInput, match=r"a coefficient of 2\.1 in a denominator; allowed in fixed point: up to 2"):
        FixedSections(np.array([[1.0, 0.0, 0.0, 1.0, -2.1, 1.2]]), 4000.0, 32.0, 32, False)
