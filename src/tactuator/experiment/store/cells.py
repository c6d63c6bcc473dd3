"""Cells of the store's rows, and instants as the store writes them."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import Row

Found = Row[Any]


def stamp(when: datetime) -> str:
    """Return an instant as the store writes it: ISO 8601 with its zone, to the microsecond."""
    return when.isoformat(timespec="microseconds")
