"""Causal filters whose state goes on from block to block, for codings that are to work live."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from tactuator.arrays import FloatArray

RIPPLE_DB, STOP_DB, ORDER, FLAT_TO = 0.1, 50.0, 6, 0.93
"""Of the low-pass at the top of the felt band: within the ripple up to that share of the edge, 5 dB down at the edge,
where it passes as much as the file's filter, and 50 dB from 1.26 times the edge; 5.2 ms late at 250 Hz."""
CARRIER_STOP_DB, CARRIER_ORDER = 30.0, 3
"""Of the low-pass behind carriers, whose sidebands their smoothing has taken down already: 1.1 ms late at 250 Hz."""


class CausalBank:
    """Filters side by side, second-order sections (n, 6) each; their states go on between blocks (filters, m).

    block: None, or the length that every block has. Then each filter is one matrix from its state and a block to the
    block that comes out and the state behind it, which for some ten samples takes a tenth of the time.
    """

    def __init__(self, filters: Sequence[FloatArray], rate_hz: float, block: int | None = None) -> None:
        self._filters, self._rate_hz = filters, rate_hz
        self._states = [np.zeros((len(sections), 2)) for sections in filters]
        self._order = 2 * max((len(sections) for sections in filters), default=0)
        self._state = np.zeros((len(filters), self._order))
        self._matrices = None if block is None else np.stack([_matrix(each, self._order, block) for each in filters])

    def push(self, block: FloatArray) -> FloatArray:
        """Return a block, as long."""
        if self._matrices is None:
            output = np.empty_like(block)
            for k, (sections, row) in enumerate(zip(self._filters, block, strict=True)):
                output[k], self._states[k] = scipy.signal.sosfilt(sections, row, zi=self._states[k])
            return output
        both = self._matrices @ np.hstack((self._state, block))[:, :, None]
        self._state = both[:, : self._order, 0]
        return np.asarray(both[:, self._order :, 0])

    def delay_s(self, which: int, frequency_hz: float) -> float:
        """Return the group delay of a filter at a frequency, seconds."""
        return group_delay_s(self._filters[which], self._rate_hz, frequency_hz)


def _matrix(sections: FloatArray, order: int, block: int) -> FloatArray:
    """Return the matrix (order + block, order + block) from state and input to state and output."""
    count, size = len(sections), order + block
    states = np.zeros((count, size, 2))
    for k in range(2 * count):
        states[k // 2, k, k % 2] = 1.0
    inputs = np.vstack((np.zeros((order, block)), np.eye(block)))
    output, after = scipy.signal.sosfilt(sections, inputs, axis=1, zi=states)
    matrix = np.zeros((size, size))
    matrix[: 2 * count] = after.transpose(0, 2, 1).reshape(2 * count, size)
    matrix[order:] = output.T
    return matrix


def group_delay_s(sections: FloatArray, rate_hz: float, frequency_hz: float) -> float:
    """Return the group delay of sections at a frequency, seconds."""
    step_hz = 1e-3
    ends_hz = np.array([frequency_hz - step_hz, frequency_hz + step_hz])
    response = scipy.signal.sosfreqz(sections, ends_hz, fs=rate_hz)[1]
    return float(-np.angle(response[1] / response[0]) / (4.0 * np.pi * step_hz))


def band_sections(low_hz: float, high_hz: float, rate_hz: float) -> FloatArray:
    """Return a low-pass with its edge at `high_hz`, after a high-pass at `low_hz` (0: none)."""
    low_pass = scipy.signal.ellip(ORDER, RIPPLE_DB, STOP_DB, FLAT_TO * high_hz, fs=rate_hz, output="sos")
    if low_hz == 0.0:
        return np.asarray(low_pass)
    return np.concatenate((scipy.signal.butter(2, low_hz, "highpass", fs=rate_hz, output="sos"), low_pass))


def carrier_sections(high_hz: float, rate_hz: float) -> FloatArray:
    """Return a low-pass for modulated carriers, flat within RIPPLE_DB up to `high_hz`."""
    return np.asarray(scipy.signal.ellip(CARRIER_ORDER, RIPPLE_DB, CARRIER_STOP_DB, high_hz, fs=rate_hz, output="sos"))


@dataclass
class CausalStream:
    """A coding as it works live (see `CodingStream`). code: blocks (n,) to blocks (m, signals)."""

    rate_in_hz: int
    delay_s: Mapping[float, float]
    code: Callable[[FloatArray], FloatArray]

    def push(self, block: FloatArray) -> FloatArray:
        """Return what is felt of a block."""
        return self.code(block)
