"""Assessment of a feedback controller on every plant of a family: margins, rejection, hum, noise.

For white sensor noise of unit rms the command's rms is the root of the mean of |C S|^2 over frequency up to half the
rate: the command noise gain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel
from tactuator.model.requirements import FeedbackRequirements
from tactuator.signals.decibels import db
from tactuator.signals.loop import FeedbackLoop, Margins, UnstableLoop, margins
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.family import Member


@cache
def quadrature(rate_hz: float, panels: int = 14, nodes: int = 12) -> tuple[FloatArray, FloatArray]:
    """Return the frequencies and weights, shape (panels * nodes,), of a mean over 0..rate/2: Gauss-Legendre on panels
    of equal width in log frequency over six decades (what lies below is negligible for a bounded response).
    """
    points, weights = np.polynomial.legendre.leggauss(nodes)
    edges = np.geomspace(0.5e-6 * rate_hz, 0.5 * rate_hz, panels + 1)
    logs = np.log(edges)
    half = 0.5 * np.diff(logs)[:, None]
    frequency = np.exp(logs[:-1, None] + half * (1.0 + points))
    share = half * weights * frequency / (0.5 * rate_hz)
    return frequency.ravel(), share.ravel()


def command_noise_gain(loop: FeedbackLoop) -> float:
    """Return the rms of the command per rms of white sensor noise, for a stable sampled loop."""
    assert isinstance(loop.open_loop, SampledSystem)
    frequency, weight = quadrature(loop.open_loop.rate_hz, panels=60, nodes=16)
    return float(np.sqrt(np.sum(weight * np.abs(loop.command_sensitivity(frequency)) ** 2)))


CUSTOMARY_REJECTION_HZ = (1.0, 5.0, 10.0)


@dataclass(frozen=True)
class MemberAssessment:
    """One plant under the controller: its loop, margins, mean |S| over the rejection band (dB), command noise gain."""

    member: Member
    loop: FeedbackLoop
    margins: Margins
    mean_rejection_db: float
    noise_gain: float


@dataclass(frozen=True)
class Shortfall:
    """A requirement that is not kept: which, on which plant, what was asked and what was got (its own units)."""

    requirement: str
    member: str
    asked: float
    got: float

    def __str__(self) -> str:
        return f"{self.requirement} {self.got:.4g} (asked {self.asked:.4g}, load {self.member})"


def rejection_grid_hz(requirements: FeedbackRequirements, points: int = 200) -> FloatArray:
    """Return the frequencies of the rejection band, even in log frequency."""
    low, high = requirements.rejection_band_hz
    return np.geomspace(low, high, points)


def assess(
    feedback: SampledSystem, family: Sequence[Member], requirements: FeedbackRequirements
) -> tuple[MemberAssessment, ...]:
    """Return the figures of every member. Raises UnstableLoop, naming the plant, if a loop is unstable."""
    band = rejection_grid_hz(requirements)
    found = []
    for member in family:
        loop = FeedbackLoop(feedback, member.sampled)
        if not loop.is_stable:
            raise UnstableLoop(f"the closed loop is unstable under load {member.name!r}", "a stable loop")
        mean = float(np.mean(db(loop.sensitivity(band))))
        found.append(MemberAssessment(member, loop, margins(loop), mean, command_noise_gain(loop)))
    return tuple(found)


def shortfalls(
    assessments: Sequence[MemberAssessment], requirements: FeedbackRequirements, resonance_peak: float | None = None
) -> tuple[Shortfall, ...]:
    """Return every requirement that a member does not keep; resonance_peak is the display's limit on max|T|, if any."""
    return tuple(
        Shortfall(name, one.member.name, asked, got)
        for one in assessments
        for name, asked, got, sign in figures(one, requirements, resonance_peak)
        if sign * (got - asked) > 0.0
    )


def figures(
    one: MemberAssessment, requirements: FeedbackRequirements, resonance_peak: float | None = None
) -> list[tuple[str, float, float, float]]:
    """Return (requirement, asked, got, +1 where less is better and -1 where more is), for one plant."""
    rows: list[tuple[str, float, float, float]] = []
    if requirements.phase_margin_deg is not None:
        rows.append(("phase_margin_deg", requirements.phase_margin_deg, one.margins.phase_margin_deg, -1.0))
    if requirements.sensitivity_peak is not None:
        rows.append(("sensitivity_peak", requirements.sensitivity_peak, one.margins.sensitivity_peak, 1.0))
    if requirements.command_noise_gain_max is not None:
        rows.append(("command_noise_gain_max", requirements.command_noise_gain_max, one.noise_gain, 1.0))
    for frequency, limit in zip(requirements.mains_hz, requirements.mains_max_db, strict=True):
        level = float(db(one.loop.complementary(frequency)))
        rows.append((f"|T| dB at {frequency:g} Hz", limit, level, 1.0))
    for frequency, limit in zip(requirements.rejection_hz, requirements.rejection_max_db, strict=True):
        level = float(db(one.loop.sensitivity(frequency)))
        rows.append((f"|S| dB at {frequency:g} Hz", limit, level, 1.0))
    if resonance_peak is not None:
        rows.append(("resonance_peak", resonance_peak, one.margins.complementary_peak, 1.0))
    return rows


def loop_report(assessments: Sequence[MemberAssessment], channel: Channel) -> dict[str, Any]:
    """Return the margins, rejection and hum, each the worst over the family, as they stand in controller.json."""
    requirements = channel.feedback
    worst = min(assessments, key=lambda one: one.margins.phase_margin_deg)
    gain_margins = [one.margins.gain_margin_db for one in assessments]
    delays = [one.margins.delay_margin_samples or 0.0 for one in assessments]
    low, high = requirements.rejection_band_hz
    rejection_hz = {f for f in CUSTOMARY_REJECTION_HZ if low <= f <= high} | set(requirements.rejection_hz)
    mains_hz = sorted(set(requirements.mains_hz) | set(channel.environment.hum_hz))
    return {
        "margins": {
            "crossover_hz": _finite(worst.margins.crossover_hz),
            "phase_margin_deg": _finite(worst.margins.phase_margin_deg),
            "gain_margin_db": _finite(min(gain_margins)),
            "sensitivity_peak": max(one.margins.sensitivity_peak for one in assessments),
            "complementary_peak": max(one.margins.complementary_peak for one in assessments),
            "disk_margin": min(one.margins.disk.alpha for one in assessments),
            "delay_margin_samples": _finite(min(delays)),
            "command_noise_gain": max(one.noise_gain for one in assessments),
        },
        "rejection_db": {
            "mean": max(one.mean_rejection_db for one in assessments),
            **_worst_levels(assessments, sorted(rejection_hz), lambda loop, f: loop.sensitivity(f)),
        },
        "mains_db": _worst_levels(assessments, mains_hz, lambda loop, f: loop.complementary(f)),
    }


def _worst_levels(
    assessments: Sequence[MemberAssessment],
    frequencies_hz: Sequence[float],
    response: Callable[[FeedbackLoop, float], NDArray[np.complex128]],
) -> dict[str, float]:
    return {f"{f:g}": max(float(db(response(one.loop, f))) for one in assessments) for f in frequencies_hz}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
