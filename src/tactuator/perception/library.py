"""The curves that come with tactuator, each with its provenance."""

from functools import cache
from importlib.resources import files

import numpy as np

from tactuator.errors import BadInput
from tactuator.perception.curve import Provenance, ThresholdCurve

_SHIPPED: dict[str, tuple[str, Provenance, str]] = {
    "bolanowski-1988": (
        "digitised-bolanowski-1988-thenar.csv",
        "inferred",
        "Bolanowski et al. (1988), thenar eminence; recovered from a table of accelerations, attribution inferred",
    ),
    "morioka-griffin-2006": (
        "morioka-griffin-2006-handle.csv",
        "digitised",
        "Morioka & Griffin (2006), hand-transmitted vibration on a handle; published accelerations converted",
    ),
}


def curve_names() -> tuple[str, ...]:
    """Return the names that `curve` knows."""
    return tuple(_SHIPPED)


@cache
def curve(name: str) -> ThresholdCurve:
    """Return the curve of that name. Raises BadInput, with the names that there are, for another."""
    if name not in _SHIPPED:
        raise BadInput(f"threshold curve {name!r} is not in the library", f"{', '.join(_SHIPPED)}")
    filename, provenance, source = _SHIPPED[name]
    text = files("tactuator.perception").joinpath("data", filename).read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows[1:]])
    frequency, values = table[:, 0], table[:, 1]
    if rows[0].split(",")[1] == "acceleration_m_s2_rms":
        values = level_from_acceleration(frequency, values)
    return ThresholdCurve(name, frequency, values, provenance, source)


def level_from_acceleration(
    frequency_hz: np.ndarray[tuple[int], np.dtype[np.float64]],
    acceleration_m_s2_rms: np.ndarray[tuple[int], np.dtype[np.float64]],
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the level (dB re 1 um peak) of a sinusoid of that rms acceleration: 20 log10(sqrt(2) a / (2 pi f)^2 /
    1e-6).
    """
    peak_m = np.sqrt(2.0) * acceleration_m_s2_rms / (2.0 * np.pi * frequency_hz) ** 2
    return np.asarray(20.0 * np.log10(peak_m / 1e-6))
