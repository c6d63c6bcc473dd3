"""Formulas as they are printed, against the numbers that they say."""

import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactuator.report.tables import printed_factors, printed_polynomial
from tactuator.signals.systems import ContinuousSystem


def test_printed__signs_ones_zeros_pairs_and_repeated_roots__written_as_by_hand():
    assert printed_polynomial(np.array([-1.0, 0.0, 2.5, -3.0])) == "−s³ + 2.5s − 3"
    paper = ContinuousSystem.from_polynomials([12.264, 12.264 * 111, 12.264 * 530], [1, 260, 0])
    assert printed_factors(paper) == "12.264 (s + 5) (s + 106) / (s (s + 260))"
    pair = ContinuousSystem(np.array([]), np.array([-3 + 4j, -3 - 4j, -7, -7]), 2.0)
    assert printed_factors(pair) == "2 / ((s² + 6s + 25) (s + 7)²)"
    assert printed_factors(ContinuousSystem(np.array([]), np.array([]), 0.5)) == "0.5"


def _value(text: str, s: complex) -> complex:
    """Return what the printed text says at s, read by a reader that knows nothing of roots."""
    for digit, power in zip("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789", strict=True):
        text = text.replace(digit, f"**{power}")
    text = re.sub(r"(?<=\d)s", "*s", text.replace("−", "-"))
    return complex(eval(re.sub(r"(?<=[\ds)]) (?=[(s])", "*", text), {"s": s}))


@given(
    real=st.lists(st.floats(-1e4, -1.0), max_size=4),
    pairs=st.lists(st.tuples(st.floats(-500.0, -5.0), st.floats(10.0, 2000.0)), max_size=3),
    gain=st.floats(0.01, 100.0),
)
def test_printed_factors__read_back__respond_like_the_system(real, pairs, gain):
    poles = np.array([*real, *(complex(a, b) for a, b in pairs), *(complex(a, -b) for a, b in pairs)], complex)
    system = ContinuousSystem(np.array([-20.0]), poles, gain)
    s = 2j * np.pi * 33.0
    asked = complex(gain * (s + 20.0) / np.prod(s - poles))
    assert abs(_value(printed_factors(system), s) / asked - 1.0) < 0.05
