"""Requirements on a synthesised loop as smooth functions of its parameters with exact derivatives.

Every requirement becomes an excess in dB (phase: degrees / 5) that must not be positive. On a fixed grid, for every
plant of the family at once: d log|S| = -Re(T dlogC), d log|T| = Re(S dlogC), d|CS|^2 = 2 |CS|^2 Re(S dlogC).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.display.requirements import FeedbackRequirements
from tactuator.signals.sections import backward_difference
from tactuator.synthesis.family import Member
from tactuator.synthesis.loop.candidates import LIGHT_DAMPING
from tactuator.synthesis.loop.structure import COUNT, LoopStructure
from tactuator.synthesis.noise_gain import quadrature

DB = 20.0 / np.log(10.0)
_SHARPNESS = 300.0
DEGREES_PER_DB = 5.0


@dataclass(frozen=True)
class Point:
    """The problem at one parameter vector: mean |S| in dB of every member, shape (m,), with slopes (m, COUNT); every
    excess, shape (c,), with slopes (c, COUNT)."""

    mean_db: FloatArray
    mean_slope: FloatArray
    excess: FloatArray
    excess_slope: FloatArray


class LoopProblem:
    """The requirements on a family of plants, evaluated on fixed grids.

    labels: one for each excess, (requirement, member), in order. tighten: shape (c,), added to every excess: what the
    grids overlook, told by a full assessment.
    """

    def __init__(
        self, family: Sequence[Member], requirements: FeedbackRequirements, rate_hz: float, resonance_peak: float
    ) -> None:
        self.requirements = requirements
        self.resonance_peak = resonance_peak
        self.structure = LoopStructure(rate_hz)
        low, high = requirements.rejection_band_hz
        nodes, weights = np.polynomial.legendre.leggauss(16)
        band = np.exp(0.5 * (np.log(low * high) + np.log(high / low) * nodes))
        peaks = _peak_grid_hz(family, low, rate_hz)
        noise, self._noise_weight = quadrature(rate_hz, panels=9, nodes=9)
        parts = [band, peaks, np.array(requirements.mains_hz), np.array(requirements.rejection_hz), noise]
        edges = np.cumsum([0, *(part.size for part in parts)])
        self._band, self._peaks, self._mains, self._rejection, self._noise = (
            slice(a, b) for a, b in pairwise(edges.tolist())
        )
        self._band_weight = 0.5 * weights
        grid = np.concatenate(parts)
        self.grid_hz = grid
        z = np.exp(2j * np.pi * grid / rate_hz)
        self._difference = backward_difference(grid, rate_hz) * z
        self._plants = np.array([member.sampled.response(grid) for member in family])
        self.labels = self._labels(family)
        self.tighten = np.zeros(len(self.labels))

    def _labels(self, family: Sequence[Member]) -> list[tuple[str, str]]:
        asked = self.requirements
        names = [f"|T| dB at {f:g} Hz" for f in asked.mains_hz] + [f"|S| dB at {f:g} Hz" for f in asked.rejection_hz]
        for name, value in (
            ("sensitivity_peak", asked.sensitivity_peak),
            ("phase_margin_deg", asked.phase_margin_deg),
            ("command_noise_gain", asked.command_noise_gain_max),
        ):
            if value is not None:
                names.append(name)
        names.append("complementary_peak")
        return [(name, member.name) for member in family for name in names]

    def asked(self, name: str) -> float:
        """Return the limit of the requirement of that label."""
        asked = self.requirements
        limits: dict[str, float | None] = {
            "sensitivity_peak": asked.sensitivity_peak,
            "phase_margin_deg": asked.phase_margin_deg,
            "command_noise_gain": asked.command_noise_gain_max,
            "complementary_peak": self.resonance_peak,
        }
        limits |= {f"|T| dB at {f:g} Hz": v for f, v in zip(asked.mains_hz, asked.mains_max_db, strict=True)}
        limits |= {f"|S| dB at {f:g} Hz": v for f, v in zip(asked.rejection_hz, asked.rejection_max_db, strict=True)}
        value = limits[name]
        assert value is not None
        return value

    def at(self, parameters: FloatArray) -> Point:
        """Return the values and derivatives of everything at one parameter vector."""
        log_controller, slope = self.structure.log_response(parameters, self._difference)
        controller = np.exp(log_controller)
        means, mean_slopes, excesses, excess_slopes = [], [], [], []
        for plant in self._plants:
            loop = controller * plant
            sensitivity = 1.0 / (1.0 + loop)
            log_s, log_t = np.log(np.abs(sensitivity)), np.log(np.abs(loop * sensitivity))
            by_s = -np.real(loop * sensitivity * slope)
            by_t = np.real(sensitivity * slope)
            means.append(DB * float(log_s[self._band] @ self._band_weight))
            mean_slopes.append(DB * (by_s[:, self._band] @ self._band_weight))
            for excess, excess_slope in self._excesses(loop, controller * sensitivity, log_s, log_t, by_s, by_t, slope):
                excesses.append(excess)
                excess_slopes.append(excess_slope)
        total = np.array(excesses) + self.tighten
        return Point(np.array(means), np.array(mean_slopes), total, np.array(excess_slopes).reshape(-1, COUNT))

    def _excesses(
        self,
        loop: NDArray[np.complex128],
        command: NDArray[np.complex128],
        log_s: FloatArray,
        log_t: FloatArray,
        by_s: FloatArray,
        by_t: FloatArray,
        slope: NDArray[np.complex128],
    ) -> list[tuple[float, FloatArray]]:
        asked = self.requirements
        rows: list[tuple[float, FloatArray]] = []
        for place, logs, slopes, limits in (
            (self._mains, log_t, by_t, asked.mains_max_db),
            (self._rejection, log_s, by_s, asked.rejection_max_db),
        ):
            for index, limit in zip(range(place.start, place.stop), limits, strict=True):
                rows.append((DB * float(logs[index]) - limit, DB * slopes[:, index]))
        if asked.sensitivity_peak is not None:
            peak, share = _smooth_maximum(log_s[self._peaks])
            rows.append((DB * (peak - np.log(asked.sensitivity_peak)), DB * (by_s[:, self._peaks] @ share)))
        if asked.phase_margin_deg is not None:
            margin, by_margin = _phase_margin_deg(loop[self._peaks], slope[:, self._peaks])
            rows.append(((asked.phase_margin_deg - margin) / DEGREES_PER_DB, -by_margin / DEGREES_PER_DB))
        if asked.command_noise_gain_max is not None:
            power = self._noise_weight * np.abs(command[self._noise]) ** 2
            total = float(np.sum(power))
            by_power = 2.0 * (by_t[:, self._noise] @ power) / total
            rows.append((0.5 * DB * np.log(total) - DB * np.log(asked.command_noise_gain_max), 0.5 * DB * by_power))
        peak, share = _smooth_maximum(log_t[self._peaks])
        rows.append((DB * (peak - np.log(self.resonance_peak)), DB * (by_t[:, self._peaks] @ share)))
        return rows


def _peak_grid_hz(family: Sequence[Member], low_hz: float, rate_hz: float) -> FloatArray:
    """Return frequencies even in log frequency up to half the rate, and dense around every member's lightly damped
    roots.
    """
    parts = [np.geomspace(low_hz, 0.49 * rate_hz, 170)]
    for member in family:
        for root in np.append(member.continuous.poles, member.continuous.zeros):
            if root.imag > 0.0 and abs(root.real) < LIGHT_DAMPING * abs(root):
                parts.append((root.imag + abs(root.real) * np.linspace(-3.0, 3.0, 13)) / (2.0 * np.pi))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid >= low_hz) & (grid <= 0.49 * rate_hz)]


def _smooth_maximum(values: FloatArray) -> tuple[float, FloatArray]:
    """Return the log-sum-exp, slightly above the maximum, and the share that each value has in it."""
    top = float(np.max(values))
    weights = np.exp(_SHARPNESS * (values - top))
    total = float(np.sum(weights))
    return top + np.log(total) / _SHARPNESS, weights / total


def _phase_margin_deg(loop: NDArray[np.complex128], slope: NDArray[np.complex128]) -> tuple[float, FloatArray]:
    """Return the least phase margin on the grid, log|L| and phase linear between its points, and its derivatives."""
    level = np.log(np.abs(loop))
    phase = np.degrees(np.angle(-loop))  # zero at -180 degrees
    crossings = np.flatnonzero(np.signbit(level[1:]) != np.signbit(level[:-1]))
    if crossings.size == 0:
        return 180.0, np.zeros(COUNT)
    i = crossings
    rise = level[i + 1] - level[i]
    share = -level[i] / rise
    turn = (phase[i + 1] - phase[i] + 180.0) % 360.0 - 180.0
    margins = phase[i] + turn * share
    worst = int(np.argmin(np.abs(margins)))
    j, tau = i[worst], share[worst]
    by_level, by_phase = slope.real, np.degrees(slope.imag)
    by_tau = -(by_level[:, j] * (1.0 - tau) + by_level[:, j + 1] * tau) / rise[worst]
    by_margin = by_phase[:, j] * (1.0 - tau) + by_phase[:, j + 1] * tau + turn[worst] * by_tau
    return float(margins[worst]), by_margin
