"""What a rig is asked to play, taken over, and what none plays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.digital._core import ffi, lib
from tactuator.errors import BadInput

REFERENCE_MAX = 1000.0
"""Threshold units: 60 dB SL, the full scale of a reference in a WAV and in Q31."""

_SINGLE_MAX = REFERENCE_MAX * (1.0 + 2.0**-25)  # what a controller, in single precision, takes for the largest


def take_reference(reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """A reference of any shape, contiguous, threshold units, as an array of one's own.

    Raises BadInput for what is not finite or beyond 60 dB SL.
    """
    own = np.empty(reference.shape)
    theirs, ours = (ffi.from_buffer("double[]", array) for array in (reference, own))
    if not lib.tact_reference_take(theirs, ours, own.size, _SINGLE_MAX):
        raise BadInput(
            "the reference is not finite or beyond 60 dB SL; "
            f"allowed: finite, at most {REFERENCE_MAX:g} threshold units"
        )
    return own
