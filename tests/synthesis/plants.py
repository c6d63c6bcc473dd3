"""Plants that people own, and limits for them, drawn from a seed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tactuator.model.requirements import FeedbackRequirements
from tactuator.signals.systems import ContinuousSystem

KINDS = ("resonator", "integrator with a mode", "mode and antiresonance", "motor with dead time")


def resonator(frequency_hz: float, quality: float) -> ContinuousSystem:
    """w0^2 / (s^2 + w0/Q s + w0^2)."""
    own = 2.0 * np.pi * frequency_hz
    return ContinuousSystem.from_polynomials([own**2], [1.0, own / quality, own**2])


def integrator_with_mode(frequency_hz: float, quality: float, drag: float = 50.0) -> ContinuousSystem:
    """A motor without a spring, a pole exactly at 0, and a flexible mode."""
    own = 2.0 * np.pi * frequency_hz
    poles = [0.0, -drag, *np.roots([1.0, own / quality, own**2])]
    return ContinuousSystem([], poles, 2000.0 * own**2)


def mode_and_antiresonance(mode_hz: float, anti_hz: float, quality: float) -> ContinuousSystem:
    """The paper's motor with a mode and an antiresonance next to it."""
    mode, anti = 2.0 * np.pi * mode_hz, 2.0 * np.pi * anti_hz
    zeros = np.roots([1.0, anti / quality, anti**2])
    poles = np.append(np.roots([1.0, 94.0, 290.0]), np.roots([1.0, mode / quality, mode**2]))
    return ContinuousSystem(zeros, poles, 2875.0 * (mode / anti) ** 2)


def motor_with_dead_time(delay_s: float) -> ContinuousSystem:
    return ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0], delay_s)


def drawn(rng: np.random.Generator, kind: str) -> ContinuousSystem:
    if kind == "resonator":
        return resonator(float(rng.uniform(60.0, 600.0)), float(rng.uniform(4.0, 40.0)))
    if kind == "integrator with a mode":
        return integrator_with_mode(
            float(rng.uniform(60.0, 300.0)), float(rng.uniform(5.0, 30.0)), float(rng.uniform(10.0, 200.0))
        )
    if kind == "mode and antiresonance":
        mode = float(rng.uniform(60.0, 300.0))
        return mode_and_antiresonance(mode, mode * float(rng.uniform(0.7, 1.3)), float(rng.uniform(5.0, 40.0)))
    return motor_with_dead_time(round(float(rng.uniform(0.5e-3, 4e-3)) * 8000.0) / 8000.0)


def drawn_limits(rng: np.random.Generator) -> FeedbackRequirements:
    return FeedbackRequirements(
        phase_margin_deg=float(rng.uniform(35.0, 65.0)),
        sensitivity_peak=float(rng.uniform(1.2, 1.8)),
        mains_hz=(60.0, 120.0, 180.0),
        mains_max_db=tuple((np.array([-11.0, -22.0, -29.0]) + rng.uniform(-6.0, 4.0, 3)).tolist()),
        rejection_hz=(1.0, 5.0, 10.0),
        rejection_max_db=tuple((np.array([-22.0, -9.0, -4.0]) + rng.uniform(-5.0, 4.0, 3)).tolist()),
        command_noise_gain_max=float(10.0 ** rng.uniform(0.5, 2.0)),
    )


def loosened(rng: np.random.Generator, asked: FeedbackRequirements) -> FeedbackRequirements:
    """Return the limits with about half of them looser by a random amount."""

    def more(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(v + float(rng.exponential(2.0)) * (rng.random() < 0.5) for v in values)

    changes: dict[str, Any] = {
        "mains_max_db": more(asked.mains_max_db),
        "rejection_max_db": more(asked.rejection_max_db),
    }
    if rng.random() < 0.5:
        changes["phase_margin_deg"] = asked.phase_margin_deg * float(rng.uniform(0.6, 1.0))
    if rng.random() < 0.5:
        changes["sensitivity_peak"] = asked.sensitivity_peak * float(np.exp(rng.exponential(0.3)))
    if rng.random() < 0.5:
        changes["command_noise_gain_max"] = asked.command_noise_gain_max * float(np.exp(rng.exponential(0.5)))
    return replace(asked, **changes)
