"""Images: built here, judged by the core, refused by name; delta coefficients against exact rationals."""

import struct
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.runtime.image import (
    ImageRefusal,
    build_image,
    check_image,
    delta_coefficients,
    delta_coefficients_single,
    read_image_header,
    sealed,
)
from tests.runtime.paper_display import controller, display, feedback_sections

MADE = controller(display())
IMAGE = build_image(MADE)


def verdict(image, rate_hz=4000.0, delay=1, channels=3):
    return check_image(bytes(image), rate_hz, delay, channels)


def test_image__as_built__is_taken_and_says_what_it_is():
    assert verdict(IMAGE) is ImageRefusal.GOOD
    header = read_image_header(IMAGE)
    assert (header.rate_hz, header.delay_samples, header.channels) == (4000.0, 1, 3)
    assert header.controller_hash == MADE.content_hash


@given(data=st.data())
@settings(max_examples=60)
def test_image__truncated_or_flipped__is_refused(data):
    image = bytearray(IMAGE)
    if data.draw(st.booleans()):
        image = image[: data.draw(st.integers(0, len(image) - 1))]
    else:
        image[data.draw(st.integers(0, len(image) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    assert verdict(image) is not ImageRefusal.GOOD


def resealed(image, at, content):
    changed = bytearray(image[:-4])
    changed[at : at + len(content)] = content
    return sealed(bytes(changed))


@pytest.mark.parametrize(
    ("at", "content", "refusal"),
    [
        (0, b"XXXX", ImageRefusal.NOT_AN_IMAGE),
        (4, struct.pack("<H", 3), ImageRefusal.VERSION_UNKNOWN),
        (4, struct.pack("<H", 5), ImageRefusal.VERSION_UNKNOWN),
        (12, struct.pack("<f", 8000.0), ImageRefusal.RATE),
        (7, b"\x02", ImageRefusal.DELAY),
        (6, b"\x02", ImageRefusal.CHANNELS),
        (64, b"\x09", ImageRefusal.SECTIONS),
        (68, struct.pack("<f", float("nan")), ImageRefusal.LIMIT),
        (80, struct.pack("<f", float("inf")), ImageRefusal.COEFFICIENT),
        (84, struct.pack("<f", -1.0), ImageRefusal.COEFFICIENT),
        (88, struct.pack("<f", float("nan")), ImageRefusal.COEFFICIENT),
        (104, struct.pack("<f", -1e-3), ImageRefusal.UNSTABLE_SECTION),
    ],
)
def test_image__one_field_off_but_sealed__is_refused_by_name(at, content, refusal):
    assert verdict(resealed(IMAGE, at, content)) is refusal


def test_build__what_boards_do_not_have__is_refused():
    with pytest.raises(BadInput, match="delay_samples is 0"):
        build_image(controller(display(delay_samples=0)))
    channel = MADE.channels[0]
    wild = replace(channel, prefilter_sos=np.array([[1.0, 0.0, 0.0, 1.0, -2.1, 1.2]]))
    with pytest.raises(BadInput, match="outside the unit circle"):
        build_image(replace(MADE, channels=(wild, *MADE.channels[1:])))


def test_header__not_an_image__is_told():
    with pytest.raises(BadInput, match="truncated"):
        read_image_header(b"short")


coefficient = st.floats(-4.0, 4.0, allow_nan=False)


def evaluate(row: list[float], z: Fraction) -> Fraction:
    b0, b1, b2, a1, a2 = (Fraction(value) for value in row)
    d = z - 1
    return (b0 * d * d + b1 * d + b2) / (d * d + a1 * d + a2)


@given(st.lists(coefficient, min_size=5, max_size=5))
def test_delta_coefficients__monic_section__is_the_same_rational_function(values: list[float]) -> None:
    b0, b1, b2, a1, a2 = values
    row = delta_coefficients([[b0, b1, b2, 1.0, a1, a2]])[0].tolist()
    z = Fraction(17, 5)
    below = z * z + Fraction(a1) * z + Fraction(a2)
    direct = (Fraction(b0) * z * z + Fraction(b1) * z + Fraction(b2)) / below
    # what is rounded in the denominator counts the more the nearer z is to a pole
    nearness = max(1.0, float((z * z + abs(a1) * z + abs(a2)) / abs(below)))
    assert float(evaluate(row, z)) == pytest.approx(float(direct), rel=1e-13 * nearness, abs=1e-13 * nearness)


def test_delta_coefficients__cancelling_sum__is_rounded_once() -> None:
    row = delta_coefficients([[1.0, -2.0 + 2.0**-52, 1.0, 1.0, -2.0 + 2.0**-50, 1.0 - 2.0**-53]])[0]
    assert row.tolist() == [1.0, 2.0**-52, 2.0**-52, 2.0**-50, float(Fraction(2) ** -50 - Fraction(2) ** -53)]


def test_delta_coefficients__leading_a0__divides_it_out() -> None:
    assert delta_coefficients([[2.0, 0.0, 0.0, 2.0, -2.0, 0.5]])[0].tolist() == [1.0, 2.0, 1.0, 1.0, 0.25]


def test_delta_coefficients__too_many_or_beyond_single_precision__is_refused() -> None:
    with pytest.raises(BadInput, match="prefilter has 9 sections; expected at most 8"):
        delta_coefficients_single(np.tile(feedback_sections(), (9, 1)), 8, "prefilter")
    with pytest.raises(BadInput, match="what single precision holds"):
        delta_coefficients_single([[1e39, 0.0, 0.0, 1.0, 0.0, 0.0]], 8, "prefilter")
