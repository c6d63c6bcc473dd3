"""Kinds of parameter that several tables of a protocol file share."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tactuator.parameters import Number
from tactuator.perception.curve import COMFORT_DB_SL, LOWEST_DB_SL

Level = Annotated[Number, Field(ge=LOWEST_DB_SL, le=COMFORT_DB_SL)]
"""A level in dB SL that the display may be asked for."""
Seconds = Annotated[Number, Field(ge=0.0, le=86400.0)]
Share = Annotated[Number, Field(ge=0.0, le=1.0)]
