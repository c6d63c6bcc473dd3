"""What no rig is asked to play."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from tactuator.errors import BadInput

REFERENCE_MAX = 1000.0
"""Threshold units: 60 dB SL, the full scale of a reference in a WAV and in Q31."""


def require_playable(reference: NDArray[Any]) -> None:
    """Raises BadInput for a reference, shape (n, channels), that is not finite or beyond 60 dB SL."""
    if reference.size and not (reference.max() <= REFERENCE_MAX and reference.min() >= -REFERENCE_MAX):
        raise BadInput(
            "the reference is not finite or beyond 60 dB SL; "
            f"allowed: finite, at most {REFERENCE_MAX:g} threshold units"
        )
