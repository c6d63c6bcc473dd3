"""What the device does: responses at the paper's levels, free and touched, under other fingers; and speech as felt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import tactuator as tt
from tactuator.api.designed import ControllerResult
from tactuator.api.response import MeasuredResponses
from tactuator.api.speech import RenderResult
from tactuator.model.description import Display
from tactuator.paper.plan import LEVELS_DB_SL, RESPONSE_HZ, Plan, Progress
from tactuator.report.device_figures import LevelResponse, level_responses

UNLOADED, LOADED = "none", "finger"
CONFIDENCE_DB = {0.0: 1.0, 10.0: 0.3, 30.0: 0.1, 50.0: 0.1}
"""Half-width that averaging goes on for, by level."""
FINGERS = 7
"""Draws of other fingers, one on each channel: 21 in all."""
FINGER_FACTORS = (0.5, 1.5)
"""Of the assumed finger's mass, damping and stiffness, each drawn by itself (docs/touch.md)."""
FINGERS_AT_DB_SL = 30.0
FINGERS_HZ = (0.4, 3.0, 10.0, 20.0, 28.0, 38.0, 70.0, 140.0)
"""A finger takes most near 30 Hz."""

Responses = tuple[LevelResponse, ...]


def measure(
    plan: Plan,
    controller: ControllerResult,
    step: str,
    progress: Progress,
    *,
    device: Display | None = None,
    levels_db_sl: Sequence[float] = LEVELS_DB_SL,
    loads: Sequence[str] = (UNLOADED, LOADED),
    frequency_hz: Sequence[float] = RESPONSE_HZ,
) -> Responses:
    """Measure by stepped sine with lock-in, all channels at once, every level, every load.

    device: what is simulated (None: the plan's display). Confidence: 99 % for all points of a load and level.
    """
    found: list[LevelResponse] = []
    together = 1.0 - 0.01 / (len(frequency_hz) * len(controller.channels))
    runs = [(load, level) for load in loads for level in levels_db_sl]
    for done, (load, level) in enumerate(runs, start=1):
        rig = tt.SimulatedRig(device or plan.display, plan.seed_of(f"{step} at {level:g} dB SL, {load}"))
        measured = tt.measure_response(
            rig, controller, frequency_hz, level, load, confidence_db=CONFIDENCE_DB[level], coverage=together
        )
        assert isinstance(measured, MeasuredResponses)
        found += level_responses(measured.responses, controller)
        progress(step, done / len(runs))
    return tuple(found)


def without_friction(plan: Plan, controller: ControllerResult, progress: Progress) -> Responses:
    """Measure the response at 0 dB SL of the same device without its friction: the difference is friction."""
    channels = tuple(
        replace(channel, environment=replace(channel.environment, friction_v=0.0)) for channel in plan.display.channels
    )
    smooth = replace(plan.display, channels=channels)
    return measure(plan, controller, "friction", progress, device=smooth, levels_db_sl=(0.0,), loads=(UNLOADED,))


def other_fingers(plan: Plan, controller: ControllerResult, progress: Progress) -> Responses:
    """Measure under fingers that the controller was not designed for."""
    rng = np.random.default_rng(plan.seed_of("other fingers"))
    found: list[LevelResponse] = []
    for draw in range(FINGERS):
        channels = []
        for channel in plan.display.channels:
            load, factors = channel.loads[0], rng.uniform(*FINGER_FACTORS, 3)
            parts = dict(zip(("mass", "damping", "stiffness"), factors, strict=True))
            other = replace(load, **{name: factor * getattr(load, name) for name, factor in parts.items()})
            channels.append(replace(channel, loads=(other,)))
        device = replace(plan.display, channels=tuple(channels))
        found += measure(
            plan, controller, f"finger {draw + 1}", lambda _, done: None, device=device,
            levels_db_sl=(FINGERS_AT_DB_SL,), loads=(LOADED,), frequency_hz=FINGERS_HZ,
        )  # fmt: skip
        progress("fingers", (draw + 1) / FINGERS)
    return tuple(found)


def of(runs: Responses, load: str, level_db_sl: float, channel: str | None = None) -> Responses:
    """Return the runs under a load at a level, of one channel or (None) of all."""
    key = load, level_db_sl
    return tuple(run for run in runs if (run.load, run.level_db_sl) == key and channel in (None, run.channel))


def worst_error_db(runs: Responses, load: str, level_db_sl: float, channel: str | None = None) -> float:
    """Return the greatest |level error|, dB, of `of`, saturated points left out."""
    return max(float(np.max(np.abs(run.error_db[~run.saturated]))) for run in of(runs, load, level_db_sl, channel))


def change_by_finger_db(runs: Responses, level_db_sl: float, to_hz: float, channel: str | None = None) -> float:
    """Return the greatest change of the level by the finger up to a frequency, dB, where it was measured both ways."""
    free, touched = (
        {(run.channel, hertz): error for run in of(runs, load, level_db_sl, channel) for hertz, error in _points(run)}
        for load in (UNLOADED, LOADED)
    )
    return max(abs(touched[place] - free[place]) for place in free.keys() & touched.keys() if place[1] <= to_hz)


def _points(run: LevelResponse) -> list[tuple[float, float]]:
    return list(zip(run.frequency_hz.tolist(), run.error_db.tolist(), strict=True))


@dataclass(frozen=True)
class Spoken:
    """Speech by one coding on the simulated device."""

    coding: str
    result: RenderResult

    @property
    def report(self) -> Any:
        """Return the levels felt and asked, finger by finger."""
        return self.result.rendered.felt


def speak(plan: Plan, controller: ControllerResult, speech: Path, coding: str) -> Spoken:
    """Render a file by a coding, play it on the simulated device, and compare what the finger ports feel with it."""
    with TemporaryDirectory() as folder:
        out, felt = (Path(folder) / f"{name}.wav" for name in ("reference", "felt"))
        on_device = controller.on(plan.display)
        result = tt.render(speech, on_device, out, coding=coding, felt=felt, seed=plan.seed_of(f"speech, {coding}"))
    assert isinstance(result, RenderResult)
    return Spoken(coding, result)
