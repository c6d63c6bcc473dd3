"""Rigs on sound cards by name: "sound:DEVICE[@RATE]"."""

from __future__ import annotations

from tactuator.errors import BadInput
from tactuator.model.description import Display
from tactuator.rig.sound.cards import find_card, list_cards, sound_name
from tactuator.rig.sound.port import CardPort
from tactuator.rig.sound.rig import PATIENT_S, SoundRig, sound_wiring
from tactuator.rig.sound.rows import CardRows

RING_S = 4.0 * PATIENT_S
"""Length of the rings: what is taken in may wait for the program four times as long as it is fed ahead."""


def sound_rig(spec: str, display: Display, seed: int = 0) -> SoundRig:
    """Return the rig of `display` on the card DEVICE[@RATE]; without a device, on the one that [sound] names.

    Raises BadInput for a card that is not there or has too few channels, for a rate that is not the display's, and
    where a loop is asked for; DeviceFault where the card cannot be opened.
    """
    del seed  # nothing is drawn
    card = sound_wiring(display)
    name, rate_hz = sound_name(spec)
    if rate_hz is not None and rate_hz != display.rate_hz:
        raise BadInput(f"sound card at {rate_hz:g} Hz; allowed for this display: its rate_hz, {display.rate_hz:g} Hz")
    for channel in display.channels:
        if channel.feedback.structure != "none":
            raise BadInput(
                f"channel {channel.name!r}: structure is {channel.feedback.structure!r}, and a loop through a sound "
                "card answers tens of milliseconds late",
                'structure = "none" in [feedback]',
            )
    cards = list_cards()
    out = find_card(name or card.device, cards)
    outputs = max(wires.output for wires in card.wires)
    inputs = max(wires.input for wires in card.wires)
    taken_from = find_card(card.input_device, cards) if card.input_device else out
    rows = CardRows(outputs, inputs, round(RING_S * display.rate_hz), display.rate_hz)
    port = CardPort(out, taken_from if inputs else None, outputs, inputs, display.rate_hz, rows)
    return SoundRig(display, rows, port)
