"""The wiring of a display to a sound card: which output and input each channel has, and their volts at full scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from tactuator.errors import BadInput
from tactuator.parameters import Positive, Whole, Words, table

MOST_CHANNELS = 64
LEAD_S = (0.02, 2.0)
"""Least and greatest time by which a stream may be fed ahead, seconds."""
_IN_ORDER = Words(default="1, 2, 3 ...")


@table("[sound]")
class Wires:
    """One channel on a sound card."""

    output: Annotated[Whole, _IN_ORDER, Field(ge=1, le=MOST_CHANNELS, description="output of the card, counted from 1")]
    input: Annotated[
        Whole,
        _IN_ORDER,
        Field(ge=0, le=MOST_CHANNELS, description="input of the card that the sensor is on; `0`: there is no sensor"),
    ]
    output_full_scale_v: Annotated[
        Positive,
        Field(
            description="volts at the motor for a sample of 1.0, amplifier included, as `sound calibrate` measures them"
        ),
    ]
    input_full_scale_v: Annotated[Positive, Field(description="volts at the input that are read as 1.0")] = 1.0


@table("[sound]")
class SoundCard:
    """The card of a display. wires: one for each channel."""

    wires: tuple[Wires, ...]
    device: Annotated[
        str,
        Field(description="card as `tactuator sound devices` lists it, for `--rig sound:` without a name"),
    ] = ""
    input_device: Annotated[
        str, Field(description="where the inputs are, if they are another device of the system")
    ] = ""
    latency_samples: Annotated[
        Whole,
        Field(
            ge=0,
            le=1_000_000,
            description="from a sample's output to its input through a wire, as `tactuator sound latency` measures it; "
            "the inputs are put back by it",
        ),
    ] = 0
    lead_s: Annotated[
        Positive,
        Field(
            ge=LEAD_S[0],
            le=LEAD_S[1],
            description="time by which a stream is fed ahead; pause and stop come later by as much",
        ),
    ] = 0.25

    def __post_init__(self) -> None:
        _each_once([wires.output for wires in self.wires], "output")
        _each_once([wires.input for wires in self.wires if wires.input], "input")


def _each_once(numbers: Sequence[int], what: str) -> None:
    for number in numbers:
        if numbers.count(number) > 1:
            raise BadInput(f"{what} {number} has two channels", f"each {what} once")
