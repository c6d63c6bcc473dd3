"""A finger drums at 1 to 10 Hz: what is felt is never more than 1.5 dB too high.

Six sounds on three channels at 30 dB SL; judged as in landing.py, with the same device. Seen to fail with --wrong,
which feeds forward three times the mass.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from witnesses.touch import felt
from witnesses.touch.landing import compare
from witnesses.touch.sounds import LEVEL_DB_SL, SOUNDS, spoken

RATES_HZ = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 10.0)
TONES_HZ = (31.0, 170.0)
RUN_S = 10.0


def drummed(rng: np.random.Generator, rate_hz: float, samples: int) -> NDArray[np.int32]:
    """Return 1 where a finger touches that drums at a rate, for 0.3 to 0.7 of each turn."""
    turns = np.arange(samples) / felt.example().rate_hz * rate_hz + rng.uniform()
    return np.asarray(turns % 1.0 < rng.uniform(0.3, 0.7), dtype=np.int32)


def asked(rng: np.random.Generator, kind: str, place: int) -> FloatArray:
    """Return the reference of one of the sounds, tones or speech."""
    time = felt.times(RUN_S)
    if kind in SOUNDS:
        return SOUNDS[kind](rng, time.size)
    if kind == "speech":
        return np.resize(next(iter(spoken(None).values()))[:, place], time.size)
    return np.asarray(10.0 ** (LEVEL_DB_SL / 20.0) * np.sin(2.0 * np.pi * float(kind) * time))


def main() -> int:
    """Print the worst of each sound; return 0 where all are within 1.5 dB."""
    given = felt.arguments(
        __doc__, 1, "runs of each sound, rate and channel", wrong="feed forward three times the mass: broken"
    )
    rng = np.random.default_rng(given.seed)
    kept = []
    for kind in (*SOUNDS, "speech", *(str(tone) for tone in TONES_HZ)):
        too_high_db = -np.inf
        for place in range(3):
            for rate_hz in RATES_HZ * given.count:
                reference = asked(rng, kind, place)
                touching = drummed(rng, rate_hz, reference.size)
                change_db, free, _, _ = compare(rng, place, felt.judged(place, given.wrong), reference, touching)
                too_high_db = max(too_high_db, float(np.max(change_db[felt.is_sound(free)])))
        kept.append(felt.verdict(f"drumming, {kind}: too high at most", too_high_db, 1.5))
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
