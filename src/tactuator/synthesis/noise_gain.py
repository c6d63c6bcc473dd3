"""Gain of a loop for white sensor noise, as rms of the command.

For white noise of unit rms the command's rms is the root of the mean of |C S|^2 over frequency up to half the rate.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import SampledSystem


@cache
def quadrature(rate_hz: float, panels: int = 14, nodes: int = 12) -> tuple[FloatArray, FloatArray]:
    """Return the frequencies and weights, shape (panels * nodes,), of a mean over 0..rate/2: Gauss-Legendre on panels
    of equal width in log frequency over six decades (what lies below is negligible for a bounded response).
    """
    points, weights = np.polynomial.legendre.leggauss(nodes)
    edges = np.geomspace(0.5e-6 * rate_hz, 0.5 * rate_hz, panels + 1)
    logs = np.log(edges)
    half = 0.5 * np.diff(logs)[:, None]
    frequency = np.exp(logs[:-1, None] + half * (1.0 + points))
    share = half * weights * frequency / (0.5 * rate_hz)
    return frequency.ravel(), share.ravel()


def command_noise_gain(loop: FeedbackLoop) -> float:
    """Return the rms of the command per rms of white sensor noise, for a stable sampled loop."""
    assert isinstance(loop.open_loop, SampledSystem)
    frequency, weight = quadrature(loop.open_loop.rate_hz, panels=60, nodes=16)
    return float(np.sqrt(np.sum(weight * np.abs(loop.command_sensitivity(frequency)) ** 2)))
