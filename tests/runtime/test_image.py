"""Images: built here, judged by the core; whatever is amiss is refused by name."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.runtime.image import FORMATS, ImageRefusal, build_image, check_image, read_image_header, sealed
from tests.runtime.paper_display import controller, display

MADE = controller(display())
IMAGES = {name: build_image(MADE, name) for name in FORMATS}


def verdict(image, rate_hz=4000.0, delay=1, channels=3):
    return check_image(bytes(image), rate_hz, delay, channels)


@pytest.mark.parametrize("name", FORMATS)
def test_image__as_built__is_taken_and_says_what_it_is(name):
    assert verdict(IMAGES[name]) is ImageRefusal.GOOD
    header = read_image_header(IMAGES[name])
    assert (header.format, header.rate_hz, header.channels) == (name, 4000.0, 3)
    assert header.controller_hash == MADE.content_hash


@pytest.mark.parametrize("name", FORMATS)
@given(data=st.data())
@settings(max_examples=60)
def test_image__truncated_or_flipped__is_refused(name, data):
    image = bytearray(IMAGES[name])
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
        (4, struct.pack("<H", 2), ImageRefusal.VERSION_UNKNOWN),
        (4, struct.pack("<H", 4), ImageRefusal.VERSION_UNKNOWN),
        (6, struct.pack("<H", 9), ImageRefusal.FORMAT),
        (12, struct.pack("<f", 8000.0), ImageRefusal.RATE),
        (16, b"\x02", ImageRefusal.DELAY),
        (17, b"\x02", ImageRefusal.CHANNELS),
        (68, b"\x09", ImageRefusal.SECTIONS),
        (72, struct.pack("<f", float("nan")), ImageRefusal.LIMIT),
        (84, struct.pack("<f", float("inf")), ImageRefusal.COEFFICIENT),
        (88, struct.pack("<f", -1.0), ImageRefusal.COEFFICIENT),
        (92, struct.pack("<f", float("nan")), ImageRefusal.COEFFICIENT),
        (108, struct.pack("<f", -1e-3), ImageRefusal.UNSTABLE_SECTION),
    ],
)
def test_image__one_field_off_but_sealed__is_refused_by_name(at, content, refusal):
    assert verdict(resealed(IMAGES["float32"], at, content)) is refusal


def test_build__what_boards_do_not_have__is_refused():
    with pytest.raises(BadInput, match="format is 'q15'; allowed: float32, q31"):
        build_image(MADE, "q15")
    with pytest.raises(BadInput, match="delay_samples is 0"):
        build_image(controller(display(delay_samples=0)), "float32")
    channel = MADE.channels[0]
    wild = replace(channel, prefilter_sos=np.array([[1.0, 0.0, 0.0, 1.0, -2.1, 1.2]]))
    with pytest.raises(BadInput, match="outside the unit circle"):
        build_image(replace(MADE, channels=(wild, *MADE.channels[1:])), "float32")


def test_header__not_an_image__is_told():
    with pytest.raises(BadInput, match="truncated"):
        read_image_header(b"short")
