"""Linear-phase band filters over a stream, with their delay taken out.

The work is done in frames that are counted from the stream's first sample, so the output does not depend on how the
input is cut into blocks, bit for bit. Outside the stream the signal is zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal

from tactuator.errors import BadInput
from tactuator.speech.reading import Samples

ATTENUATION_DB = 80.0
"""Of a band filter's stop bands; its ripple in the pass band is then 0.001 dB."""


def band_kernel(low_hz: float, high_hz: float, transition_hz: float, rate_hz: float) -> Samples:
    """Linear-phase Kaiser band-pass of odd length, -6 dB at `low_hz` and `high_hz`; a low-pass where low_hz is 0.

    Each edge falls from 0.001 dB to 80 dB down within `transition_hz`, centred on the edge. Raises BadInput where the
    edges and the transition do not fit between 0 and half the rate.
    """
    half = 0.5 * transition_hz
    fits_below = low_hz == 0.0 or half <= low_hz < high_hz - transition_hz
    if not (fits_below and 0.0 < half <= high_hz < 0.5 * rate_hz - half):
        raise BadInput(
            f"band {low_hz:g}..{high_hz:g} Hz with edges {transition_hz:g} Hz wide at {rate_hz:g} Hz; "
            f"allowed: edges that do not overlap, within 0..{0.5 * rate_hz:g} Hz"
        )
    taps, beta = signal.kaiserord(ATTENUATION_DB, transition_hz / (0.5 * rate_hz))
    cutoff = high_hz if low_hz == 0.0 else [low_hz, high_hz]
    kernel = signal.firwin(taps | 1, cutoff, window=("kaiser", beta), pass_zero=low_hz == 0.0, fs=rate_hz, scale=False)
    return np.asarray(kernel)


def convolve_kernels(first: Samples, second: Samples) -> Samples:
    """Two odd linear-phase kernels in series."""
    return np.asarray(signal.fftconvolve(first, second))


def filter_bank(blocks: Iterable[Samples], kernels: Sequence[Samples]) -> Iterator[NDArray[np.float64]]:
    """Blocks of shape (n,) through every kernel (odd, symmetric): blocks of shape (m, kernels), as long in all."""
    half = max(len(kernel) for kernel in kernels) // 2
    size = fft.next_fast_len(max(8 * half, 1 << 13), real=True)
    hop = size - 2 * half
    spectra = [_spectrum(kernel, half, size) for kernel in kernels]
    history, waiting = np.zeros(2 * half), half  # `waiting`: samples of the filters' delay not yet dropped
    for block in blocks:
        history = np.concatenate((history, block))
        while len(history) >= size:
            yield _frame(history[:size], spectra, half)[waiting:]
            history, waiting = history[hop:], 0
    remaining = len(history) - half - waiting
    history = np.concatenate((history, np.zeros(size + half)))
    while remaining > 0:
        frame = _frame(history[:size], spectra, half)[waiting:][:remaining]
        yield frame
        history, remaining, waiting = history[hop:], remaining - len(frame), 0


def _spectrum(kernel: Samples, half: int, size: int) -> NDArray[np.complex128]:
    offset = half - len(kernel) // 2  # a shorter kernel is centred on the longest
    padded = np.zeros(size)
    padded[offset : offset + len(kernel)] = kernel
    return np.asarray(fft.rfft(padded))


def _frame(samples: Samples, spectra: Sequence[NDArray[np.complex128]], half: int) -> NDArray[np.float64]:
    spectrum = fft.rfft(samples)
    outputs = [fft.irfft(spectrum * kernel, len(samples))[2 * half :] for kernel in spectra]
    return np.stack(outputs, axis=1)
