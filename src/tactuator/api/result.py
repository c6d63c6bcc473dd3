"""Manners of every verb's result: it prints itself in a few lines, draws itself, becomes plain or a table; and progress
of a verb, told to whoever watches: the command line's bars, the console, or nobody (the default).
"""

import dataclasses
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

from tactuator.errors import BadInput
from tactuator.table import FREQUENCY, Chart, ChartLine, ResultTable, plain

if TYPE_CHECKING:
    from tactuator.model.plant_model import PlantModel
    from tactuator.report.chart import Axes

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
        """Return what `plot` draws; raises BadInput where there is nothing to draw."""
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
        import numpy as np

        return pandas.DataFrame({name: np.asarray(values) for name, values in columns.items()})

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the result into `ax` (None: the current axes of matplotlib) and return the axes."""
        from tactuator.report.chart import draw  # matplotlib takes a second to load

        return draw(self.chart(), ax)

    def __repr__(self) -> str:
        figures = ", ".join(f"{name}: {value}" for name, value in self.headline().items())
        whole = f"<{_name(self)} {figures}>"
        return whole if len(whole) <= _LONGEST else f"{whole[: _LONGEST - 5]} ...>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        import html

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


def response_chart(model: "PlantModel", *shown: ChartLine) -> Chart:
    """Return the chart of a model's magnitude with its 95 % band, under what was `shown` by a measurement."""
    import numpy as np

    from tactuator.signals.decibels import db

    hertz = np.geomspace(*model.band_hz, 300)
    unit = f"{model.position_unit or 'unit'}/{model.command_unit or 'unit'}"
    level, half = db(model.response(hertz)), model.band_db(hertz)
    drawn = ChartLine("model, with its 95 % band", hertz, level, half=half, colour=0)
    return Chart(FREQUENCY, f"magnitude (dB re 1 {unit})", [drawn, *shown], log_x=True)


def figure(value: float, unit: str = "", digits: int = 4) -> str:
    """Return a number with its unit."""
    return f"{value:.{digits}g}{' ' if unit else ''}{unit}"


def columns_of(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Return the columns of a table from its rows."""
    cells = [[value.item() if hasattr(value, "item") else value for value in row] for row in rows]
    return {name: [row[k] for row in cells] for k, name in enumerate(names)}


class Step(Protocol):
    """Told how far a stretch of work is."""

    def __call__(self, done: float | None = None, total: float | None = None, text: str | None = None) -> None:
        """Tell what is done of `total` (None: as before), and what is at hand."""


Watcher = Callable[[str, float | None], AbstractContextManager[Step]]
"""Given the name of a stretch of work and its length (None: nobody knows it), the context in which it is shown."""


def _nothing(done: float | None = None, total: float | None = None, text: str | None = None) -> None:
    pass


@contextmanager
def _nobody(text: str, total: float | None) -> Iterator[Step]:
    yield _nothing


_WATCHER: ContextVar[Watcher] = ContextVar("watcher", default=_nobody)


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """Let `watcher` show the progress of the verbs that are called in the context."""
    token = _WATCHER.set(watcher)
    try:
        yield
    finally:
        _WATCHER.reset(token)


def working(text: str, total: float | None = None) -> AbstractContextManager[Step]:
    """Return the context of a stretch of work; it yields the function to be told how far it is."""
    return _WATCHER.get()(text, total)


def say(text: str) -> None:
    """Tell the person at the terminal, at once, what is to be done or known while a verb is at work."""
    sys.stderr.write(f"tactuator: {text}\n")
    sys.stderr.flush()
