"""Half-widths in decibels, and where there is none."""

import numpy as np
import pytest

from tactuator.signals.decibels import half_width_db


def test_half_width__of_a_tenth_of_the_magnitude__as_a_ratio() -> None:
    assert half_width_db(-2.0j, 0.2) == pytest.approx(0.828, abs=1e-3)


def test_half_width__that_reaches_the_magnitude__is_infinite() -> None:
    assert np.isinf(half_width_db([1.0, 0.0, 1e-320, 1.0], [1.0, 0.0, 1.0, np.inf])).all()
