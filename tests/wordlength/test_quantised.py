"""Rounded coefficients: by hand, and the filter that is left against mpmath with 50 digits."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.loop import is_stable as loop_is_stable
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis import paper
from tactuator.wordlength.bits import is_stable, quantised_rows, rows_response
from tests.runtime.paper_display import PAPER_F, feedback_sections, prefilter_sections
from tests.signals.precisely import polynomial_response

HZ = np.geomspace(0.1, 300.0, 12)
RATES_HZ = (4000.0, 16_000.0, 64_000.0)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("bits", [20, 30, None])
def test_sections__rounded__are_the_rounded_numbers_with_fifty_digits(bits: int | None, rate_hz: float) -> None:
    sos = prefilter_sections(0.004, rate_hz)
    exact = np.ones(HZ.size, dtype=complex)
    for row in sos:
        words = [to_word(value, bits) for value in row]
        exact *= polynomial_response(words[:3], HZ, rate_hz) / polynomial_response(words[3:], HZ, rate_hz)
    found = rows_response(quantised_rows(sos, "sections", bits, rate_hz), HZ, rate_hz)
    np.testing.assert_allclose(found, exact, rtol=1e-10)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_direct_form__rounded__is_the_rounded_product_with_fifty_digits(rate_hz: float) -> None:
    sos = prefilter_sections(0.004, rate_hz)
    num, den = ([Fraction(1)] for _ in range(2))
    for row in sos:
        num, den = multiplied(num, row[:3]), multiplied(den, row[3:])
    words = [[to_word(float(value), 36) for value in one] for one in (num, den)]
    exact = polynomial_response(words[0], HZ, rate_hz) / polynomial_response(words[1], HZ, rate_hz)
    found = rows_response(quantised_rows(sos, "direct", 36, rate_hz), HZ, rate_hz)
    np.testing.assert_allclose(found, exact, rtol=1e-9)


def to_word(value: float, bits: int | None) -> float:
    return float(np.float32(value)) if bits is None else float(Fraction(round(Fraction(value) * 2**bits), 2**bits))


def multiplied(one: list[Fraction], other: np.ndarray) -> list[Fraction]:
    out = [Fraction(0)] * (len(one) + len(other) - 1)
    for i, left in enumerate(one):
        for j, right in enumerate(other):
            out[i + j] += left * Fraction(float(right))
    return out


def test_is_stable__direct_float32__is_facts() -> None:
    # facts, section 2: F as one 4th-order section in float32 is unstable from 16 kHz
    for rate_hz, stable in ((4000.0, True), (8000.0, True), (16_000.0, False), (64_000.0, False)):
        rows = quantised_rows(bilinear(PAPER_F, rate_hz).sections(), "direct", None, rate_hz)
        assert is_stable(rows) == stable


@pytest.mark.parametrize(("rate_hz", "stable"), [(4000.0, True), (64_000.0, False)])
def test_is_stable__slow_section_in_float32__as_its_pole_rounds(rate_hz: float, stable: bool) -> None:
    # poles at 0.4 Hz: in float32, 1 + a1 + a2 is a multiple of 2^-24, and at 64 kHz it should be 1.5e-9
    pole = np.exp(-2.0 * np.pi * 0.4 / rate_hz)
    sos = np.array([[1.0, 0.0, 0.0, 1.0, -2.0 * pole, pole**2]])
    a1, a2 = (mpmath.mpf(float(np.float32(value))) for value in (sos[0, 4], sos[0, 5]))
    with mpmath.workdps(50):
        inside = max(abs(root) for root in mpmath.polyroots([a2, a1, 1], maxsteps=500, extraprec=400, asc=True)) < 1
    assert inside == stable
    assert is_stable(quantised_rows(sos, "sections", None, rate_hz)) == stable
    assert is_stable(quantised_rows(sos, "delta", None, rate_hz))


@pytest.mark.parametrize("gain", [0.2, 4.0, 20.0, 60.0])
def test_is_stable__loop__is_the_verdict_on_the_unrounded_loop(gain: float) -> None:
    plant = zero_order_hold(paper.PLANT, 4000.0) * SampledSystem(np.empty(0), np.empty(0), 1.0, 4000.0, 1)
    sos = feedback_sections()
    sos[0, :3] *= gain
    loop = SampledSystem.from_sections(sos, 4000.0) * plant
    assert is_stable(quantised_rows(sos, "delta", None, 4000.0), plant) == loop_is_stable(loop)


def test_quantised_rows__form_that_is_not_there__is_refused() -> None:
    with pytest.raises(BadInput, match="form 'lattice'; allowed: direct, sections, delta"):
        quantised_rows(feedback_sections(), "lattice", 30, 4000.0)  # type: ignore[arg-type]
