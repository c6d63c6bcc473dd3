"""The wiring of a display to a sound card: which output and input each channel has, and their volts at full scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.errors import BadInput

MOST_CHANNELS = 64
LEAD_S = (0.02, 2.0)
"""Least and greatest time by which a stream may be fed ahead, seconds."""


@dataclass(frozen=True)
class Wires:
    """One channel on a sound card. output, input: the card's own, counted from 1; input 0: there is no sensor.

    output_full_scale_v: volts at the motor for a sample of 1.0, amplifier included. input_full_scale_v: volts of the
    sensor for which a sample of 1.0 is read.
    """

    output: int
    input: int
    output_full_scale_v: float
    input_full_scale_v: float = 1.0

    def __post_init__(self) -> None:
        if not 1 <= self.output <= MOST_CHANNELS:
            raise BadInput(f"sound: output is {self.output}", f"1 to {MOST_CHANNELS}")
        if not 0 <= self.input <= MOST_CHANNELS:
            raise BadInput(f"sound: input is {self.input}", f"1 to {MOST_CHANNELS}, or 0 where no sensor is")
        for name in ("output_full_scale_v", "input_full_scale_v"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise BadInput(f"sound: {name} is {value:g}", "a positive number of volts")


@dataclass(frozen=True)
class SoundCard:
    """The card of a display. device, input_device: names as PortAudio lists them; "" for the one that
    --rig names, and for the same one. latency_samples: from a sample's output to its input through a wire, as
    `tactuator sound latency` measures it. lead_s: time by which a stream is fed ahead. wires: one for each channel.
    """

    wires: tuple[Wires, ...]
    device: str = ""
    input_device: str = ""
    latency_samples: int = 0
    lead_s: float = 0.25

    def __post_init__(self) -> None:
        if not 0 <= self.latency_samples <= 1_000_000:
            raise BadInput(f"sound: latency_samples is {self.latency_samples}", "0 to 1000000")
        if not LEAD_S[0] <= self.lead_s <= LEAD_S[1]:
            raise BadInput(f"sound: lead_s is {self.lead_s:g}", f"{LEAD_S[0]:g} to {LEAD_S[1]:g} s")
        _each_once([one.output for one in self.wires], "output")
        _each_once([one.input for one in self.wires if one.input], "input")


def _each_once(numbers: Sequence[int], what: str) -> None:
    for number in numbers:
        if numbers.count(number) > 1:
            raise BadInput(f"sound: {what} {number} has two channels", f"each {what} once")
