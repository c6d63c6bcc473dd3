"""Results: what each answers in a line, as a table, as JSON, as HTML in a notebook and as a chart."""

import dataclasses
import html
import math
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from tactuator.errors import BadInput
from tactuator.table import Chart, ResultTable, plain

_LONGEST = 499
_Promoted = TypeVar("_Promoted", bound="Result")


class Result:
    """A result: `repr` of under 500 characters, HTML for notebooks, `plot`, `to_dict`, `to_dataframe` of a table.

    What the command line prints of it, and the status that it ends with, are told here as well. `holds` is the verdict:
    the only place from which status 1 comes. `SHOWN` has the words for each attribute that is a row of its table, with
    "::" and the form of a number. A field with repr=False is neither in JSON nor told at a glance.
    """

    SHOWN: ClassVar[Mapping[str, str]] = {}

    def headline(self) -> Mapping[str, str]:
        """Return the figures that tell the result at a glance, each with its unit: by default those of its fields."""
        values = {name: getattr(self, name) for name in self._told_fields()}
        return {name: str(value) for name, value in values.items() if isinstance(value, str | int | float | Path)}

    def _told_fields(self) -> list[str]:
        return [field.name for field in dataclasses.fields(self) if field.repr]  # type: ignore[arg-type]

    def columns(self) -> Mapping[str, Any]:
        """Return the table's columns of equal length, units in the names; raises BadInput where it is no table."""
        raise BadInput(f"{type(self).__name__} is no table", "to_dict()")

    def chart(self) -> Chart:
        """Return what `plot` draws; raises BadInput where there is nothing to report.chart.draw."""
        raise BadInput(f"{type(self).__name__} has nothing to draw", "to_dict()")

    def to_dict(self) -> dict[str, Any]:
        """Return the result in JSON's own types (infinite and undefined numbers as None): what `--json` prints."""
        return {name: finite(getattr(self, name)) for name in self._told_fields()}

    def tables(self) -> Sequence[ResultTable | str]:
        """Return the tables and lines that the command line prints, in their order."""
        if not self.SHOWN:
            return [f"{name}: {value}" for name, value in self.headline().items()]
        shown = {name: getattr(self, name) for name in self.SHOWN}
        rows = [(*self.SHOWN[name].split("::"), value) for name, value in shown.items() if value is not None]
        return [ResultTable(self.title, ("what", "value"), tuple((words, _cell(v, *how)) for words, *how, v in rows))]

    @property
    def title(self) -> str:
        """Return what stands above the table of what is shown."""
        return ""

    def notices(self) -> Sequence[str]:
        """Return lines for standard error: what is to be known of the result beside it."""
        return ()

    @property
    def holds(self) -> bool:
        """Return False where the verdict is no: the command line then ends with status 1."""
        return True

    @property
    def ending(self) -> BaseException | None:
        """Return what the command line raises once the result was told: a part of it that could not be had."""
        return None

    def to_dataframe(self) -> Any:
        """Return the table as a pandas.DataFrame; BadInput where pandas is not installed, or there is no table."""
        columns = self.columns()
        try:
            pandas = import_module("pandas")
        except ImportError:
            raise BadInput("pandas is not installed", "pip install pandas, or to_dict()") from None

        return pandas.DataFrame(dict(columns))

    def plot(self, ax: Any = None) -> Any:
        """Draw the result into `ax` (None: the current axes of matplotlib) and return the axes."""
        return import_module("tactuator.report.chart").draw(self.chart(), ax)  # matplotlib takes a second to load

    def __repr__(self) -> str:
        figures = ", ".join(f"{name}: {value}" for name, value in self.headline().items())
        whole = f"<{_name(self)} {figures}>"
        return whole if len(whole) <= _LONGEST else f"{whole[: _LONGEST - 5]} ...>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
            for name, value in self.headline().items()
        )
        return f"<table><caption>{html.escape(_name(self))}</caption>{rows}</table>"


def _name(result: Result) -> str:
    return type(result).__name__.removesuffix("Result")


def finite(value: object) -> Any:
    """Return the value in JSON's own types, None in place of numbers that JSON cannot say."""
    value = plain(value)
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def promoted(form: type[_Promoted], value: Any, **more: Any) -> _Promoted:
    """Return `value`, an instance of the dataclass that `form` extends, as an instance of `form` with `more` fields."""
    if isinstance(value, form) and not more:
        return value
    fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if field.init}
    return form(**(fields | more))


def _cell(value: object, form: str = "g") -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:{form}}" if isinstance(value, float) else str(value)


def coefficients(values: Iterable[float]) -> str:
    """Return the coefficients of a polynomial as they are told in a line."""
    return "[" + ", ".join(f"{value:.5g}" for value in values) + "]"


def figure(value: float, unit: str = "", digits: int = 4) -> str:
    """Return a number with its unit."""
    return f"{value:.{digits}g}{' ' if unit else ''}{unit}"


def columns_of(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Return the columns of a table from its rows."""
    cells = [[value.item() if hasattr(value, "item") else value for value in row] for row in rows]
    return {name: [row[k] for row in cells] for k, name in enumerate(names)}
