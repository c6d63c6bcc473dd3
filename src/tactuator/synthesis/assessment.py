"""Assessment of a feedback controller on every plant of a family: margins, rejection, hum, noise.

For white sensor noise of unit rms the command's rms is the root of the mean of |C S|^2 over frequency up to half the
rate: the command noise gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel
from tactuator.signals.decibels import db
from tactuator.signals.loop import FeedbackLoop, UnstableLoop
from tactuator.signals.loop_figures import Margins, margins
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.family import Member
from tactuator.synthesis.limits import Limit, Quantity


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


@lru_cache(maxsize=64)
def command_noise_gain(loop: FeedbackLoop) -> float:
    """Return the rms of the command per rms of white sensor noise, for a stable sampled loop; once for equal loops."""
    assert isinstance(loop.open_loop, SampledSystem)
    frequency, weight = quadrature(loop.open_loop.rate_hz, panels=60, nodes=16)
    return float(np.sqrt(np.sum(weight * np.abs(loop.command_sensitivity(frequency)) ** 2)))


@dataclass(frozen=True)
class MemberAssessment:
    """One plant under the controller: its loop, margins, mean |S| over the rejection band (dB), command noise gain."""

    member: Member
    loop: FeedbackLoop
    margins: Margins
    mean_rejection_db: float
    noise_gain: float

    def level_db(self, quantity: Quantity, frequency_hz: float) -> float:
        """Return |T| or |S| at a frequency, dB."""
        response = self.loop.complementary if quantity == "|T|" else self.loop.sensitivity
        return float(db(response(frequency_hz)))

    def figure(self, limit: Limit) -> float:
        """Return the figure that a limit is about, in the limit's unit."""
        if limit.frequency_hz is not None:
            return self.level_db(limit.quantity, limit.frequency_hz)
        return {
            "phase_margin_deg": self.margins.phase_margin_deg,
            "sensitivity_peak": self.margins.sensitivity_peak,
            "resonance_peak": self.margins.complementary_peak,
            "command_noise_gain_max": self.noise_gain,
            "least_gain": self.margins.least_gain,
        }[limit.quantity]


def assess(
    feedback: SampledSystem, family: Sequence[Member], rejection_band_hz: tuple[float, float]
) -> tuple[MemberAssessment, ...]:
    """Return the figures of every member. Raises UnstableLoop, naming the plant, if a loop is unstable."""
    # 1.6 % apart from 0.4 to 10 Hz
    band = np.geomspace(*rejection_band_hz, 200)
    assessments = []
    for member in family:
        loop = FeedbackLoop(feedback, member.sampled)
        if not loop.is_stable:
            raise UnstableLoop(f"the closed loop is unstable under load {member.name!r}", "a stable loop")
        mean_db = float(np.mean(db(loop.sensitivity(band))))
        assessments.append(MemberAssessment(member, loop, margins(loop), mean_db, command_noise_gain(loop)))
    return tuple(assessments)


def all_kept(assessments: Sequence[MemberAssessment], limits: Sequence[Limit]) -> bool:
    """Return whether every member keeps every limit."""
    return all(limit.kept(assessment.figure(limit)) for assessment in assessments for limit in limits)


def loop_report(assessments: Sequence[MemberAssessment], channel: Channel) -> dict[str, Any]:
    """Return the margins, rejection and hum, each the worst over the family, as in controller.json."""
    requirements = channel.feedback
    each = [assessment.margins for assessment in assessments]
    worst = min(each, key=lambda margins: margins.phase_margin_deg)
    low, high = requirements.rejection_band_hz
    # hertz, reported of any loop as far as they lie in its band
    rejection_hz = {f for f in (1.0, 5.0, 10.0) if low <= f <= high} | set(requirements.rejection_hz)
    mains_hz = set(requirements.mains_hz) | set(channel.environment.hum_hz)

    def worst_db(quantity: Quantity, frequencies_hz: set[float]) -> dict[str, float]:
        return {f"{f:g}": max(of.level_db(quantity, f) for of in assessments) for f in sorted(frequencies_hz)}

    return {
        "margins": {
            "crossover_hz": _finite(worst.crossover_hz),
            "phase_margin_deg": _finite(worst.phase_margin_deg),
            "gain_margin_db": _finite(min(margins.gain_margin_db for margins in each)),
            "least_gain": max(margins.least_gain for margins in each),
            "sensitivity_peak": max(margins.sensitivity_peak for margins in each),
            "complementary_peak": max(margins.complementary_peak for margins in each),
            "disk_margin": min(margins.disk.alpha for margins in each),
            "delay_margin_samples": _finite(min(margins.delay_margin_samples or 0.0 for margins in each)),
            "command_noise_gain": max(assessment.noise_gain for assessment in assessments),
        },
        "rejection_db": {
            "mean": max(assessment.mean_rejection_db for assessment in assessments),
            **worst_db("|S|", rejection_hz),
        },
        "mains_db": worst_db("|T|", mains_hz),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
