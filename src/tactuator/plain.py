"""Values in plain types: a dataclass as JSON, as a line, its attributes by name; a number as its error leaves it."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

_LONGEST = 180
_SCALARS = (bool, int, float, str)


def picked(noun: Any, *names: str, **others: str) -> dict[str, Any]:
    """Return attributes of an object by name; others: by another name, each with a path ("level.volts")."""
    return {key: attrgetter(path)(noun) for key, path in ({name: name for name in names} | others).items()}


def plain(value: Any) -> Any:
    """Return a value in JSON's own types: tables as mappings, arrays and tuples as lists, paths as texts, a complex
    number as [re, im]. Raises TypeError for what has no counterpart there.
    """
    if value is None or isinstance(value, _SCALARS):
        return value
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # an array or a number of NumPy
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no counterpart in JSON")


def finite(value: object) -> Any:
    """Return the value in JSON's own types, None in place of numbers that JSON cannot say."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    return value if value is None or isinstance(value, _SCALARS) else finite(plain(value))


def brief(noun: Any) -> str:
    """Return a dataclass in one line of at most 180 characters, for its `__repr__`: its kind, and its fields in their
    order as long as they fit. Of an array it says how many values there are and between what they lie.
    """
    line = f"<{type(noun).__name__}"
    for number, part in enumerate(each for each in fields(noun) if each.repr):
        word = f"{',' if number else ''} {part.name}: {_value(getattr(noun, part.name))}"
        if len(line) + len(word) > _LONGEST:
            return f"{line}{',' if number else ''} ...>"
        line += word
    return f"{line}>"


def _value(value: Any) -> str:
    if isinstance(value, bool | str) or value is None:
        return str(value)
    if isinstance(value, int | float):
        return f"{value:.6g}"
    if hasattr(value, "dtype") and hasattr(value, "shape"):
        ends = f", {value.min():.4g} to {value.max():.4g}" if value.dtype.kind in "fiu" and value.size else ""
        return f"{' x '.join(map(str, value.shape))} values{ends}"
    if isinstance(value, tuple | list):
        words = [_value(item) for item in value]
        return f"({', '.join(words)})" if sum(map(len, words)) < _LONGEST // 3 else f"{len(words)} of them"
    if isinstance(value, Mapping):
        return f"{len(value)} keys"
    if is_dataclass(value):
        return str(getattr(value, "name", type(value).__name__))
    return str(value)


def with_error(value: float, error: float) -> tuple[str, str]:
    """Return a value to the last digit that its error leaves, and the error to two digits."""
    if not (math.isfinite(value) and math.isfinite(error) and error > 0.0):
        return f"{value:.6g}", f"{error:.2g}"
    decimals = 1 - math.floor(math.log10(error))
    if not -2 <= decimals <= 6:  # very large and very small numbers keep an exponent
        digits = max(1, math.floor(math.log10(abs(value) or error)) + decimals + 1)
        return f"{value:.{digits}g}", f"{error:.2g}"
    decimals = max(decimals, 0)
    return f"{value:.{decimals}f}", f"{error:.{decimals}f}"
