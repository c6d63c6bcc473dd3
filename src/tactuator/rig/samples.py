"""Checks of the samples that a rig is asked to play or to drive."""

from __future__ import annotations

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.runtime._core import ffi, lib

REFERENCE_MAX = 1000.0
"""Threshold units: 60 dB SL, the full scale of a reference in a WAV and in Q31."""

_ROUNDED_MAX = REFERENCE_MAX * (1.0 + 2.0**-25)  # what single precision takes for the largest
_SINGLE_MAX = float(np.finfo(np.float32).max)


def take_reference(reference: FloatArray) -> FloatArray:
    """Return a checked copy of a reference of any shape, contiguous, threshold units.

    Raises BadInput for what is not finite or beyond 60 dB SL.
    """
    own = _taken(reference, _ROUNDED_MAX)
    if own is None:
        raise BadInput(
            "the reference is not finite or beyond 60 dB SL", f"finite, at most {REFERENCE_MAX:g} threshold units"
        )
    return own


def take_command(command_v: FloatArray) -> FloatArray:
    """Return a checked copy of a command of any shape, contiguous, volts. Raises BadInput for what is not finite."""
    own = _taken(command_v, _SINGLE_MAX)
    if own is None:
        raise BadInput("the command is not finite", "volts")
    return own


def _taken(samples: FloatArray, most: float) -> FloatArray | None:
    own = np.empty(samples.shape)
    theirs, ours = (ffi.from_buffer("double[]", array) for array in (samples, own))
    return own if lib.tact_reference_take(theirs, ours, own.size, most) else None
