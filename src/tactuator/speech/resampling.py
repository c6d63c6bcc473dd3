"""A stream at one rate to a stream at another: polyphase, linear phase, no delay, bounded memory.

`scipy.signal.upfirdn` does the arithmetic; this file keeps the history between blocks so that the output is the same,
bit for bit, however the input is cut. Output sample m lies at the time m / rate_out of the input's first sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from math import gcd

import numpy as np
from scipy import signal

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

ATTENUATION_DB = 90.0
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
    taps, beta = signal.kaiserord(ATTENUATION_DB, (stop_hz - pass_hz) / (0.5 * inner_hz))
    half = down * int(np.ceil(taps / 2 / down))
    kernel = signal.firwin(2 * half + 1, 0.5 * (pass_hz + stop_hz), window=("kaiser", beta), fs=inner_hz)
    kernel = kernel * up
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
        yield _outputs(kernel, history, up, down, first * up // down, done + middle, ready + middle)
        done = ready
        keep = max(0, ((done + middle) * down // up - reach) // down * down)  # on the grid of whole output samples
        history, first = history[keep - first :], keep
    end = -(-total * up // down)
    tail = np.concatenate((history, np.zeros(reach + 1)))
    yield _outputs(kernel, tail, up, down, first * up // down, done + middle, end + middle)


def _outputs(
    kernel: FloatArray, history: FloatArray, up: int, down: int, origin: int, start: int, stop: int
) -> FloatArray:
    """Return the output samples start..stop (counted with the kernel's delay), the history's first lying at output
    `origin`.
    """
    if stop <= start:
        return np.zeros(0)
    filtered = signal.upfirdn(kernel, history, up, down)
    return np.asarray(filtered[start - origin : stop - origin])
