"""The limiter's gain: the smallest smooth reduction, in dB, that is nowhere less than what is needed."""

from __future__ import annotations

import numpy as np

from tactuator.arrays import FloatArray

ATTACK_DB_PER_MS = 0.25
RELEASE_DB_PER_MS = 0.05
"""Slopes at which a reduction comes and goes; both are well below the 0.5 dB/ms beyond which a gain is felt to jump."""


def reduction_envelope(need_db: FloatArray, start_db: float | None, rate_hz: float) -> FloatArray:
    """Return the lower envelope of straight flanks: max over s of need(s) less the slope times the distance to s.

    need_db: shape (n,), zero or more. start_db: the reduction one sample earlier, None where
    nothing went before. A flank rises towards a need at the
    attack's slope and falls after it at the release's: no other reduction with these slopes is smaller anywhere.
    """
    index = np.arange(len(need_db))
    attack, release = ATTACK_DB_PER_MS * 1e3 / rate_hz, RELEASE_DB_PER_MS * 1e3 / rate_hz
    after = np.maximum.accumulate(need_db + release * index) - release * index
    if start_db is not None:
        after = np.maximum(after, start_db - release * (index + 1.0))
    before = np.maximum.accumulate((after - attack * index)[::-1])[::-1] + attack * index
    reduction = np.maximum(before, 0.0)
    if start_db is None:
        return np.asarray(reduction)
    return np.asarray(np.minimum(reduction, start_db + attack * (index + 1.0)))
