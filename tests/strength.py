"""Controllers that reshape their reference by its strength."""

from dataclasses import replace

from tactuator.model.controller import Controller, StrengthShaping
from tactuator.model.description import Strength
from tactuator.synthesis.strength import fit_strength
from tests.griffin import griffin


def blended(display):
    """The display, every channel following Griffin's contours at every level."""
    channels = (replace(channel, strength=Strength(griffin(), blended=True)) for channel in display.channels)
    return replace(display, channels=tuple(channels))


def reshaped(controller: Controller, shaping: StrengthShaping | None = None) -> Controller:
    """The controller, every channel reshaping its reference; its display asks for it."""
    display = blended(controller.display)
    pairs = zip(controller.channels, display.channels, strict=True)
    return Controller(
        display,
        tuple(
            replace(made, strength=shaping or fit_strength(channel, display.rate_hz, 1.0)) for made, channel in pairs
        ),
    )
