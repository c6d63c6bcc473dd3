"""The response that a loop leaves unbiased: from an autoregressive model of high order with the command as input.

A loop answers the noise, so that position over command, band by band, leans towards the inverse of the controller
wherever the noise moves the command. What the position owes to its own past and to the command's, one sample ago and
earlier, has no such part: least squares of high order are consistent (Ljung, System Identification, 1999, sections 8.4
and 13.4), whatever coloured the noise and wherever it enters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.identification.lines import LocalResponse, Spectrum

_MOST = 300
"""Highest order, samples."""


def autoregressive_response(taken: Sequence[Spectrum], like: LocalResponse) -> LocalResponse | None:
    """Return the response (m,) at the frequencies of `like` from all records together, of the order of the least
    information criterion (Akaike, 1974); None where the records are too short.
    """
    samples = sum(part.samples for part in taken)
    # samples of the record for each unit of the highest order
    most = min(_MOST, *(part.samples // 20 for part in taken))
    if most < 2:
        return None
    triangle = _triangle(taken, most)
    left = np.cumsum(triangle[::-1, -1] ** 2)[::-1]  # what the columns before the k-th leave unexplained
    orders = np.arange(1, most + 1)
    order = int(orders[np.argmin(samples * np.log(left[2 * orders]) + 4.0 * orders)])
    count = 2 * order
    inverse = np.linalg.inv(triangle[:count, :count])
    weights = inverse @ triangle[:count, -1]
    variance = left[count] / (samples - count)
    delays = np.exp(-2j * np.pi * np.outer(like.frequency_hz / taken[0].rate_hz, np.arange(1, order + 1)))
    poles = 1.0 - delays @ weights[0::2]
    response = delays @ weights[1::2] / poles
    slopes = np.empty((poles.size, count), dtype=np.complex128)
    slopes[:, 0::2], slopes[:, 1::2] = delays * (response / poles)[:, None], delays / poles[:, None]
    spread = variance * np.sum(np.abs(slopes @ inverse) ** 2, axis=1)
    turned = np.exp(-2j * np.pi * like.frequency_hz * taken[0].shift / taken[0].rate_hz)
    # values at more frequencies than there are weights know no more than the weights do
    known = max(like.frequency_hz.size / count, 1.0)
    return replace(like, value=response * turned, variance=spread * known, noise=variance / np.abs(poles) ** 2)


def _triangle(taken: Sequence[Spectrum], order: int) -> FloatArray:
    """Return the triangle (2 order + 1, 2 order + 1) of the columns y(t - 1), u(t - 1), y(t - 2), ... and y(t), from
    correlations: what lies before a record's beginning counts as zero.
    """
    lags = np.arange(order + 1)
    shared = np.zeros((2, 2, 2 * order + 1))
    for part in taken:
        size = scipy.fft.next_fast_len(part.samples + order, real=True)
        lines = np.fft.rfft([part.measured, part.samples_of(np.concatenate([[0.0], part.command[1:]]))], size)
        for i, j in np.ndindex(2, 2):
            shared[i, j] += np.fft.irfft(np.conj(lines[i]) * lines[j], size)[np.arange(-order, order + 1)]
    # share of white noise that keeps the products positive definite (-120 dB)
    shared[[0, 1], [0, 1], order] *= 1.0 + 1e-12
    # products of y(t - 1), u(t - 1), y(t - 2), ..., and of each with y(t)
    between = shared[:, :, order + lags[1:, None] - lags[None, 1:]].transpose(2, 0, 3, 1).reshape(2 * order, -1)
    ahead = shared[:, 0, order + lags[1:]].T.reshape(-1)
    whole = np.block([[between, ahead[:, None]], [ahead[None], shared[0, 0, order]]])
    return np.linalg.cholesky(whole).T
