"""Linear-phase band filters over a stream, with their delay taken out.

The work is done in frames that are counted from the stream's first sample, so the output does not depend on how the
input is cut into blocks, bit for bit. Outside the stream the signal is zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain

import numpy as np
from scipy import fft, signal

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput

ATTENUATION_DB = 84.0
"""Asked of Kaiser's formula, which is an estimate, so that a stop band is 80 dB down; ripple is then 0.001 dB."""


def band_kernel(low_hz: float, high_hz: float, transition_hz: float, rate_hz: float) -> FloatArray:
    """Return a linear-phase Kaiser band-pass of odd length, -6 dB at `low_hz` and `high_hz`; a low-pass where low_hz is
    0.

    Each edge falls from 0.001 dB to 80 dB down within `transition_hz`, centred on the edge. Raises BadInput where the
    edges and the transition do not fit between 0 and half the rate.
    """
    half = 0.5 * transition_hz
    fits_below = low_hz == 0.0 or half <= low_hz < high_hz - transition_hz
    if not (fits_below and 0.0 < half <= high_hz < 0.5 * rate_hz - half):
        raise BadInput(
            f"band {low_hz:g}..{high_hz:g} Hz with edges {transition_hz:g} Hz wide at {rate_hz:g} Hz",
            f"edges that do not overlap, within 0..{0.5 * rate_hz:g} Hz",
        )
    taps, beta = signal.kaiserord(ATTENUATION_DB, transition_hz / (0.5 * rate_hz))
    cutoff = high_hz if low_hz == 0.0 else [low_hz, high_hz]
    kernel = signal.firwin(taps | 1, cutoff, window=("kaiser", beta), pass_zero=low_hz == 0.0, fs=rate_hz, scale=False)
    return np.asarray(kernel)


def convolve_kernels(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return two odd linear-phase kernels in series."""
    return np.asarray(signal.fftconvolve(first, second))


def filter_bank(blocks: Iterable[FloatArray], kernels: Sequence[FloatArray]) -> Iterator[FloatArray]:
    """Filter blocks of shape (n,) through every kernel (odd, symmetric); yield blocks of shape (m, kernels), as long in
    all.
    """
    half, size = _frame_of(kernels)
    spectra = [_spectrum(kernel, half, size) for kernel in kernels]

    def filtered(frame: FloatArray) -> FloatArray:
        spectrum = fft.rfft(frame)
        return np.stack([fft.irfft(spectrum * kernel, size)[2 * half :] for kernel in spectra], axis=1)

    return _overlapped(blocks, half, size, filtered, np.zeros(2 * half))


def filter_columns(blocks: Iterable[FloatArray], kernel: FloatArray) -> Iterator[FloatArray]:
    """Filter blocks of shape (n, columns), every column through the same kernel; yield blocks as long in all."""
    half, size = _frame_of([kernel])
    spectrum = _spectrum(kernel, half, size)

    def filtered(frame: FloatArray) -> FloatArray:
        columns = np.ascontiguousarray(frame.T)
        return np.asarray(fft.irfft(fft.rfft(columns) * spectrum, size)[:, 2 * half :].T)

    stream = iter(blocks)
    first = next(stream, None)
    if first is not None:
        start = np.zeros((2 * half, first.shape[1]))
        yield from _overlapped(chain([first], stream), half, size, filtered, start)


def _frame_of(kernels: Sequence[FloatArray]) -> tuple[int, int]:
    """Return half the longest kernel, and the length of a frame."""
    half = max(len(kernel) for kernel in kernels) // 2
    return half, int(fft.next_fast_len(max(8 * half, 1 << 13), real=True))


def _overlapped(
    blocks: Iterable[FloatArray],
    half: int,
    size: int,
    filtered: Callable[[FloatArray], FloatArray],
    history: FloatArray,
) -> Iterator[FloatArray]:
    hop = size - 2 * half
    waiting = half  # samples of the filters' delay not yet dropped
    for block in blocks:
        history = np.concatenate((history, block))
        while len(history) >= size:
            yield filtered(history[:size])[waiting:]
            history, waiting = history[hop:], 0
    remaining = len(history) - half - waiting
    history = np.concatenate((history, np.zeros((size + half, *history.shape[1:]))))
    while remaining > 0:
        frame = filtered(history[:size])[waiting:][:remaining]
        yield frame
        history, remaining, waiting = history[hop:], remaining - len(frame), 0


def _spectrum(kernel: FloatArray, half: int, size: int) -> ComplexArray:
    offset = half - len(kernel) // 2  # a shorter kernel is centred on the longest
    padded = np.zeros(size)
    padded[offset : offset + len(kernel)] = kernel
    return np.asarray(fft.rfft(padded))
