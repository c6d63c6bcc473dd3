"""Streams at another rate and through linear-phase filters, with no delay, in bounded memory.

Resampling is polyphase, with the history kept between blocks; output sample m lies at the time m / rate_out of the
input's first sample. Band filters work in frames that are counted from the stream's first sample.
Both give the same output, bit for bit, however the input is cut into blocks. Outside the stream the signal is zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import chain
from math import gcd

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput

ALIASES_DB = 90.0
"""Of images and aliases; a 16-bit file's own noise lies at about -98 dB."""


@lru_cache(maxsize=8)
def resampling_kernel(rate_in_hz: int, rate_out_hz: int, pass_hz: float) -> tuple[FloatArray, int, int]:
    """Return (kernel, up, down) with a Kaiser low-pass at up * rate_in_hz, flat to `pass_hz`.

    Whatever would fold onto 0..pass_hz, going up or down, is at least 90 dB down; between pass_hz and the edge of the
    slower rate images and aliases may overlap. The kernel's length is odd and its middle a multiple of `down`.
    Raises BadInput where `pass_hz` does not fit below half the slower rate.
    """
    slower = min(rate_in_hz, rate_out_hz)
    if not 0.0 < pass_hz < 0.5 * slower:
        raise BadInput(f"a pass band to {pass_hz:g} Hz does not fit into {slower} Hz", f"below {0.5 * slower:g}")
    common = gcd(rate_in_hz, rate_out_hz)
    up, down = rate_out_hz // common, rate_in_hz // common
    inner_hz = float(rate_in_hz * up)
    stop_hz = slower - pass_hz
    taps, beta = scipy.signal.kaiserord(ALIASES_DB, (stop_hz - pass_hz) / (0.5 * inner_hz))
    half = down * int(np.ceil(taps / 2 / down))
    middle_hz = 0.5 * (pass_hz + stop_hz)
    kernel = up * scipy.signal.firwin(2 * half + 1, middle_hz, window=("kaiser", beta), fs=inner_hz)
    kernel.flags.writeable = False  # it is kept for the next file
    return kernel, up, down


def resample(blocks: Iterable[FloatArray], rate_in_hz: int, rate_out_hz: int, pass_hz: float) -> Iterator[FloatArray]:
    """Resample blocks of shape (n,) at `rate_in_hz`; yield blocks at `rate_out_hz`, in all ceil(frames * rate_out /
    rate_in).
    """
    if rate_in_hz == rate_out_hz:
        yield from blocks
        return
    kernel, up, down = resampling_kernel(rate_in_hz, rate_out_hz, pass_hz)
    middle = (len(kernel) - 1) // 2 // down  # the kernel's delay, in output samples
    reach = -(-(len(kernel) - 1) // up)  # how many input samples back an output looks
    history, first = np.zeros(0), 0  # the input kept, and the index of its first sample
    done, total = 0, 0  # output samples given, input samples seen
    for block in blocks:
        history, total = np.concatenate((history, block)), total + len(block)
        ready = max(done, (total * up - 1) // down + 1 - middle)
        origin = first * up // down - middle
        yield scipy.signal.upfirdn(kernel, history, up, down)[done - origin : ready - origin]
        done = ready
        keep = max(0, ((done + middle) * down // up - reach) // down * down)  # on the grid of whole output samples
        history, first = history[keep - first :], keep
    end = -(-total * up // down)
    tail, origin = np.concatenate((history, np.zeros(reach + 1))), first * up // down - middle
    yield scipy.signal.upfirdn(kernel, tail, up, down)[done - origin : end - origin]


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
    taps, beta = scipy.signal.kaiserord(ATTENUATION_DB, transition_hz / (0.5 * rate_hz))
    edges, window = [low_hz, high_hz] if low_hz else high_hz, ("kaiser", beta)
    return np.asarray(
        scipy.signal.firwin(taps // 2 * 2 + 1, edges, window=window, pass_zero=not low_hz, scale=False, fs=rate_hz)
    )


def convolve_kernels(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return two odd linear-phase kernels in series."""
    return np.asarray(scipy.signal.fftconvolve(first, second))


def filter_bank(blocks: Iterable[FloatArray], kernels: Sequence[FloatArray]) -> Iterator[FloatArray]:
    """Filter blocks of shape (n,) through every kernel (odd, symmetric); yield blocks of shape (m, kernels), as long in
    all.
    """
    half, size = _frame_of(kernels)
    taps = [kernel.tobytes() for kernel in kernels]

    def filtered(frame: FloatArray) -> FloatArray:
        count, spectrum = len(frame), scipy.fft.rfft(frame)
        products = (spectrum * _spectrum(each, half, count) for each in taps)
        return np.stack([scipy.fft.irfft(product, count)[2 * half :] for product in products], axis=1)

    return _overlapped(blocks, half, size, filtered, np.zeros(2 * half))


def filter_columns(blocks: Iterable[FloatArray], kernel: FloatArray) -> Iterator[FloatArray]:
    """Filter blocks of shape (n, columns), every column through the same kernel; yield blocks as long in all."""
    half, size = _frame_of([kernel])
    taps = kernel.tobytes()

    def filtered(frame: FloatArray) -> FloatArray:
        product = scipy.fft.rfft(np.ascontiguousarray(frame.T)) * _spectrum(taps, half, len(frame))
        return np.asarray(scipy.fft.irfft(product, len(frame))[:, 2 * half :].T)

    stream = iter(blocks)
    first = next(stream, None)
    if first is not None:
        start = np.zeros((2 * half, first.shape[1]))
        yield from _overlapped(chain([first], stream), half, size, filtered, start)


def _frame_of(kernels: Sequence[FloatArray]) -> tuple[int, int]:
    """Return half the longest kernel, and the length of a frame."""
    half = max(len(kernel) for kernel in kernels) // 2
    return half, int(scipy.fft.next_fast_len(max(8 * half, 1 << 13), real=True))


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
    while remaining > 0:
        length = _last_frame(2 * half + waiting + remaining, size)
        after = np.zeros((max(0, length - len(history)), *history.shape[1:]))
        frame = filtered(np.concatenate((history[:length], after)))[waiting:][:remaining]
        yield frame
        history, remaining, waiting = history[hop:], remaining - len(frame), 0


def _last_frame(wanted: int, size: int) -> int:
    """Return the length of a stream's last frame: as many eighths of a frame as hold what is wanted of it."""
    return min(size, int(scipy.fft.next_fast_len(-(-8 * wanted // size) * -(-size // 8), real=True)))


@lru_cache(maxsize=32)
def _spectrum(kernel: bytes, half: int, size: int) -> ComplexArray:
    """Return the spectrum of a kernel, float64: it is kept for the next file."""
    taps = np.frombuffer(kernel)
    offset = half - len(taps) // 2  # a shorter kernel is centred on the longest
    return np.asarray(scipy.fft.rfft(np.concatenate((np.zeros(offset), taps)), size))
