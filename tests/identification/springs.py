"""Mechanisms that are not linear, under odd multisines of random phases: integrated with 20 steps a sample.

Nothing here is the package's. Many records run at once, one a lane; the converter holds the command.
"""

from dataclasses import dataclass

import numpy as np

OVER = 20


@dataclass(frozen=True)
class Multisines:
    """Records of `realisations` multisines, each of `periods` periods; lines excited, equally loud."""

    rate_hz: float
    period: int
    periods: int
    realisations: int
    lines: np.ndarray

    def commands(self, records, rms, rng):
        made = np.zeros((self.realisations, self.period, records))
        spectrum = np.zeros((self.realisations, self.period // 2 + 1, records), dtype=complex)
        turn = rng.uniform(0.0, 2.0 * np.pi, (self.realisations, self.lines.size, records))
        spectrum[:, self.lines] = np.exp(1j * turn)
        made = np.fft.irfft(spectrum, self.period, axis=1)
        made *= rms / np.sqrt(np.mean(made**2, axis=1, keepdims=True))
        return np.concatenate([np.tile(one, (self.periods, 1)) for one in made])

    def about(self):
        return {
            "period_samples": str(self.period),
            "periods": str(self.periods),
            "realisations": str(self.realisations),
            "excited_lines": " ".join(str(k) for k in self.lines),
            "hold": "zero-order",
        }


def lines_of(rate_hz, period, band_hz, rng):
    """Odd lines between two frequencies, one of three left silent at random."""
    odd = np.arange(1, period // 2, 2)
    odd = odd[(odd * rate_hz / period >= band_hz[0]) & (odd * rate_hz / period <= band_hz[1])]
    groups = odd[: odd.size // 3 * 3].reshape(-1, 3)
    silent = rng.integers(0, 3, groups.shape[0])
    return np.sort(groups[np.arange(3)[None, :] != silent[:, None]])


def hardening(commands, rate_hz, size, damping, cubic, square=0.0):
    """Positions (samples, records) of x'' = size^2 (u - x - square x^2 - cubic x^3) - damping x', by Verlet's steps."""
    h = 1.0 / (rate_hz * OVER)
    place, speed = np.zeros(commands.shape[1]), np.zeros(commands.shape[1])
    positions = np.zeros(commands.shape)
    half, drag = 0.5 * h, 1.0 / (1.0 + 0.5 * h * damping)
    for k, command in enumerate(commands):
        positions[k] = place
        for _ in range(OVER):
            pull = size**2 * (command - place * (1.0 + place * (square + cubic * place)))
            middle = speed + half * (pull - damping * speed)
            place = place + h * middle
            pull = size**2 * (command - place * (1.0 + place * (square + cubic * place)))
            speed = drag * (middle + half * pull)
    return positions
