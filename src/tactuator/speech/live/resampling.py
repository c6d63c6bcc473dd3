"""From a source's clock to the display's: a resampler whose ratio a servo sets so that the buffer keeps its length."""

from __future__ import annotations

import numpy as np

from tactuator.arrays import FloatArray

CROSSINGS, PHASES, BETA, CUTOFF = 16, 512, 8.0, 0.94
"""Zero crossings of the kernel on each side, its phases, Kaiser's beta (80 dB), and -6 dB as a share of half the slower
rate."""
MOST_DRIFT = 2e-3
"""Clocks that differ by more are not two clocks of one rate."""
SETTLE_S = 2.0
"""Time constant of the servo: clocks 200 ppm apart then cost 0.4 ms of buffer until they are known."""
LOOK_S = 0.25
"""The buffer's length is its least over this time: a source gives its samples in pieces, and a look may come late."""
LATE_S = 0.01
"""A buffer longer by this is cut back: the source was held up, and came in one, or the display stood still."""
PRIMING = 4
"""Blocks in which the earliest look is sought before the signal is begun or taken up."""
LONGER_S, MOST_TARGET_S = 0.002, 0.02
"""The buffer becomes longer by the first with each drop-out: this machine's looks are later than was thought."""
FADE_S = 0.005


class ClockedResampler:
    """Takes samples at rate_in_hz as they come and gives blocks at rate_out_hz as they are asked for.

    target_s: length of the buffer that is kept at the earliest look. Where it runs empty, or is too long, the signal is
    faded out and taken up again with a fade: a drop-out; after one that ran empty the target is longer. dropouts: how
    often that was. drift: of the source's clock against the display's, as found. fill_s, worst_s: length of the buffer,
    and the greatest difference of its least over LOOK_S from the target, from `settled_s` after the beginning on.
    """

    def __init__(self, rate_in_hz: int, rate_out_hz: int, target_s: float, settled_s: float = 10.0) -> None:
        self._rate_in, self._rate_out, self.target_s = rate_in_hz, rate_out_hz, target_s
        share = CUTOFF * min(1.0, rate_out_hz / rate_in_hz)
        self._half = int(np.ceil(CROSSINGS / share))
        self._table = _kernels(self._half, share)
        self._slopes = np.diff(self._table, axis=0)
        self._samples, self._at = np.zeros(2 * self._half), float(self._half)
        self._integral, self._given_s, self._settled_s = 0.0, 0.0, settled_s
        self.dropouts, self.drift, self.worst_s, self.ended = 0, 0.0, 0.0, False
        self.restart()

    def restart(self) -> None:
        """Take the signal up anew, as after a stop of the display."""
        self._priming, self._earliest, self._faded_in, self._came = PRIMING, np.inf, False, False
        self._least, self._looked_s = np.inf, 0.0

    @property
    def delay_s(self) -> float:
        """Return the delay of the kernel, seconds."""
        return self._half / self._rate_in

    @property
    def fill_s(self) -> float:
        """Return how much of the source waits, seconds."""
        return (len(self._samples) - self._half - self._at) / self._rate_in

    def push(self, samples: FloatArray) -> None:
        """Take samples (n,) of the source."""
        self._came = self._came or bool(len(samples))
        self._samples = np.concatenate((self._samples, samples))

    def take(self, count: int) -> FloatArray:
        """Return the next `count` samples."""
        asked_s = count / self._rate_out
        step = self._rate_in / self._rate_out * (1.0 + self.drift)
        spare_s = self.fill_s - asked_s - self.target_s
        if self._priming:
            return self._prime(count, step, spare_s)
        too_long, empty = self._watch(spare_s, asked_s), spare_s < -self.target_s and not self.ended
        if too_long or empty:
            self.target_s = min(MOST_TARGET_S, self.target_s + (LONGER_S if empty else 0.0))
            self.dropouts += 1
            self.restart()
            return self._interpolate(count, step) * self._line(count)[::-1]
        rows = self._interpolate(count, step)
        if not self._faded_in:
            rows, self._faded_in = rows * self._line(count), True
        return rows

    def _prime(self, count: int, step: float, spare_s: float) -> FloatArray:
        """Give silence while looking how early looks are; then begin where the earliest leaves the target."""
        self._earliest = min(self._earliest, spare_s)
        self._at += step * count
        self._priming -= 1
        if not self._came and not self.ended:
            self._priming, self._earliest = PRIMING, np.inf
        self._came = False
        if not self._priming:
            self._at = max(float(self._half), self._at + self._earliest * self._rate_in)
        return np.zeros(count)

    def _line(self, count: int) -> FloatArray:
        return np.minimum(1.0, np.arange(count) / max(1, min(count, round(FADE_S * self._rate_out))))

    def _watch(self, spare_s: float, asked_s: float) -> bool:
        """Set the drift by the buffer's length before a block of `asked_s`; return whether it is too long."""
        if self.ended:
            return False
        self._least = min(self._least, spare_s)
        self._looked_s += asked_s
        if self._looked_s < LOOK_S:
            return False
        error_s, looked_s, self._least, self._looked_s = self._least, self._looked_s, np.inf, 0.0
        if error_s > LATE_S:
            return True
        self._integral += error_s * looked_s / (4.0 * SETTLE_S**2)
        self.drift = float(np.clip(error_s / SETTLE_S + self._integral, -MOST_DRIFT, MOST_DRIFT))
        self._given_s += looked_s
        if self._given_s > self._settled_s:
            self.worst_s = max(self.worst_s, abs(error_s))
        return False

    def _interpolate(self, count: int, step: float) -> FloatArray:
        positions = self._at + step * np.arange(count)
        whole = np.floor(positions).astype(int)
        missing = int(whole[-1]) + self._half + 1 - len(self._samples)
        samples = self._samples if missing <= 0 else np.concatenate((self._samples, np.zeros(missing)))
        shape, apart = (len(samples) - 2 * self._half + 1, 2 * self._half), 2 * samples.strides
        every: FloatArray = np.ndarray(shape, float, samples, 0, apart)  # sliding_window_view takes as long as the rest
        windows = every[whole - self._half + 1]
        phase = (positions - whole) * PHASES
        row = phase.astype(int)
        self._at += step * count
        gone = max(0, int(self._at) - self._half)
        self._samples, self._at = samples[gone:], self._at - gone
        begun = np.einsum("ij,ij->i", windows, self._table[row])
        return np.asarray(begun + (phase - row) * np.einsum("ij,ij->i", windows, self._slopes[row]))


def _kernels(half: int, share: float) -> FloatArray:
    """Return the kernel, a windowed sinc, at every phase of a sample, (PHASES + 1, 2 half)."""
    offset = np.arange(-half + 1, half + 1) - np.arange(PHASES + 1)[:, None] / PHASES
    window = np.i0(BETA * np.sqrt(np.clip(1.0 - (offset / half) ** 2, 0.0, None))) / np.i0(BETA)
    kernels = np.sinc(share * offset) * window
    return np.asarray(kernels / kernels.sum(axis=1, keepdims=True))
