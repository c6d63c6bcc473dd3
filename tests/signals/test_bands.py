"""Third-octave bands against the nominal frequencies of IEC 61260-1."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.signals.decibels import db, from_db
from tactuator.signals.spectra import third_octave_bands

NOMINAL = [2, 2.5, 3.15, 4, 5, 6.3, 8, 10, 12.5, 16, 20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250]


def test_third_octave_bands__two_to_250__are_the_nominal_ones() -> None:
    centres = [band.centre_hz for band in third_octave_bands(2.0, 250.0)]
    np.testing.assert_allclose(centres, NOMINAL, rtol=0.02)


def test_third_octave_bands__neighbours__share_an_edge() -> None:
    bands = third_octave_bands(2.0, 300.0)
    np.testing.assert_allclose([b.high_hz for b in bands[:-1]], [b.low_hz for b in bands[1:]])


@pytest.mark.parametrize(("low", "high"), [(0.0, 10.0), (-1.0, 10.0), (20.0, 10.0)])
def test_third_octave_bands__no_band__is_refused(low: float, high: float) -> None:
    with pytest.raises(BadInput, match="allowed: 0 < low"):
        third_octave_bands(low, high)


def test_db__hand_numbers__are_met() -> None:
    np.testing.assert_allclose(db([1.0, 10.0, -2.0, 1j]), [0.0, 20.0, 6.020599913, 0.0], atol=1e-9)
    assert db(0.0) == -np.inf
    np.testing.assert_allclose(from_db([0.0, 20.0, -6.020599913]), [1.0, 10.0, 0.5], rtol=1e-9)
