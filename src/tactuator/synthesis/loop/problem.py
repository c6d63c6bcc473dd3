"""Requirements on a synthesised loop as smooth functions of its parameters with exact derivatives.

Every requirement becomes an excess in dB (phase: degrees / 5) that must not be positive. On a fixed grid, for every
plant of the family at once: d log|S| = -Re(T dlogC), d log|T| = Re(S dlogC), d|CS|^2 = 2 |CS|^2 Re(S dlogC).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.requirements import FeedbackRequirements
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
            ("command_noise_gain_max", asked.command_noise_gain_max),
        ):
            if value is not None:
                names.append(name)
        names.append("resonance_peak")
        return [(name, member.name) for member in family for name in names]

    def asked(self, name: str) -> float:
        """Return the limit of the requirement of that label."""
        asked = self.requirements
        limits: dict[str, float | None] = {
            "sensitivity_peak": asked.sensitivity_peak,
            "phase_margin_deg": asked.phase_margin_deg,
            "command_noise_gain_max": asked.command_noise_gain_max,
            "resonance_peak": self.resonance_peak,
        }
        limits |= {f"|T| dB at {f:g} Hz": v for f, v in zip(asked.mains_hz, asked.mains_max_db, strict=True)}
        limits |= {f"|S| dB at {f:g} Hz": v for f, v in zip(asked.rejection_hz, asked.rejection_max_db, strict=True)}
        value = limits[name]
        assert value is not None
        return value

    def at(self, parameters: FloatArray) -> Point:
        """Return the values and derivatives of everything at one parameter vector."""
        controller, slope = self.structure.response_and_slope(parameters, self._difference)
        loops = _Loops(controller, controller * self._plants)
        rows = _Rows(slope)
        mean = DB * (loops.log_s[:, self._band] @ self._band_weight)
        rows.add(mean, self._band, -DB * loops.complementary[:, self._band] * self._band_weight)
        self._add_lines(rows, loops)
        self._add_peaks(rows, loops)
        values, slopes = np.concatenate(rows.values, axis=1), np.concatenate(rows.slopes, axis=1)
        total = values[:, 1:].reshape(-1) + self.tighten
        return Point(values[:, 0], slopes[:, 0], total, slopes[:, 1:].reshape(-1, COUNT))

    def _add_lines(self, rows: _Rows, loops: _Loops) -> None:
        asked = self.requirements
        rows.add_each(DB * loops.log_t[:, self._mains] - asked.mains_max_db, self._mains, DB * loops.sensitivity)
        levels = DB * loops.log_s[:, self._rejection] - asked.rejection_max_db
        rows.add_each(levels, self._rejection, -DB * loops.complementary)

    def _add_peaks(self, rows: _Rows, loops: _Loops) -> None:
        asked, at = self.requirements, self._peaks
        if asked.sensitivity_peak is not None:
            peak, share = _smooth_maximum(loops.log_s[:, at])
            rows.add(DB * (peak - np.log(asked.sensitivity_peak)), at, -DB * loops.complementary[:, at] * share)
        if asked.phase_margin_deg is not None:
            margin, weights = _phase_margin_deg(loops.loop[:, at], loops.log_l[:, at])
            rows.add((asked.phase_margin_deg - margin) / DEGREES_PER_DB, at, -weights / DEGREES_PER_DB)
        if asked.command_noise_gain_max is not None:
            sensitivity = loops.sensitivity[:, self._noise]
            power = self._noise_weight * np.abs(loops.controller[self._noise] * sensitivity) ** 2
            total = np.sum(power, axis=1)
            values = 0.5 * DB * np.log(total) - DB * np.log(asked.command_noise_gain_max)
            rows.add(values, self._noise, DB * sensitivity * power / total[:, None])
        peak, share = _smooth_maximum(loops.log_t[:, at])
        rows.add(DB * (peak - np.log(self.resonance_peak)), at, DB * loops.sensitivity[:, at] * share)


class _Loops:
    """C, (g,), and every member's L, S, T and the logarithms of their sizes, (m, g)."""

    def __init__(self, controller: ComplexArray, loop: ComplexArray) -> None:
        self.controller, self.loop = controller, loop
        self.sensitivity = 1.0 / (1.0 + loop)
        self.complementary = loop * self.sensitivity
        self.log_l, self.log_s = np.log(np.abs(loop)), np.log(np.abs(self.sensitivity))
        self.log_t = self.log_l + self.log_s


class _Rows:
    """Values of every member, (m, k), and derivatives, (m, k, COUNT): Re(sum w dlogC) for weights w on the grid."""

    def __init__(self, slope: ComplexArray) -> None:
        self._slope = np.ascontiguousarray(slope.T)
        self.values: list[FloatArray] = []
        self.slopes: list[FloatArray] = []

    def add(self, values: FloatArray, place: slice, weights: ComplexArray) -> None:
        """Add one row: values (m,), weights at `place`, (m, size)."""
        self.values.append(values[:, None])
        self.slopes.append(np.real(weights @ self._slope[place])[:, None])

    def add_each(self, values: FloatArray, place: slice, weights: ComplexArray) -> None:
        """Add a row for every point of `place`: values (m, size); weights on the whole grid, (m, g)."""
        self.values.append(values)
        self.slopes.append(np.real(weights[:, place, None] * self._slope[place]))


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


def _smooth_maximum(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the log-sum-exp along each row, slightly above the maximum, and the share that each value has in it."""
    top = np.max(values, axis=1, keepdims=True)
    weights = np.exp(_SHARPNESS * (values - top))
    total = np.sum(weights, axis=1, keepdims=True)
    return (top + np.log(total) / _SHARPNESS)[:, 0], weights / total


def _phase_margin_deg(loops: ComplexArray, levels: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """Return each row's least phase margin, log|L| (`levels`) and phase linear between the points of its grid, and the
    weights with which it follows log C, (m, g)."""
    margins, weights = np.full(loops.shape[0], 180.0), np.zeros(loops.shape, dtype=np.complex128)
    row, i = np.nonzero(np.signbit(levels[:, 1:]) != np.signbit(levels[:, :-1]))
    before, after = np.degrees(np.angle(-loops[row, i])), np.degrees(np.angle(-loops[row, i + 1]))  # 0 at -180
    rise = levels[row, i + 1] - levels[row, i]
    share = -levels[row, i] / rise
    turn = (after - before + 180.0) % 360.0 - 180.0
    found = before + turn * share
    order = np.lexsort((np.abs(found), row))
    row, first = np.unique(row[order], return_index=True)
    worst = order[first]
    j, tau = i[worst], share[worst]
    by_log = -turn[worst] / rise[worst] - 1j * np.degrees(1.0)  # of a level (real), of a phase (imaginary)
    margins[row] = found[worst]
    weights[row, j], weights[row, j + 1] = by_log * (1.0 - tau), by_log * tau
    return margins, weights
