"""What results are told as: a line that says what they are, tables of text, charts for whoever draws them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

_LONGEST = 180
FREQUENCY = "frequency (Hz)"
NOBODY_FELT_IT = "simulated: nobody felt this"
"""What a table or figure of simulated subjects says in itself."""


def picked(noun: Any, *names: str, **others: str) -> dict[str, Any]:
    """Return attributes of an object by name; others: by another name, each with a path ("level.volts")."""
    return {key: attrgetter(path)(noun) for key, path in ({name: name for name in names} | others).items()}


def plain(value: Any) -> Any:
    """Return a value in JSON's own types: tables as mappings, arrays and tuples as lists, paths as texts, a complex
    number as [re, im]. Raises TypeError for what has no counterpart there.
    """
    if value is None or isinstance(value, bool | int | float | str):
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


@dataclass(frozen=True)
class ResultTable:
    """A table of results. notes: lines below the table; whole: columns whose cells are never broken."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ChartLine:
    """A curve of a chart.

    label: in the legend ("": none). x, y: (n,). half: of the 95 % confidence of y, (n,), or (2, n) below and above; a
    band about a line, bars at marks. style: as matplotlib writes it ("-", "--", "o", "o-"). crossed: points that do not
    count, (n,). colour: its place in the palette, a colour of its own, or None for the next. right: has the axis at the
    right. width: of the line, points.
    """

    label: str
    x: Any
    y: Any
    style: str = "-"
    half: Any = None
    crossed: Any = None
    colour: Any = None
    right: bool = False
    width: float = 1.4


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves on one pair of axes, with what they are held against.

    x_label, y_label, right_label: with units. targets: levels that were asked for. tolerance, jnd: half-widths about
    each target, of what is allowed and of what is not felt. limits: other levels, by name; upright: the same on the
    axis of x; stretches: parts of that axis, by name. log_x: x is a frequency in hertz. log_y: y is a magnitude, above
    0. y_range: ends of the axis, None where the curves decide; y_step: between its marks, 0 for any. title: above a
    panel. simulated: nobody felt what it shows.
    """

    x_label: str
    y_label: str
    curves: Sequence[ChartLine]
    log_x: bool = False
    targets: Sequence[float] = ()
    tolerance: float | None = None
    jnd: float | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    upright: Mapping[str, float] = field(default_factory=dict)
    right_label: str = ""
    simulated: bool = False
    log_y: bool = False
    stretches: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    y_range: tuple[float | None, float | None] = (None, None)
    y_step: float = 0.0
    title: str = ""
