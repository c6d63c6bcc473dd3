"""Types of arrays by kind of number (shapes are in the docstrings); frequencies; fields that stay as given."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.errors import BadInput

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def frequencies(frequency_hz: ArrayLike, rate_hz: float = np.inf) -> FloatArray:
    """Return frequencies in hertz as an array of the same shape. Raises BadInput for what is not a number of 0 or more,
    or lies above half the sampling rate.
    """
    highest = 0.5 * rate_hz
    try:
        asked = np.asarray(frequency_hz)
    except ValueError:  # rows of unequal length
        asked = np.asarray("")
    is_real = asked.dtype.kind in "fiu"
    asked = asked.astype(np.float64) if is_real else np.asarray(np.nan)
    inside = (asked >= 0.0) & (asked <= highest * (1.0 + 1e-9)) & (asked < np.inf)
    if np.all(inside):
        return asked
    got = f"{asked[~inside][0]:g}" if is_real else f"{frequency_hz!r:.60}"
    end = f"numbers from 0 to {highest:g} Hz, half the sampling rate" if rate_hz < np.inf else "numbers of 0 Hz or more"
    raise BadInput(got, end, key="frequency_hz")


def freeze_arrays(owner: object, *fields: str) -> None:
    """Replace fields of a frozen dataclass by read-only copies of 64-bit floats; a field that is None stays."""
    for name in fields:
        values = getattr(owner, name)
        if values is not None:
            array = np.array(values, dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(owner, name, array)
