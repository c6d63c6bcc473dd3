"""Step 4: hum and resonance, as felt, under a proportional controller of rising gain and under the designed loop."""

from __future__ import annotations

from dataclasses import dataclass

from tactuator.measure.noise import FeltNoise, felt_noise, proportional_controller
from tactuator.model.controller import Controller
from tactuator.paper.plan import MAINS_HZ, PROPORTIONAL_GAINS, Plan, Progress
from tactuator.rig.simulated import SimulatedRig


@dataclass(frozen=True)
class NoiseProbe:
    """Felt noise of each channel under a resting finger, by proportional gain and under the designed controller."""

    proportional: dict[float, tuple[FeltNoise, ...]]
    designed: tuple[FeltNoise, ...]


def probe_noise(plan: Plan, controller: Controller, progress: Progress) -> NoiseProbe:
    """Hold the display at rest under every gain, then under the designed controller, and judge the command."""
    proportional = {}
    for done, gain in enumerate(PROPORTIONAL_GAINS, start=1):
        probe = proportional_controller(plan.display, gain)
        proportional[gain] = _listen(plan, probe, f"noise under gain {gain:g}")
        progress("noise", done / (len(PROPORTIONAL_GAINS) + 1))
    designed = _listen(plan, controller, "noise under the designed loop")
    progress("noise", 1.0)
    return NoiseProbe(proportional, designed)


def _listen(plan: Plan, controller: Controller, step: str) -> tuple[FeltNoise, ...]:
    rig = SimulatedRig(plan.display, plan.seed_of(step))
    rig.load(controller)
    return felt_noise(rig, plan.display, mains_hz=MAINS_HZ)
