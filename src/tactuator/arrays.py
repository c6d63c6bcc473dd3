"""Types of arrays, one for each kind of number (shapes are in the docstrings), and fields that stay as given."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def freeze_arrays(owner: object, *fields: str) -> None:
    """Replace fields of a frozen dataclass by read-only copies of 64-bit floats; a field that is None stays."""
    for name in fields:
        values = getattr(owner, name)
        if values is not None:
            array = np.array(values, dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(owner, name, array)
