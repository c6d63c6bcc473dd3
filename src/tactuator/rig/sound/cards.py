"""Sound cards by name, and what they can do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactuator.errors import BadInput
from tactuator.rig.sound.library import PORTAUDIO, quiet, sounddevice


@dataclass(frozen=True)
class Card:
    """A device as PortAudio lists it. host: the interface of the system that it is reached by (ALSA, JACK, WASAPI)."""

    index: int
    name: str
    host: str
    outputs: int
    inputs: int
    rate_hz: float

    @property
    def full_name(self) -> str:
        """Return the name by which no other device is meant: "JACK Audio Connection Kit/system"."""
        return f"{self.host}/{self.name}"


def list_cards() -> tuple[Card, ...]:
    """Return every device, in PortAudio's order. Raises BadInput without PortAudio, and DeviceFault where it does
    not answer.
    """
    library = sounddevice()
    with quiet():
        found, devices = PORTAUDIO.answer(
            lambda: (library.query_hostapis(), list(library.query_devices())), "listing sound cards"
        )
    hosts = [str(host["name"]) for host in found]
    return tuple(
        Card(
            index,
            str(one["name"]),
            hosts[one["hostapi"]],
            int(one["max_output_channels"]),
            int(one["max_input_channels"]),
            float(one["default_samplerate"]),
        )
        for index, one in enumerate(devices)
    )


def find_card(name: str, cards: Sequence[Card]) -> Card:
    """Return the card of that name, "host/name" or part of a name that only one has. Raises BadInput for none or
    several.
    """
    if not cards:
        raise BadInput("there is no sound card", "one that the system lists")
    for matches in (
        [one for one in cards if name in (one.name, one.full_name)],
        [one for one in cards if name.lower() in one.full_name.lower()],
    ):
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise BadInput(f"sound card {name!r} may be {_listed(matches)}", "one of these names in full")
    raise BadInput(f"there is no sound card {name!r}", f"{_listed(cards)}")


def _listed(cards: Sequence[Card]) -> str:
    return ", ".join(repr(one.full_name) for one in cards)


def sound_name(spec: str) -> tuple[str, float | None]:
    """Return device and rate (hertz, None: not said) of DEVICE[@RATE]. Raises BadInput for a rate that is none."""
    name, at, rate = spec.rpartition("@")
    if not at:
        return spec, None
    try:
        rate_hz = float(rate)
    except ValueError:
        return spec, None  # a device may have an @ in its name
    if not 0.0 < rate_hz < 1e6:
        raise BadInput(f"sound card {spec!r}: a rate of {rate_hz:g} Hz", "a positive number of hertz")
    return name, rate_hz
