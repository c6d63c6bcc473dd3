"""Controllers that reshape their reference by its strength."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from tactuator.model.controller import Controller, StrengthShaping
from tactuator.model.description import Display, Strength
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.tables import controller_table
from tactuator.synthesis.strength import fit_strength
from tests.griffin import griffin
from tests.runtime.paper_display import controller, display


def core(shaping: StrengthShaping, rate_hz: float) -> tuple[Callable[[float], float], Any]:
    """The core's step of one sample with that shaping, from rest, and its state."""
    channel = replace(controller(display()).channels[0], strength=shaping)
    (_, table), state = controller_table(channel, rate_hz, 0), ffi.new("tact_strength_state *")
    lib.tact_strength_reset(state)
    return lambda r: lib.tact_strength_step(table, state, float(r)), state


def blended(of: Display) -> Display:
    """The display, every channel following Griffin's contours at every level."""
    channels = (replace(channel, strength=Strength(griffin(), blended=True)) for channel in of.channels)
    return replace(of, channels=tuple(channels))


def reshaped(of: Controller, shaping: StrengthShaping | None = None) -> Controller:
    """The controller, every channel reshaping its reference; its display asks for it."""
    asked = blended(of.display)
    pairs = zip(of.channels, asked.channels, strict=True)
    channels = (replace(made, strength=shaping or fit_strength(channel, asked.rate_hz, 1.0)) for made, channel in pairs)
    return Controller(asked, tuple(channels))
