"""Results as tables of text, for pages and terminals."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ResultTable:
    """A table of results. notes: lines below the table; whole: columns whose cells are never broken."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()
