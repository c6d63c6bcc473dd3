"""Third-octave bands (IEC 61260-1, base ten)."""

from dataclasses import dataclass

import numpy as np

from tactuator.errors import BadInput


@dataclass(frozen=True)
class Band:
    """A band of frequencies: edges and mid frequency in hertz."""

    low_hz: float
    centre_hz: float
    high_hz: float


def third_octave_bands(low_hz: float, high_hz: float) -> tuple[Band, ...]:
    """Return the third-octave bands whose mid frequencies 1000 * 10^(k/10) lie within [low_hz, high_hz] (2 % tolerance:
    nominal frequencies are rounded).

    Raises BadInput unless 0 < low_hz <= high_hz.
    """
    if not 0.0 < low_hz <= high_hz:
        raise BadInput(f"band {low_hz}..{high_hz} Hz", "0 < low <= high")
    first = int(np.ceil(10.0 * np.log10(low_hz / 1000.0 / 1.02)))
    last = int(np.floor(10.0 * np.log10(high_hz / 1000.0 * 1.02)))
    half = 10.0 ** (1.0 / 20.0)
    centres = [1000.0 * 10.0 ** (k / 10.0) for k in range(first, last + 1)]
    return tuple(Band(centre / half, centre, centre * half) for centre in centres)
