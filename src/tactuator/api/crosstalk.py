"""The result of `measure crosstalk`."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from tactuator.measure.crosstalk import Crosstalk, FeltLevel
from tactuator.result import FREQUENCY, Chart, ChartLine, Column, Fact, Result, ResultTable, columns_of, found


@dataclass(frozen=True, eq=False, repr=False)
class CrosstalkResult(Result):
    """What is felt on the other fingers while one channel is driven, a row for each channel driven and frequency.

    level_db_sl: at which it was driven.
    """

    level_db_sl: float
    rows: tuple[Crosstalk, ...]

    @property
    def holds(self) -> bool:
        """Return whether every level is surely below threshold."""
        return all(level.at_most_db_sl <= 0.0 for row in self.rows for level in row.others.values())

    def _of(self, driven: str) -> list[Crosstalk]:
        return [row for row in self.rows if row.driven == driven]

    def facts(self) -> Sequence[Fact]:
        facts = [Fact("level_db_sl", self.level_db_sl, "driven at", "dB SL", "g", True), Fact("rows", self.rows)]
        for driven in dict.fromkeys(row.driven for row in self.rows):
            cells = [(row, *cell) for row in self._of(driven) for cell in row.others.items()]
            row, name, level = max(cells, key=lambda cell: cell[2].at_most_db_sl)
            words = f"{level.words} dB SL on {name}, {row.frequency_hz:.4g} Hz"
            facts.append(found(f"{driven} driven, most felt", words))
        return facts

    def notices(self) -> Sequence[str]:
        cut = sorted({row.frequency_hz for row in self.rows if row.saturated})
        hidden = any((level.below_db_sl or 0.0) > 0.0 for row in self.rows for level in row.others.values())
        return [
            *(["noise hides levels above threshold: a longer `longest_s`"] if hidden else []),
            *([f"a limit was reached at {', '.join(f'{hz:.4g}' for hz in cut)} Hz: a lower level"] if cut else []),
        ]

    def table(self) -> Sequence[Column]:
        cells = [
            (row.driven, row.frequency_hz, name, *_numbers(level))
            for row in self.rows
            for name, level in row.others.items()
        ]
        return columns_of(("driven", "frequency_hz", "channel", "level_db_sl", "confidence_db", "below_db_sl"), cells)

    def chart(self) -> Chart:
        curves = []
        for number, (driven, name) in enumerate(
            dict.fromkeys((row.driven, name) for row in self.rows for name in row.others)
        ):
            rows = self._of(driven)
            hertz = np.array([row.frequency_hz for row in rows])
            level, half, below = np.array([_numbers(row.levels[name]) for row in rows]).T
            words = f"{name}, {driven} driven"
            curves += [
                ChartLine(words, hertz, level, "o", half, colour=number),
                ChartLine("", hertz, below, "v", colour=number),
            ]
        return Chart(FREQUENCY, "felt level (dB SL; triangle: below it)", curves, True, limits={"threshold": 0.0})

    def tables(self) -> Sequence[ResultTable | str]:
        names = tuple(dict.fromkeys(name for row in self.rows for name in row.levels))
        rows = tuple(
            (row.driven, f"{row.frequency_hz:.4g}", *(row.levels[name].words for name in names)) for row in self.rows
        )
        note = (
            f"felt levels, dB SL ± 95 %, while one channel is driven at {self.level_db_sl:g} dB SL; below: what noise "
            "hides lies below this"
        )
        return [ResultTable("", ("driven", "Hz", *names), rows, (note,))]


def _numbers(level: FeltLevel) -> tuple[float, ...]:
    """Return level, confidence, and what it is below; NaN for what is not known."""
    return tuple(np.nan if number is None else number for number in astuple(level))
