"""Types of arrays, one for each kind of number; the shapes stand in the docstrings; and fields that stay as given."""

import importlib.util
import sys

import numpy as np
from numpy.typing import NDArray


def _load_later(name: str) -> None:
    """Let a package of NumPy or SciPy load when something of it is asked for."""
    spec = importlib.util.find_spec(name)
    if spec is not None and spec.loader is not None and spec.name not in sys.modules:
        spec.loader = importlib.util.LazyLoader(spec.loader)
        module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
        package, _, last = name.rpartition(".")
        setattr(sys.modules[package], last, module)
        spec.loader.exec_module(module)


_load_later("numpy.f2py")  # SciPy touches every name of NumPy: this translator of Fortran takes as long as all others
_load_later("scipy.spatial")  # scipy.optimize imports it for one method, which nothing here uses

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
