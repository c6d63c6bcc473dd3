"""Plants that no design can be made for, each refused in its own sentence."""

from __future__ import annotations

import numpy as np

from tactuator.errors import BadInput
from tactuator.model.description import KNOWN_EDGE, Channel
from tactuator.signals.systems import ContinuousSystem


def require_suitable(channel: Channel, rate_hz: float) -> None:
    """Raise BadInput if the channel's plant, or a model of its family, cannot be designed for at `rate_hz`.

    Whether a loop can be found for an unstable plant, or one with zeros right of the axis, is the synthesis's to say.
    """
    looped = channel.feedback.structure != "none"
    if not looped:
        _require_known(channel)
    for model, plant in enumerate((channel.plant, *channel.family)):
        where = f"channel {channel.name!r}: " + ("the plant" if model == 0 else f"model {model} of the family")
        _require_sound(plant, where, looped)
        _require_below_nyquist(plant, where, rate_hz)
    if channel.feedback.structure == "integrator-lead-lag" and np.any(channel.plant.zeros == 0.0):
        raise BadInput(
            f"channel {channel.name!r}: the plant gives nothing at rest (a zero at s = 0), where an integrator would "
            "run away",
            'structure = "none", or a plant of displacement',
        )


def _require_known(channel: Channel) -> None:
    """Raise BadInput where a prefilter would equalise what nobody measured: without a loop all rests on the plant."""
    low, high = channel.threshold.band_hz
    first, last = channel.valid_hz or (0.0, np.inf)
    if low < first / KNOWN_EDGE or high > last * KNOWN_EDGE:
        raise BadInput(
            f"channel {channel.name!r}: band_hz is [{low:g}, {high:g}], but the plant is known from {first:.4g} to "
            f"{last:.4g} Hz only (valid_hz); allowed without a loop: a band within that"
        )


def _require_sound(plant: ContinuousSystem, where: str, looped: bool) -> None:
    if plant.gain == 0.0:
        raise BadInput(f"{where} has zero gain", "a plant that moves")
    if not plant.is_proper:
        raise BadInput(
            f"{where} is improper ({plant.zeros.size} zeros, {plant.poles.size} poles)", "no more zeros than poles"
        )
    if not looped and not plant.is_stable:
        worst = plant.poles[np.argmax(plant.poles.real)]
        raise BadInput(
            f"{where} runs away without a loop (a pole at {worst:.4g} rad/s)",
            'every pole left of the axis, or structure = "integrator-lead-lag"',
        )
    at_low = plant.gain * float(np.real(np.prod(-plant.zeros[plant.zeros != 0.0])))
    at_low /= float(np.real(np.prod(-plant.poles[plant.poles != 0.0])))
    if looped and plant.is_stable and at_low < 0.0:
        raise BadInput(f"{where} has a negative gain at rest ({at_low:.4g})", "a positive one, with polarity = -1")


def _require_below_nyquist(plant: ContinuousSystem, where: str, rate_hz: float) -> None:
    pairs = plant.poles[plant.poles.imag > 0.0]
    fastest_hz = float(np.max(np.abs(pairs), initial=0.0)) / (2.0 * np.pi)
    if fastest_hz >= 0.5 * rate_hz:
        raise BadInput(
            f"{where} has a pole pair at {fastest_hz:.4g} Hz, above half the rate",
            f"below {0.5 * rate_hz:g} Hz, or a higher rate_hz",
        )
