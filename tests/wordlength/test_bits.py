"""Bits needed, by hand, with fifty digits, and against facts' table."""

from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.model.controller import AntiWindup
from tactuator.runtime.image import ImageRefusal, build_image, check_image, delta_coefficients
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import is_stable as loop_is_stable
from tactuator.signals.systems import SampledSystem, sections_response
from tactuator.synthesis import paper
from tactuator.wordlength.bits import (
    MOST_BITS,
    BitsNeeded,
    at_rate,
    controller_bits,
    filter_bits,
    is_stable,
    quantised_rows,
    rows_response,
)
from tests.runtime.paper_display import (
    changed,
    channel,
    controller,
    display,
    feedback_sections,
    prefilter_sections,
)
from tests.signals.precisely import polynomial_response

AT_HZ = np.geomspace(0.1, 300.0, 12)
THREE_RATES_HZ = (4000.0, 16_000.0, 64_000.0)


@pytest.mark.parametrize("rate_hz", THREE_RATES_HZ)
@pytest.mark.parametrize("bits", [20, 30])
def test_sections__rounded__are_the_rounded_numbers_with_fifty_digits(bits: int, rate_hz: float) -> None:
    sos = prefilter_sections(0.004, rate_hz)
    exact = np.ones(AT_HZ.size, dtype=complex)
    for row in sos:
        words = [to_word(value, bits) for value in row]
        exact *= polynomial_response(words[:3], AT_HZ, rate_hz) / polynomial_response(words[3:], AT_HZ, rate_hz)
    found = rows_response(quantised_rows(sos, "sections", bits, rate_hz), AT_HZ, rate_hz)
    np.testing.assert_allclose(found, exact, rtol=1e-10)


@pytest.mark.parametrize("rate_hz", THREE_RATES_HZ)
def test_direct_form__rounded__is_the_rounded_product_with_fifty_digits(rate_hz: float) -> None:
    sos = prefilter_sections(0.004, rate_hz)
    num, den = ([Fraction(1)] for _ in range(2))
    for row in sos:
        num, den = multiplied(num, row[:3]), multiplied(den, row[3:])
    words = [[to_word(float(value), 36) for value in one] for one in (num, den)]
    exact = polynomial_response(words[0], AT_HZ, rate_hz) / polynomial_response(words[1], AT_HZ, rate_hz)
    found = rows_response(quantised_rows(sos, "direct", 36, rate_hz), AT_HZ, rate_hz)
    np.testing.assert_allclose(found, exact, rtol=1e-9)


def to_word(value: float, bits: int) -> float:
    return float(Fraction(round(Fraction(value) * 2**bits), 2**bits))


def multiplied(one: list[Fraction], other: np.ndarray) -> list[Fraction]:
    out = [Fraction(0)] * (len(one) + len(other) - 1)
    for i, left in enumerate(one):
        for j, right in enumerate(other):
            out[i + j] += left * Fraction(float(right))
    return out


@pytest.mark.parametrize("gain", [0.2, 4.0, 20.0, 60.0])
def test_is_stable__loop__is_the_verdict_on_the_unrounded_loop(gain: float) -> None:
    plant = discretise(paper.PLANT, 4000.0, "zoh") * SampledSystem(np.empty(0), np.empty(0), 1.0, 4000.0, 1)
    sos = feedback_sections()
    sos[0, :3] *= gain
    loop = SampledSystem.from_sections(sos, 4000.0) * plant
    assert is_stable(delta_coefficients(sos), plant) == loop_is_stable(loop)


def test_quantised_rows__form_that_is_not_there__is_refused() -> None:
    with pytest.raises(BadInput, match="form 'lattice'; expected direct, sections, delta"):
        quantised_rows(feedback_sections(), "lattice", 30, 4000.0)  # type: ignore[arg-type]


# facts, section 2: fractional bits to be stable and to keep 0.1 dB, at 4, 8, 16, 32 kHz
F_BITS = {
    "direct": [(19, 28), (22, 33), (29, 36), (32, 37)],
    "sections": [(15, 20), (18, 23), (18, 24), (21, 26)],
    "delta": [(1, 10), (1, 12), (1, 11), (1, 9)],
}
RATES_HZ = (4000.0, 8000.0, 16000.0, 32000.0)
MADE = controller(display(channel()))
DC = MADE.channels[0].threshold_voltage_dc
HZ = np.geomspace(0.4, 300.0, 40)


def test_filter_bits__slow_poles__are_what_they_need_or_one_above_the_most() -> None:
    # a pole at 1 - 2^-6: rounded to five bits or fewer it lies on the unit circle
    system = SampledSystem(np.empty(0), np.array([1.0 - 2.0**-6]), 2.0**-6, 4000.0)
    assert filter_bits(system, "sections").stable == 6
    slow = SampledSystem(np.empty(0), np.array([1.0 - 1e-7] * 8), 1.0, 64_000.0)
    assert filter_bits(slow, "direct") == BitsNeeded(MOST_BITS + 1, MOST_BITS + 1)


@pytest.mark.parametrize("form", F_BITS)
def test_filter_bits__papers_prefilter__are_facts_within_what_pairing_moves(form: str) -> None:
    for rate_hz, (stable, accurate) in zip(RATES_HZ, F_BITS[form], strict=True):
        found = filter_bits(discretise(paper.PREFILTER, rate_hz, "bilinear"), form)  # type: ignore[arg-type]
        assert found.stable == pytest.approx(stable, abs=3)
        assert found.accurate == pytest.approx(accurate, abs=4)


def test_controller_bits__papers__sections_need_more_at_every_doubling() -> None:
    found = controller_bits(MADE, (4000.0, 32000.0))
    assert set(found) == {"prefilter", "feedback"}
    for forms in found.values():
        for form in ("direct", "sections"):
            assert forms[form][32000.0].stable >= forms[form][4000.0].stable + 3
            assert forms[form][32000.0].accurate >= forms[form][4000.0].accurate + 3
        assert all(bits.stable <= 2 and bits.accurate <= 13 for bits in forms["delta"].values())


def test_controller_bits__several_channels__the_most_of_any() -> None:
    each = [controller_bits(controller(display(channel(name))), RATES_HZ[:1]) for name in ("index", "thumb")]
    both = controller_bits(controller(display(channel("index"), channel("thumb"))), RATES_HZ[:1])
    for (name, forms), figure in product(both.items(), ("accurate", "stable")):
        for form, by_rate in forms.items():
            alone = [getattr(one[name][form][4000.0], figure) for one in each]
            assert getattr(by_rate[4000.0], figure) == max(alone)


def test_controller_bits__without_feedback__says_nothing_of_it() -> None:
    assert set(controller_bits(changed(MADE, feedback_sos=None), RATES_HZ[:1])) == {"prefilter"}


@pytest.mark.parametrize("rate_hz", [1200.0, 8000.0, 250_000.0])
def test_at_rate__papers_filters__are_those_designed_at_that_rate(rate_hz: float) -> None:
    moved = at_rate(MADE, rate_hz).channels[0]
    for found, expected in (
        (moved.prefilter_sos, prefilter_sections(DC, rate_hz)),
        (moved.feedback_sos, feedback_sections(rate_hz)),
    ):
        responses = [sections_response(sos, HZ, rate_hz) for sos in (found, expected)]
        np.testing.assert_allclose(*responses, rtol=1e-7)


def test_at_rate__any_rate__the_integrator_is_exact_and_the_core_takes_the_image() -> None:
    for rate_hz in np.linspace(1200.0, 64_000.0, 12):
        moved = at_rate(MADE, float(rate_hz))
        assert delta_coefficients(moved.channels[0].feedback_sos)[-1, 4] == 0.0
        assert check_image(build_image(moved), float(np.float32(rate_hz)), 1, 1) is ImageRefusal.GOOD


def test_at_rate__anti_windup__acts_at_the_same_speed() -> None:
    wound = replace(MADE, channels=(replace(MADE.channels[0], anti_windup=AntiWindup((0.04, 0.002))),))
    assert at_rate(wound, 8000.0).channels[0].anti_windup.gains == (0.02, 0.0005)


@pytest.mark.parametrize(
    ("rate_hz", "words"),
    [
        (0.0, "rate_hz is 0; it must be a number, above 0"),
        (float("nan"), "rate_hz is nan; it must be"),
        (1e7, r"rate_hz is 1(e\+07|0000000).*; "),
        (700.0, "rate_hz is 700 for a band up to 300 Hz; it must be 1200 or more"),
    ],
)
def test_at_rate__rate_that_a_display_cannot_have__is_refused(rate_hz: float, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        at_rate(MADE, rate_hz)
