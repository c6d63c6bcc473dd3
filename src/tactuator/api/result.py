"""Manners of every result of the flat API: it prints itself in a few lines, draws itself, becomes plain or a table."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import fields
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from tactuator.api.plain import plain
from tactuator.errors import BadInput

if TYPE_CHECKING:
    from tactuator.report.lines import Axes, Lines

_LONGEST = 499
_Promoted = TypeVar("_Promoted", bound="Result")


class Result:
    """A result: `repr` of under 500 characters, HTML for notebooks, `plot`, `to_dict`, `to_dataframe` of a table."""

    def headline(self) -> Mapping[str, str]:
        """Return the figures that tell the result at a glance, each with its unit."""
        raise NotImplementedError

    def lines(self) -> Lines:
        """Return what `plot` draws; raises BadInput where there is nothing to draw."""
        raise BadInput(f"{type(self).__name__} has nothing to draw", "to_dict()")

    def columns(self) -> Mapping[str, Any]:
        """Return the table's columns of equal length, units in the names; raises BadInput where it is no table."""
        raise BadInput(f"{type(self).__name__} is no table", "to_dict()")

    def to_dict(self) -> dict[str, Any]:
        """Return the result in JSON's own types (infinite and undefined numbers as None)."""
        made = plain(self)
        assert isinstance(made, dict)
        return made

    def to_dataframe(self) -> Any:
        """Return the table as a pandas.DataFrame; BadInput where pandas is not installed, or there is no table."""
        columns = self.columns()
        try:
            pandas = import_module("pandas")
        except ImportError:
            raise BadInput("pandas is not installed", "pip install pandas, or to_dict()") from None
        return pandas.DataFrame({name: np.asarray(values) for name, values in columns.items()})

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the result into `ax` (None: the current axes of matplotlib) and return the axes."""
        from tactuator.report.lines import draw  # noqa: PLC0415 (matplotlib takes a second to load)

        return draw(self.lines(), ax)

    def __repr__(self) -> str:
        told = ", ".join(f"{name}: {value}" for name, value in self.headline().items())
        whole = f"<{_name(self)} {told}>"
        return whole if len(whole) <= _LONGEST else f"{whole[: _LONGEST - 5]} ...>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return the headline as a table for notebooks."""
        rows = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
            for name, value in self.headline().items()
        )
        return f"<table><caption>{html.escape(_name(self))}</caption>{rows}</table>"


def _name(result: Result) -> str:
    return type(result).__name__.removesuffix("Result")


def promoted(form: type[_Promoted], value: Any) -> _Promoted:
    """Return `value`, an instance of the dataclass that `form` extends, as an instance of `form`."""
    if isinstance(value, form):
        return value
    return form(**{one.name: getattr(value, one.name) for one in fields(value) if one.init})


def lines_of(*parts: Any, **how: Any) -> Lines:
    """Return lines to draw; their room is imported when something is drawn."""
    from tactuator.report.lines import Lines  # noqa: PLC0415 (matplotlib takes a second to load)

    return Lines(*parts, **how)


def told(value: float, unit: str = "", digits: int = 4) -> str:
    """Return a number with its unit."""
    return f"{value:.{digits}g}{' ' if unit else ''}{unit}"
