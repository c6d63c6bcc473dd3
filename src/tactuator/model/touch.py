"""The model from which a display feeds forward what a finger takes."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tactuator.parameters import NotNegative, Number, Positive, Whole, table

PREVIEW_MAX = 16
"""Samples from the command to the reading that the core's model can look ahead."""


@table("touch")
class FeedForward:
    """Model of a channel's motor and of the finger it was designed for, and how the finger's weights are learnt.

    gain, damping, stiffness: the plant gain/(s^2 + damping s + stiffness). load: mass, damping and stiffness of the
    finger, in the plant's units. delay_samples: from a command to the reading it acts on. turns: it learns in every
    turns-th sample. corner_hz: of three poles through which it looks; slow_hz: below it is not looked at. forgetting_s:
    the shortest memory. gate_v, ridge_v: rms of the pushes (volts of command) at which the memory is twice as long, and
    at which zero weighs as much as what is heard. shape: the lean towards the designed finger's proportions.
    fading_s: the weights' decay while there is nothing to learn from. slew_s: the least time for a change of one.
    weight_max: of either weight. push_max_v: the greatest command that is fed forward. hum_hz, hum_band_hz: mains lines
    that are told from the finger, and the width of what is taken for them. mass_fed: the share of what the learnt mass
    takes that is fed forward.
    """

    gain: Positive
    damping: Number
    stiffness: Number
    load: tuple[Number, Number, Number]
    delay_samples: Annotated[Whole, Field(ge=1, le=PREVIEW_MAX)]
    turns: Annotated[Whole, Field(ge=1)]
    corner_hz: Positive
    slow_hz: NotNegative
    forgetting_s: Positive
    gate_v: Positive
    ridge_v: Positive
    shape: NotNegative
    fading_s: Positive
    slew_s: Positive
    weight_max: NotNegative
    push_max_v: NotNegative
    hum_hz: tuple[Number, ...] = ()
    hum_band_hz: NotNegative = 0.4
    mass_fed: NotNegative = 1.0
