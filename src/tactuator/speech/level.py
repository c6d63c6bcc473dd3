"""The level of an utterance: the rms, in dB SL, of its frames within 30 dB of the loudest.

As everywhere, a level is that of the sinusoid of the same rms: a sinusoid of amplitude 1 threshold unit is at 0 dB SL,
so a frame of rms x is at 20 log10(sqrt(2) x).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

FRAME_S = 0.025
FRAMES_WITHIN_DB = 30.0


@dataclass
class LevelMeter:
    """Takes blocks (n, channels) one after the other and keeps only the frames' powers (0.025 s each)."""

    rate_hz: float
    _powers: list[FloatArray] = field(default_factory=list)
    _rest: FloatArray | None = None

    def push(self, block: FloatArray) -> None:
        """Add a block to the frames counted."""
        length = round(FRAME_S * self.rate_hz)
        block = block if self._rest is None else np.concatenate((self._rest, block))
        whole = len(block) // length
        frames = block[: whole * length].reshape(whole, length, block.shape[1])
        self._powers.append(np.einsum("ijk,ijk->ik", frames, frames) / length)
        self._rest = block[whole * length :].copy()

    def frame_levels_db(self) -> FloatArray:
        """Return the level of every whole frame, shape (frames, channels); -inf where it is silent."""
        with np.errstate(divide="ignore"):
            return np.asarray(10.0 * np.log10(2.0 * np.concatenate(self._powers)))

    def level_db(self) -> float:
        """Return the level of the loudest channel over its frames within 30 dB of its loudest frame; -inf for silence.

        Raises BadInput where not one frame was whole.
        """
        powers = np.concatenate(self._powers) if self._powers else np.zeros((0, 1))
        if not len(powers):
            raise BadInput("shorter than one frame", f"{1e3 * FRAME_S:g} ms or longer")
        best = max(_active_power(channel) for channel in powers.T)
        with np.errstate(divide="ignore"):
            return float(10.0 * np.log10(2.0 * best))


def _active_power(powers: FloatArray) -> float:
    loudest = float(powers.max())
    return float(powers[powers >= loudest * 10.0 ** (-FRAMES_WITHIN_DB / 10.0)].mean())
