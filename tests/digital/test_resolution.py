"""Coefficient resolution: rounding by hand, and forms that agree when nothing is rounded."""

import numpy as np
import pytest

from tactuator.design import paper
from tactuator.digital.discretise import bilinear
from tactuator.digital.resolution import FORMS, filter_bits, in_difference, response_of, rounded, rounded_blocks
from tactuator.signals.systems import SampledSystem

HZ = np.geomspace(0.1, 300.0, 40)


def test_rounded__three_bits__is_to_the_nearest_eighth() -> None:
    assert rounded(np.array([0.3, -1.9375, 0.0624]), 3).tolist() == [0.25, -2.0, 0.0]


def test_in_difference__double_root_at_one__is_exact() -> None:
    # (z - 1)^2 (z - 0.5) = d^2 (d + 0.5)
    assert in_difference(np.array([1.0, -2.5, 2.0, -0.5])).tolist() == [1.0, 0.5, 0.0, 0.0]


@pytest.mark.parametrize("form", FORMS)
def test_rounded_blocks__finest_rounding__is_the_filter(form: str) -> None:
    system = bilinear(paper.PREFILTER, 4000.0)
    response = response_of(rounded_blocks(system, form, 50), 4000.0, HZ)  # type: ignore[arg-type]
    np.testing.assert_allclose(response, system.response(HZ), rtol=1e-6)


def test_filter_bits__first_order_low_pass__is_what_its_pole_needs() -> None:
    # a pole at 1 - 2^-6: rounded to five bits or fewer it lies on the unit circle
    system = SampledSystem(np.empty(0), np.array([1.0 - 2.0**-6]), 2.0**-6, 4000.0)
    assert filter_bits(system, "sections").stable == 6
