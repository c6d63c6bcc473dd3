"""Cells of the store's rows: what is read, and instants as they are written."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import Row

Found = Row[Any]


def stamp(when: datetime) -> str:
    """An instant as the store writes it: ISO 8601 with its zone, to the microsecond."""
    return when.isoformat(timespec="microseconds")
