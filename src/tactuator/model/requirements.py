"""Requirements on a display, and its wiring: the tables [feedback], [prefilter], [objectives], [touch] and [sound]."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from tactuator.errors import BadInput
from tactuator.model.plant import System
from tactuator.parameters import Band, Decibels, Flag, Hertz, Positive, PositiveDecibels, Whole, Wording, table
from tactuator.perception.curve import COMFORT_DB_SL

MOST_CHANNELS = 64
"""Most channels of a card."""
LEAD_S = (0.02, 2.0)
"""Least and greatest time by which a stream may be fed ahead, seconds."""
_IN_ORDER = Wording(default="1, 2, 3 ...")


@table("[sound]")
class Wires:
    """One channel on a sound card."""

    output: Annotated[Whole, _IN_ORDER, Field(ge=1, le=MOST_CHANNELS, description="output of the card, counted from 1")]
    input: Annotated[
        Whole,
        _IN_ORDER,
        Field(ge=0, le=MOST_CHANNELS, description="input of the card with the sensor; `0`: no sensor"),
    ]
    output_full_scale_v: Annotated[
        Positive,
        Field(description="motor volts (with the amplifier) for a sample of 1.0; from `sound calibrate`"),
    ]
    input_full_scale_v: Annotated[Positive, Field(description="volts at the input for a sample of 1.0")] = 1.0


@table("[sound]")
class SoundCard:
    """The card of a display. wires: one for each channel."""

    wires: tuple[Wires, ...]
    device: Annotated[
        str,
        Field(description="card whose volts these are, from `tactuator sound devices`; `--rig sound:` takes no other"),
    ] = ""
    input_device: Annotated[str, Field(description="card of the inputs, if different")] = ""
    latency_samples: Annotated[
        Whole,
        Field(
            ge=0,
            le=1_000_000,
            description="delay from output to input, from `tactuator sound latency`; it is removed from the inputs",
        ),
    ] = 0
    lead_s: Annotated[
        Positive,
        Field(
            ge=LEAD_S[0],
            le=LEAD_S[1],
            description="buffer of a stream; pause and stop are delayed by it",
        ),
    ] = 0.25

    def __post_init__(self) -> None:
        _each_once([wires.output for wires in self.wires], "output")
        _each_once([wires.input for wires in self.wires if wires.input], "input")


def _each_once(numbers: Sequence[int], what: str) -> None:
    for number in numbers:
        if numbers.count(number) > 1:
            raise BadInput(f"{what} {number} has two channels", f"each {what} once")


MOST_POLES = 16
"""Greatest number of a prefilter's poles."""
Structure = Literal["integrator-lead-lag", "paper", "none"]


@table("[feedback]")
class FeedbackRequirements:
    """Requirements that the loop must keep under every load; None or an empty tuple asks nothing."""

    structure: Annotated[
        Structure,
        Field(description='`"paper"`: C is given; `"none"`: no loop, the prefilter equalises the plant'),
    ] = "integrator-lead-lag"
    phase_margin_deg: Annotated[Positive | None, Field(description="at least")] = 50.0
    sensitivity_peak: Annotated[Positive | None, Field(description="max|S|, at most")] = 1.45
    mains_hz: Annotated[tuple[Hertz, ...], Field(description="where hum reaches the finger through T")] = ()
    mains_max_db: Annotated[tuple[Decibels, ...], Field(description="|T| at each of `mains_hz`, at most")] = ()
    rejection_hz: Annotated[tuple[Hertz, ...], Field(description="where disturbances must be rejected")] = ()
    rejection_max_db: Annotated[tuple[Decibels, ...], Field(description="|S| at each of `rejection_hz`, at most")] = ()
    command_noise_gain_max: Annotated[
        Positive | None, Field(description="rms of CS for white sensor noise of rms 1, at most")
    ] = 30.0
    rejection_band_hz: Annotated[
        Band,
        Field(description="where the mean of |S| in dB over log frequency is minimised, for the worst load"),
    ] = (0.4, 10.0)
    controller: Annotated[
        System | None, Wording(default="the paper's"), Field(description='C itself, for `structure = "paper"`')
    ] = None

    def __post_init__(self) -> None:
        for name in ("mains", "rejection"):
            frequencies, limits = getattr(self, f"{name}_hz"), getattr(self, f"{name}_max_db")
            if len(frequencies) != len(limits):
                raise BadInput(f"{len(frequencies)} {name}_hz and {len(limits)} {name}_max_db", "as many of each")


@table("[prefilter]")
class PrefilterRequirements:
    """Requirements on the prefilter."""

    poles: Annotated[
        Whole, Field(ge=2, le=MOST_POLES, description="number of poles; more follow the curve more closely")
    ] = 4
    falls_above_hz: Annotated[
        Hertz, Field(description="above this, the gain does not exceed the greatest in the band")
    ] = 400.0


@table("[objectives]")
class Objectives:
    """Tolerances of the paper's four objectives (its section 2)."""

    flatness_db: Annotated[PositiveDecibels, Field(description="i: deviation of |H| from the curve over the band")] = (
        1.0
    )
    from_db_sl: Annotated[Decibels, Field(description="i: lowest level with friction and converter steps")] = 10.0
    mains_max_db_sl: Annotated[Decibels, Field(description="ii: felt level of every mains line")] = 0.0
    noise_max_db_sl: Annotated[Decibels, Field(description="iii: felt noise in every third octave")] = 0.0
    resonance_peak: Annotated[Positive, Field(description="iii: max|T|")] = 1.3
    load_max_db: Annotated[PositiveDecibels, Field(description="iv: change of |H| by a load, up to `load_band_hz`")] = (
        1.0
    )
    load_band_hz: Annotated[Hertz, Field(description="iv: highest frequency for `load_max_db`")] = 10.0
    comfort_db_sl: Annotated[PositiveDecibels, Field(description="the greatest level presented")] = COMFORT_DB_SL


@table("[touch]")
class Touch:
    """What a display does about a finger on it."""

    adaptive: Annotated[
        Flag,
        Field(
            description="compensate the [finger](touch.md) by adaptive feed-forward, designed for the first of `loads`"
        ),
    ] = False
