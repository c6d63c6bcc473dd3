"""A display played free, then touched, and what touched it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tactuator.errors import BadInput
from tactuator.measure.finger.estimate import FingerEstimate, estimate_finger
from tactuator.measure.finger.impedance import finger_impedance, plan_play, play_plan
from tactuator.model.controller import Controller
from tactuator.rig.rig import Rig
from tactuator.rig.sensing import require_sensors
from tactuator.signals.loop import FeedbackLoop
from tactuator.synthesis.family import plant_family

_BAND_HZ = (2.0, 250.0)


def measure_finger(
    rig: Rig,
    controller: Controller,
    touch: Callable[[], None],
    rng: np.random.Generator,
    *,
    channels: Sequence[str] | None = None,
    level_db_sl: float = 24.0,
    seconds: float = 60.0,
) -> tuple[FingerEstimate, ...]:
    """Play multisines with nothing on the display, call `touch`, play them once more as strongly as it takes for the
    same motion, all in `seconds`; return what touches each of `channels` (default: all).

    The controller is loaded here. Raises BadInput for an unknown channel, one without a loop or without a sensor of the
    displacement, or too short a time.
    """
    names = tuple(channels or rig.channels)
    for name in names:
        if name not in rig.channels:
            raise BadInput(f"channel {name!r} is not there", f"{', '.join(rig.channels)}")
    columns = [rig.channels.index(name) for name in names]
    display = controller.display
    own = [display.channels[column] for column in columns]
    loops = [_loop(controller, column) for column in columns]
    require_sensors(rig, names)
    low = max([_BAND_HZ[0], *(one.threshold.band_hz[0] for one in own)])
    high = min([_BAND_HZ[1], 0.2 * rig.rate_hz, *(one.threshold.band_hz[1] for one in own)])
    plan = plan_play(rig.rate_hz, (low, high), level_db_sl, seconds, rng)
    rig.load(controller)
    free = play_plan(rig, plan, own)
    touch()
    tried = play_plan(rig, plan.tried, own)
    touched = play_plan(rig, plan.evened(free.position[:, 0] / tried.position[:, 0]), own)
    made = []
    for k, name in enumerate(names):
        impedance = finger_impedance(own[k], plan, free.response[k], touched.response[k])
        felt = loops[k].load_sensitivity(plan.frequency_hz) / own[k].plant.gain
        cut = free.ended[k] or tried.ended[k] or touched.ended[k]
        made.append(estimate_finger(name, plan.frequency_hz, impedance, felt, cut))
    return tuple(made)


def _loop(controller: Controller, column: int) -> FeedbackLoop:
    """Return the unloaded loop of a channel. Raises BadInput where there is none."""
    own, display = controller.channels[column], controller.display
    feedback = own.feedback(controller.rate_hz)
    if feedback is None:
        raise BadInput(f"channel {own.name!r} has no loop, so that its command does not tell", "one with a loop")
    channel = display.channels[column]
    return FeedbackLoop(feedback, plant_family(channel, display.rate_hz, display.delay_samples)[0].sampled)
