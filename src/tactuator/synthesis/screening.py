"""Screening of candidates against every limit: many shapes times many gains at once, on fixed grids.

Every figure of a candidate is computed without regard to what is asked and then compared with it, so that relaxing a
limit can only let more pass. What passes here is judged once more in full by whoever takes it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.requirements import FeedbackRequirements
from tactuator.signals.systems import backward_difference
from tactuator.synthesis.assessment import quadrature
from tactuator.synthesis.candidates import LIGHT_DAMPING, LoopStructure, crossovers_hz
from tactuator.synthesis.family import Member, bears_any_lower_gain
from tactuator.synthesis.limits import DB, Limit, Quantity, loop_limits

_AT_ONCE = 256
_HELD_AT_ONCE = 48
"""Candidates whose margins are looked at together: most callers want the first few alone."""
_SOME = 8
"""Parts of the wide grid, each of every eighth frequency: most candidates fail on the first."""
_UNKNOWN = -1
_AT_ONE = 1e-9


@dataclass(frozen=True)
class _Grid:
    """Frequencies (f,), z - 1 there, and every member's plant, (m, f)."""

    frequency_hz: FloatArray
    difference: ComplexArray
    plants: ComplexArray


@dataclass(frozen=True)
class Survivors:
    """Candidates that keep line limits and peaks, in the order of their mean |S|: parameter vectors (n, COUNT), max|T|
    (n,), and what tells of some whether they keep the rest."""

    parameters: FloatArray
    peaks: FloatArray
    holds: Callable[[FloatArray], NDArray[np.bool_]]
    _known: NDArray[np.int8] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_known", np.full(self.peaks.size, _UNKNOWN, dtype=np.int8))

    def kept(self, limits: Sequence[Limit]) -> Iterator[FloatArray]:
        """Yield those that keep all limits: parameter vectors (COUNT,). limits: the task's, that on max|T| lower."""
        peak = min(limit.asked for limit in limits if limit.quantity == "resonance_peak")
        within = np.flatnonzero(self.peaks <= peak)
        for start in range(0, within.size, _HELD_AT_ONCE):
            some = within[start : start + _HELD_AT_ONCE]
            unknown = some[self._known[some] == _UNKNOWN]
            if unknown.size:
                self._known[unknown] = self.holds(self.parameters[unknown])
            yield from self.parameters[some[self._known[some] == 1]]


@dataclass(frozen=True)
class Task:
    """Task of a synthesis: the family of plants, what the loop must keep on each of them (with a limit on max|T|), the
    band over which the mean |S| in dB is to be least, and the rate.
    """

    family: tuple[Member, ...]
    limits: tuple[Limit, ...]
    rejection_band_hz: tuple[float, float]
    rate_hz: float

    @classmethod
    def of(
        cls, family: Sequence[Member], requirements: FeedbackRequirements, rate_hz: float, resonance_peak: float
    ) -> Task:
        """Return the task of a display's [feedback] and its resonance objective."""
        limits = loop_limits(requirements, resonance_peak, bears_any_lower_gain(family))
        return cls(tuple(family), limits, requirements.rejection_band_hz, rate_hz)

    @cached_property
    def screen(self) -> Screen:
        """Return the screen of this task's limits."""
        return Screen(self)

    @property
    def must_bear_less(self) -> bool:
        """Tell whether a loop has to be stable at every lower gain."""
        return not all(limit.gives_way for limit in self.limits)

    def limits_at(self, share: float) -> tuple[Limit, ...]:
        """Return the limits with 1 - share of the resonance objective in reserve."""
        return tuple(
            replace(limit, asked=1.0 + share * (limit.asked - 1.0)) if limit.quantity == "resonance_peak" else limit
            for limit in self.limits
        )


class Screen:
    """The limits of a task, ready to be asked of many candidates."""

    def __init__(self, task: Task) -> None:
        self._rate_hz, self._family, self._must_bear_less = task.rate_hz, task.family, task.must_bear_less
        self._structure = LoopStructure(task.rate_hz)
        self._line_limits = [limit for limit in task.limits if limit.frequency_hz is not None]
        whole = [limit for limit in task.limits if limit.frequency_hz is None and limit.gives_way]
        self._whole = {limit.quantity: limit for limit in whole}
        self._lines = self._grid(np.array([limit.frequency_hz for limit in self._line_limits], dtype=np.float64))
        low, high = task.rejection_band_hz
        nodes, self._band_weight = np.polynomial.legendre.leggauss(12)
        self._band = self._grid(np.exp(0.5 * (np.log(low * high) + np.log(high / low) * nodes)))
        spread = [np.geomspace(0.02 * low, low, 12), np.geomspace(low, 0.4999 * task.rate_hz, 110)]
        wide = np.unique(np.concatenate([*spread, *around_modes_hz(self._family)]))
        self._wide = self._grid(wide[(wide > 0.0) & (wide < 0.5 * task.rate_hz)])
        noise, self._noise_weight = quadrature(task.rate_hz, panels=9, nodes=9)
        self._noise = self._grid(noise)
        self._crossovers = self._grid(crossovers_hz(task.rate_hz))
        self._turns = np.array([_expected_turn(member) for member in self._family])
        self._has_poles_outside = bool(np.max(self._turns) > 0.75 * np.pi)

    def _grid(self, frequency_hz: FloatArray) -> _Grid:
        z = np.exp(2j * np.pi * frequency_hz / self._rate_hz)
        difference = backward_difference(frequency_hz, self._rate_hz) * z
        plants = [member.sampled.response(frequency_hz) for member in self._family]
        return _Grid(frequency_hz, difference, np.array(plants).reshape(len(plants), frequency_hz.size))

    def survivors(self, shapes: FloatArray) -> Survivors:
        """Return the candidates of `shapes` (n, COUNT), over every gain, that keep line limits and peaks."""
        parts = [self._possible(shapes[i : i + _AT_ONCE]) for i in range(0, len(shapes), _AT_ONCE)]
        parameters, peaks = (np.concatenate(field) for field in zip(*parts, strict=True))
        order = np.argsort(self._mean_db(parameters), kind="stable")
        return Survivors(parameters[order], peaks[order], self._holds)

    def _possible(self, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the candidates that keep line limits and peaks, shape (m, COUNT), and their max|T|, (m,)."""
        gains, ok = self._gains(shapes)
        with np.errstate(all="ignore"):
            ok &= np.max(self._line_excess_db(shapes, gains), axis=-1, initial=-np.inf) <= 0.0
            which, column = np.nonzero(ok)
            kept, peaks = self._peaks(shapes, which, gains[which, column])
            which, column = which[kept], column[kept]
            if self._has_poles_outside:  # most loops around such a plant keep peaks and are unstable
                turned = self._turned(shapes, which, gains[which, column])
                which, column, peaks = which[turned], column[turned], peaks[turned]
        parameters = shapes[which].copy()
        parameters[:, 0] = np.log(gains[which, column])
        return parameters, peaks

    def _gains(self, shapes: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the gains that put the nominal plant's crossover on the grid, (n, g), and which of them
        are numbers.
        """
        through = np.abs(self._structure.responses(shapes, self._crossovers.difference) * self._crossovers.plants[0])
        with np.errstate(all="ignore"):
            gains = 1.0 / through
        good = np.isfinite(gains) & (gains > 0.0)
        return np.where(good, gains, 1.0), good

    def _line_excess_db(self, shapes: FloatArray, gains: FloatArray) -> FloatArray:
        """Return the decibels by which |T| at mains lines and |S| at rejection frequencies pass their limits, shape (n,
        g, lines), for the worst member.
        """
        controller = self._structure.responses(shapes, self._lines.difference)
        worst = np.full((*gains.shape, len(self._line_limits)), -np.inf)
        for plant in self._lines.plants:
            loop = controller * plant
            size, real = np.abs(loop) ** 2, loop.real
            for index, limit in enumerate(self._line_limits):
                square, part = size[:, index, None], real[:, index, None]
                away = 1.0 + gains * (2.0 * part + gains * square)  # |1 + kL|^2
                above = gains**2 * square if limit.quantity == "|T|" else 1.0
                level = 0.5 * DB * np.log(above / away)
                worst[:, :, index] = np.maximum(worst[:, :, index], limit.excess(level))
        return np.nan_to_num(worst, nan=np.inf)

    def _peaks(
        self, shapes: FloatArray, which: NDArray[np.intp], gains: FloatArray
    ) -> tuple[NDArray[np.intp], FloatArray]:
        """Return which of the shapes `which`, (m,), keep max|S| and max|T| on the wide grid at their gains, and their
        max|T| there; whoever fails on some of the frequencies is not tried on the others.
        """
        rows, which = np.unique(which, return_inverse=True)
        controller = self._structure.responses(shapes[rows], self._wide.difference)
        kept, greatest = np.arange(gains.size), np.zeros(gains.size)
        highest, least = self._whole["resonance_peak"].asked ** 2, -np.inf
        if "sensitivity_peak" in self._whole:
            least = self._whole["sensitivity_peak"].asked ** -2
        for plant in self._wide.plants:
            loop = (controller * plant).T
            size, twice = np.abs(loop) ** 2, 2.0 * loop.real
            for first in range(_SOME):
                nearest, squares = np.full(gains.size, np.inf), gains**2
                for square, part in zip(size[first::_SOME], twice[first::_SOME], strict=True):
                    above = squares * square[which]
                    away = 1.0 + gains * part[which] + above
                    np.minimum(nearest, away, out=nearest)
                    np.maximum(greatest, above / away, out=greatest)
                stays = (greatest <= highest) & (nearest >= least)
                kept, which, gains, greatest = kept[stays], which[stays], gains[stays], greatest[stays]
        return kept, np.sqrt(greatest)

    def _turned(self, shapes: FloatArray, which: NDArray[np.intp], gains: FloatArray) -> NDArray[np.bool_]:
        """Return whether 1 + L turns as often as a stable loop's, for the shapes `which`, (m,), at their gains.

        Where L crosses the real axis does not depend on the gain, so that one look at a shape does for all of them.
        """
        rows, which = np.unique(which, return_inverse=True)
        controller = self._structure.responses(shapes[rows], self._wide.difference)
        stable = np.ones(gains.size, dtype=bool)
        for plant, turns in zip(self._wide.plants, self._turns, strict=True):
            loop = controller * plant
            below = np.signbit(loop.imag)
            ends = 1.0 + gains[:, None] * loop[which][:, [0, -1]]
            turned = np.angle(ends[:, 1]) - np.angle(ends[:, 0])
            for k in np.flatnonzero(np.any(below[:, 1:] != below[:, :-1], axis=0)).tolist():
                before, after = loop[:, k], loop[:, k + 1]
                crosses = below[:, k + 1].astype(float) - below[:, k]
                place = before.real - before.imag * (after.real - before.real) / (after.imag - before.imag)
                turned += 2.0 * np.pi * crosses[which] * (gains * place[which] < -1.0)
            stable &= np.abs(turned - turns) < 0.6 * np.pi
        return stable

    def _mean_db(self, parameters: FloatArray) -> FloatArray:
        """Return the mean |S| over the rejection band, dB, of the worst member, (n,)."""
        worst = np.full(parameters.shape[0], -np.inf)
        controller = self._structure.responses(parameters, self._band.difference)
        for plant in self._band.plants:
            mean = -0.5 * DB * np.sum(np.log(np.abs(1.0 + controller * plant)) * self._band_weight, axis=1)
            worst = np.maximum(worst, mean)
        return worst

    def _holds(self, parameters: FloatArray) -> NDArray[np.bool_]:
        """Return whether the rest of the limits is kept and every loop is stable, (n,); what one plant fails is not
        tried on the next.
        """
        kept = np.arange(parameters.shape[0])
        noise = self._structure.responses(parameters, self._noise.difference)
        wide: ComplexArray | None = None
        with np.errstate(all="ignore"):
            for index in range(len(self._family)):
                quiet = self._keeps("command_noise_gain_max", noise, index)
                kept, noise = kept[quiet], noise[quiet]
                if wide is None:
                    wide = self._structure.responses(parameters[kept], self._wide.difference)
                else:
                    wide = wide[quiet]
                sound = self._keeps("phase_margin_deg", wide, index)
                sound[sound] = self._is_stable(wide[sound] * self._wide.plants[index], index)
                kept, noise, wide = kept[sound], noise[sound], wide[sound]
        return np.isin(np.arange(parameters.shape[0]), kept)

    def _keeps(self, quantity: Quantity, controller: ComplexArray, index: int) -> NDArray[np.bool_]:
        """Return whether controllers (n, f) keep the limit on a quantity, if there is one, on one plant, (n,)."""
        if quantity not in self._whole:
            return np.ones(controller.shape[0], dtype=bool)
        return np.asarray(self._whole[quantity].excess(self._figure(quantity, controller, index)) <= 0.0)

    def _figure(self, quantity: Quantity, controller: ComplexArray, index: int) -> FloatArray:
        """Return a figure of the loops of controllers (n, f) with one plant, (n,), in its limit's unit; controllers on
        the wide grid, for noise on that of the noise.
        """
        if quantity == "command_noise_gain_max":
            sensed = controller / (1.0 + controller * self._noise.plants[index])
            return np.asarray(np.sqrt(np.sum(self._noise_weight * np.abs(sensed) ** 2, axis=1)))
        loop = controller * self._wide.plants[index]
        if quantity == "phase_margin_deg":
            return _phase_margins_deg(loop)
        peaks = 1.0 / (1.0 + loop) if quantity == "sensitivity_peak" else loop / (1.0 + loop)
        return np.asarray(np.max(np.abs(peaks), axis=1))

    def _is_stable(self, loop: ComplexArray, index: int) -> NDArray[np.bool_]:
        """Return whether 1 + L turns as often as a stable loop's and, where it must bear less, L does not cross the
        negative real axis beyond -1 between points of the grid; (n,)."""
        angle = np.angle(1.0 + loop)
        turned = np.sum((np.diff(angle, axis=1) + np.pi) % (2.0 * np.pi) - np.pi, axis=1)
        stable = np.asarray(np.abs(turned - self._turns[index]) < 0.6 * np.pi)
        if self._must_bear_less:
            before, after = loop[:, :-1], loop[:, 1:]
            crosses = np.signbit(before.imag) != np.signbit(after.imag)
            place = before.real - before.imag * (after.real - before.real) / (after.imag - before.imag)
            stable &= ~np.any(crosses & (place < -1.0), axis=1)
        return stable

    def nearest(self, shapes: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the `count` candidates (n, COUNT) of `shapes` that miss the line limits, peaks and noise gain by
        least, and by how many dB at worst, (n,); for starts and for telling what is near."""
        parts = [self._nearest(shapes[i : i + _AT_ONCE], count) for i in range(0, len(shapes), _AT_ONCE)]
        parameters, miss = (np.concatenate(field) for field in zip(*parts, strict=True))
        order = np.argsort(miss, kind="stable")[:count]
        return parameters[order], miss[order]

    def _nearest(self, shapes: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
        gains, good = self._gains(shapes)
        with np.errstate(all="ignore"):
            lines = np.max(self._line_excess_db(shapes, gains), axis=-1, initial=0.0)
        lines = np.where(good & np.isfinite(lines), lines, np.inf)
        place = np.argsort(lines, axis=None, kind="stable")[: 4 * count]
        row, column = np.unravel_index(place, lines.shape)
        parameters = shapes[row].copy()
        parameters[:, 0] = np.log(gains[row, column])
        miss = np.maximum(lines[row, column], self._other_excess_db(parameters))
        order = np.argsort(miss, kind="stable")[:count]
        return parameters[order], miss[order]

    def _other_excess_db(self, parameters: FloatArray) -> FloatArray:
        """Return the excess of peaks, phase margin and noise gain over their limits, dB, (n,); infinite
        where unstable.
        """
        worst = np.zeros(parameters.shape[0])
        wide, noise = (self._structure.responses(parameters, grid.difference) for grid in (self._wide, self._noise))
        with np.errstate(all="ignore"):
            for index in range(len(self._family)):
                rows = [np.where(self._is_stable(wide * self._wide.plants[index], index), 0.0, np.inf)]
                for quantity, limit in self._whole.items():
                    controller = noise if quantity == "command_noise_gain_max" else wide
                    rows.append(limit.excess_db(self._figure(quantity, controller, index)))
                worst = np.maximum(worst, np.nan_to_num(np.max(rows, axis=0), nan=np.inf))
        return worst


def around_modes_hz(family: Sequence[Member]) -> Iterator[FloatArray]:
    """Yield frequencies around every lightly damped pole and zero of each member: dense in proportion to its damping,
    up to 30 % away, as far as a controller's notch may lie beside it."""
    for member in family:
        for root in np.append(member.continuous.poles, member.continuous.zeros):
            if root.imag > 0.0 and abs(root.real) < LIGHT_DAMPING * abs(root):
                away = np.geomspace(0.25 * min(abs(root.real) / root.imag, 0.3), 0.3, 12)
                yield root.imag * (1.0 + np.concatenate([-away[::-1], [0.0], away])) / (2.0 * np.pi)


def _expected_turn(member: Member) -> float:
    """Return the angle, radians, by which 1 + L of a stable loop turns from rest to half the rate, for a controller of
    one integrator.

    All n closed poles inside turn the closed polynomial by n pi; an open pole inside takes pi of that away, one at
    z = 1 half of it, one outside nothing (the principle of the argument on the upper half of the unit circle).
    """
    size = np.abs(member.sampled.poles)
    on = int(np.sum(np.abs(member.sampled.poles - 1.0) < _AT_ONE)) + 1
    outside = int(np.sum(size > 1.0 + _AT_ONE))
    return float(np.pi * (0.5 * on + outside))


def _phase_margins_deg(loop: ComplexArray) -> FloatArray:
    """Return the smallest phase margin over all crossings of a grid, by interpolation, degrees, (n,); 180 without a
    crossing.
    """
    level, phase = np.log(np.abs(loop)), np.degrees(np.angle(-loop))
    crosses = np.signbit(level[:, 1:]) != np.signbit(level[:, :-1])
    share = -level[:, :-1] / (level[:, 1:] - level[:, :-1])
    turn = (np.diff(phase, axis=1) + 180.0) % 360.0 - 180.0
    return np.asarray(np.min(np.where(crosses, np.abs(phase[:, :-1] + turn * share), 180.0), axis=1))
