"""Friction in a record: Dahl's state along the motion is taken off the command, and the rest is as linear as any other.

The Coulomb level and the presliding distance are those that explain most of what a fit leaves, everything else fitted
again to first order; then the engine fits the record anew with the friction off its command, until both stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import islice, product
from typing import Literal

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.data import Signals
from tactuator.identification.fit import (
    SpectralEstimate,
    fit,
    glance,
    propose_starts,
    refit,
    refitted,
    simplified,
)
from tactuator.identification.form import Known, freedom
from tactuator.identification.hold import Hold
from tactuator.identification.likelihood import eliminated
from tactuator.identification.lines import HIGHEST, Spectrum, local_response, spectrum
from tactuator.identification.residual import Residual, record_residual
from tactuator.identification.uncertainty import log_slopes
from tactuator.model.plant_model import Z95
from tactuator.runtime._core import ffi, lib
from tactuator.signals.record import Record

_CERTAIN = 100.0
"""Drop of -2 log likelihood by one parameter from which on friction is looked for."""
_SHOWN_AT = np.geomspace(1e-3, 1.0, 4)
"""Presliding distances, of the motion's deviation, at which it is looked for first."""
_DEVIATIONS = 5.0
"""Deviations of a level from zero from which on there is friction."""
_TRIFLE = 1e-3
"""Share of what a fit leaves that friction has to explain."""
_POOR = 0.02
"""Share of the position's power that a fit may leave before friction is suspected to rule the record."""
VARIANCE_TIMES = 4.0
"""The covariance is multiplied by this beside friction or a distortion, and the evidence that separates holds likewise:
what friction leaves is at each frequency alike in sign, and was up to 1.5 half-widths on records of another generator.
"""
_BEYOND = 1.5
"""Half-width over the first-order departure by another law of friction: on records of another generator, whose law was
none of these, the truth lay up to 1.2 departures away."""
_SAMPLED = 0.0025
"""Share of a level below which no deviation goes: its state follows a path that is known at samples alone."""
_ESTIMATES, _ROUNDS = 3, 12
"""Most whole estimates of a record's form with friction off its command, and most steps of the level between them."""
_FINE_AT_FIRST, _FINE, _REACH = 10.0 ** (1.0 / 32.0), 1.25**0.125, 15
"""Steps of a presliding distance, as ratios: where none is known, and about one that is, at most so many of them."""
_FADING = np.geomspace(0.03, 0.6, 10)
"""Speeds over which Stribeck's part may fade, over the usual speed; beyond them it passes for the others."""
_RULED = 0.5
"""What friction may leave of a command, over what the linear motion leaves, where it rules the record: of 30 motors in
position loops one had more, of resonances all had twice that, but two of 70."""
_STILL = 0.05
"""Change of the level, in its deviations, from which on another round brings nothing."""


@dataclass(frozen=True, eq=False)
class FrictionFit:
    """An estimate of records with friction taken off their commands. signals: with it. coulomb, its
    standard deviation, and the presliding distance, in the signals' units. shifts: deviations of (numerator, theta,
    dead time), each independent of the others, by the level (first) and by other laws of friction, (k, parameters).
    beyond_chance: power of the residual that follows the commands over what chance leaves of it.
    """

    estimate: SpectralEstimate
    signals: Signals
    coulomb: float
    deviation: float
    presliding: float
    shifts: FloatArray
    beyond_chance: float = 1.0

    def within(self, half_width: float, beyond_chance: float) -> FrictionFit:
        """Return the same with a level of that 95 % half-width, and the parameters' deviations by it."""
        deviation = half_width / Z95
        by_level = self.shifts[:1] * (deviation / self.deviation)
        shifts = np.vstack([by_level, self.shifts[1:]])
        return replace(self, deviation=deviation, shifts=shifts, beyond_chance=beyond_chance)


def dahl_state(position: FloatArray, presliding: float) -> FloatArray:
    """Return Dahl friction's state (-1 .. 1) along `position` (count,), from 0; presliding in position's unit."""
    x = np.ascontiguousarray(position, dtype=np.float64)
    friction = ffi.new("tact_friction *", (1.0 / presliding, 1.0 / presliding))
    state, out = ffi.new("tact_friction_state *", (0.0, float(x[0]))), np.empty(x.size)
    places = [ffi.cast("double *", ffi.from_buffer(values)) for values in (x, out)]
    lib.tact_friction_run(friction, state, *places, x.size)
    return out


@dataclass(frozen=True, eq=False)
class _Level:
    """Friction of a level and a presliding distance along a path of every record, (n,); held: it acts from sample to
    sample, as a simulation's may, and not all the time; deviation: of the level.
    """

    coulomb: float
    presliding: float
    paths: tuple[FloatArray, ...]
    held: bool = False
    deviation: float = np.inf

    @cached_property
    def free(self) -> list[FloatArray]:
        """Return friction's state along every path, (n,)."""
        return [dahl_state(path, self.presliding) for path in self.paths]

    @cached_property
    def states(self) -> list[FloatArray]:
        """Return the same as it acts from each sample to the next."""
        return _acting(self.free, self.held)

    def off(self, signals: Signals) -> list[tuple[FloatArray, FloatArray]]:
        """Return the signals with friction off their commands."""
        pairs = zip(signals, self.states, strict=True)
        return [(command - self.coulomb * state, position) for (command, position), state in pairs]


@dataclass(frozen=True, eq=False)
class _Stage:
    """An estimate of signals with a level of friction off their commands, and what all trials from there share. paths:
    the motion of every record as the estimate has it, free of noise and dead time; measured: low-passed; (n,) each.
    """

    signals: Signals
    now: SpectralEstimate
    level: _Level

    @cached_property
    def lines(self) -> _FrictionLines:
        return _FrictionLines(self.now, self.level)

    @cached_property
    def paths(self) -> tuple[FloatArray, ...]:
        pairs = zip(self.signals, self.now.residuals, strict=True)
        return tuple(self._earlier(rest.simulated, position.size, rest.taken.shift) for (_, position), rest in pairs)

    @cached_property
    def measured(self) -> tuple[FloatArray, ...]:
        rate_hz = self.now.spectra[0].rate_hz
        paths = (_without_noise(position, rate_hz) for _, position in self.signals)
        return tuple(self._earlier(path, path.size) for path in paths)

    def _earlier(self, path: FloatArray, count: int, shift: int = 0) -> FloatArray:
        """Return a path, `shift` samples early, without the estimate's dead time, for which friction does not wait, in
        the direction in which commands do work: a sensor may count the other way.
        """
        late = int(self.now.chosen.fit.delay_s * self.now.spectra[0].rate_hz + 0.5)
        moved = path[min(max(late - shift, 0), path.size - 1) :]
        return self._direction * np.append(moved, np.full(count - moved.size, moved[-1]))

    @cached_property
    def _direction(self) -> float:
        """Return the sign of the work that the commands do along the estimate's motion without its dead time."""
        work = 0.0
        for taken, rest in zip(self.now.spectra, self.now.residuals, strict=True):
            turn = 2j * np.pi * taken.frequency_hz[1:]
            moved = rest.response * np.exp(turn * self.now.chosen.fit.delay_s)
            work += float(np.sum(np.abs(taken.command[1:]) ** 2 * (turn * moved).real))
        return float(np.copysign(1.0, work))


def fit_friction(
    bare: SpectralEstimate, holds: tuple[Hold, ...], known: Known, note: Callable[[str], None]
) -> FrictionFit | None:
    """Return the estimate with friction, or None where none is certain; its form is the simplest whose response cannot
    be distinguished from the best one's, whichever law friction has.

    bare: the estimate without friction; holds, known: as it was found by.
    """
    signals = bare.data.signals
    note("looking for friction")
    stage = _Stage(signals, bare, _Level(0.0, 0.0, ()))
    if not any(np.ptp(path) > 0.0 for path in stage.measured):
        return None  # a dead time as long as the record leaves no motion
    level = _level_without_model(stage) if _share_left(bare.residuals) > _POOR else None
    if level is None and friction_shown(signals, bare) is None:
        return None
    measured = stage.measured
    level = _stepped(stage, measured) if level is None else level
    if level.coulomb <= 0.0:
        return None
    del stage  # its lines take as much memory as an estimate
    # the first level is so rough that a quick fit is enough for the next
    data = bare.data.with_commands(level.off(signals))
    starts = propose_starts(data, holds, known.without_values, note)
    level = _settled(_Stage(signals, glance(data, starts, known), level), measured)
    now: SpectralEstimate | None = None
    for _ in range(_ESTIMATES):
        if level.coulomb <= 0.0:
            return None
        data = data.with_commands(level.off(signals))
        now = fit(data, starts, known, note) if now is None else refit(data, now, known, note)
        stage = _Stage(signals, now, level)
        level = _settled(stage, measured)
        if abs(level.coulomb - stage.level.coulomb) < _STILL * level.deviation:
            break
    found = _with_level(stage)
    simpler = stage.now if found is None else simplified(stage.now, known, found.shifts)
    if simpler is stage.now:
        return found
    level = _settled(_Stage(signals, simpler, stage.level), measured)
    return _with_level(_Stage(signals, _again(simpler, level.off(signals)), level)) or found


def _with_level(stage: _Stage) -> FrictionFit | None:
    """Return the estimate of signals with friction off their commands, with what friction leaves unknown; None where no
    friction is certain.
    """
    lines, level = stage.lines, stage.level
    (plain,) = lines.pulls([level.states])
    gain, coulomb, power, weights = lines.explained(plain)
    deviation = 1.0 / np.sqrt(2.0 * power) if power > 0.0 else np.inf
    if not (coulomb > _DEVIATIONS * deviation and gain > _TRIFLE * lines.power):
        return None
    by_law, by_level = lines.other_laws(level, plain)
    deviation = float(np.linalg.norm([np.sqrt(VARIANCE_TIMES) * deviation, _SAMPLED * level.coulomb, *by_level]))
    shifts = np.vstack([-weights * deviation, by_law])
    return FrictionFit(stage.now, level.off(stage.signals), level.coulomb, deviation, level.presliding, shifts)


def friction_shown(signals: Signals, bare: SpectralEstimate) -> tuple[float, FloatArray] | None:
    """Return the level of a friction along the estimate's own path, or the measured one, that explains more of the
    residual than chance ever would, and by how much one unit of it moves the estimate's parameters; None where none
    shows.

    It counts beside what the parameters make up for: friction damps a resonance like any other damping. Where it holds
    the motion still for a while, the estimate's own path reverses at other times, and only the measured one shows it.
    """
    stage = _Stage(signals, bare, _Level(0.0, 0.0, ()))
    if not all(np.all(residual.response) for residual in bare.residuals):
        return None  # nothing moves
    motion = max(float(np.std(path)) for path in stage.paths)
    if not motion > 0.0:
        return None
    both = product((stage.paths, stage.measured), _SHOWN_AT * motion)
    ways = ([dahl_state(path, place) for path in paths] for paths, place in both)
    best = max((stage.lines.explained(pull) for pull in stage.lines.pulls(ways)), key=lambda way: way[0])
    return (best[1], best[3]) if 2.0 * best[0] > _CERTAIN else None


def _without_noise(position: FloatArray, rate_hz: float) -> FloatArray:
    """Return the position (n,) as far up as it exceeds its noise, its ends turned round."""
    return np.asarray(_low_passed(position, rate_hz, _motion_corner_hz(position, rate_hz), "odd")[0])


def _low_passed(
    values: FloatArray, rate_hz: float, corner_hz: float, ends: Literal["odd", "even"], derivatives: int = 0
) -> FloatArray:
    """Return values (n,) behind a Gaussian low-pass without phase, and their derivatives, (1 + derivatives, n); ends:
    turned round (odd) or mirrored (even).
    """
    # the low-pass rings over a few of its periods: no more than those is turned round at either end
    more = min(values.size - 1, int(6.0 * rate_hz / corner_hz))
    size = scipy.fft.next_fast_len(values.size + 2 * more, real=True)
    before = (size - values.size) // 2
    turned = np.pad(values, (before, size - values.size - before), mode="reflect", reflect_type=ends)
    frequency = np.fft.rfftfreq(size, 1.0 / rate_hz)
    lines = np.fft.rfft(turned) * np.exp(-0.35 * (frequency / corner_hz) ** 2)
    rows = [lines * (2j * np.pi * frequency) ** k for k in range(1 + derivatives)]
    return np.asarray(np.fft.irfft(rows, size)[:, before : before + values.size])


def ruled_by_friction(record: Record) -> float:
    """Return the share of the command's power that follows the direction of the motion and nothing linear of it, as of
    a motor that friction rules in a position loop; 0 where both together leave more than half of what the latter does.
    """
    corner = 0.7 * _motion_corner_hz(record.position, record.rate_hz)
    position = record.position - record.position.mean()
    motion = _low_passed(position, record.rate_hz, corner, "odd", derivatives=2)
    rows = (record.command - record.command.mean(), np.sign(motion[1]))
    goal, direction = (_low_passed(row, record.rate_hz, corner, "even")[0] for row in rows)
    columns = np.stack([*motion, np.ones(goal.size), direction])
    columns /= np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), 1e-300)
    products = np.vstack([columns, goal]) @ np.vstack([columns, goal]).T
    power = max(float(products[-1, -1]), 1e-300)
    linear, whole = (float(eliminated(products, known)[1][-1, -1]) / power for known in (4, 5))
    return float(linear - whole if whole < _RULED * linear else 0.0)


def _motion_corner_hz(position: FloatArray, rate_hz: float) -> float:
    """Return the frequency up to which the position is 7 dB above its noise (the floor beyond 0.3 rate), hertz."""
    power = np.abs(np.fft.rfft(np.hanning(position.size) * (position - position.mean()))) ** 2
    frequency = np.fft.rfftfreq(position.size, 1.0 / rate_hz)
    floor = float(np.mean(power[frequency > 0.3 * rate_hz]))
    edges = np.unique(np.round(np.geomspace(3, power.size - 1, 120)).astype(int))
    mean = np.add.reduceat(power, edges)[:-1] / np.diff(edges)
    centre = np.sqrt(edges[:-1] * edges[1:]) * rate_hz / position.size
    above = centre[mean > 5.0 * floor]
    lowest = 20.0 * rate_hz / position.size
    return float(np.clip(above.max() if above.size else lowest, lowest, 0.1 * rate_hz))


def _share_left(residuals: Sequence[Residual]) -> float:
    left_over = sum(float(np.sum(np.abs(residual.lines[1:]) ** 2)) for residual in residuals)
    whole = sum(float(np.sum(np.abs(residual.taken.position[1:]) ** 2)) for residual in residuals)
    return left_over / max(whole, 1e-300)


def _settled(stage: _Stage, measured: tuple[FloatArray, ...]) -> _Level:
    """Return the level at which the estimate's form and the friction along its own path, or the measured one, agree."""
    # each residual takes as much memory as a record
    signals, now = stage.signals, replace(stage.now, other_residuals=(), trials=())
    for _ in range(_ROUNDS):
        level = _stepped(stage, measured)
        change = abs(level.coulomb - stage.level.coulomb)
        if level.coulomb <= 0.0 or change < _STILL * level.deviation:
            break
        now = _again(now, level.off(signals))
        stage = _Stage(signals, now, level)
    return level


def _again(now: SpectralEstimate, signals: Signals) -> SpectralEstimate:
    """Return the estimate with its chosen fit fitted to other signals."""
    data = now.data.with_commands(signals)
    chosen = refitted(replace(now.chosen, fits={}), data.given)
    return replace(now, chosen=chosen, data=data, residuals=record_residual(chosen, data.spectra))


def _stepped(stage: _Stage, measured: tuple[FloatArray, ...]) -> _Level:
    """Return the level that explains most of what the estimate leaves, that which is off its commands included.

    Friction may follow the estimate's own path or the measured one, and act all the time or from sample to sample: the
    better way is chosen at one presliding distance, and the distance looked for along that way.
    """
    lines, both = stage.lines, (stage.paths, measured)
    explained = dict[tuple[int, bool, float], tuple[float, float, float]]()

    @lru_cache(maxsize=2)  # each takes as much memory as a record
    def states(k: int, presliding: float) -> list[FloatArray]:
        return [dahl_state(path, presliding) for path in both[k]]

    def best(*ways: tuple[int, bool, float]) -> tuple[int, bool, float]:
        new = [way for way in ways if way not in explained]
        pulls = lines.pulls(_acting(states(k, presliding), held) for k, held, presliding in new)
        explained.update((way, lines.explained(pull)[:3]) for way, pull in zip(new, pulls, strict=True))
        return max(ways, key=lambda way: explained[way][0])

    place, ratio, step = stage.level.presliding, _FINE, 1
    if place == 0.0:
        motion, ratio, step = max(float(np.std(path)) for path in both[0]), _FINE_AT_FIRST, (_REACH + 1) // 2
        places = (np.geomspace(1e-4, 1.0, 9) * motion).tolist()
        *_, place = best(*((0, False, place) for place in places))
    k, held, _ = best(*product((0, 1), (False, True), (place,)))

    def ahead(*steps: int) -> int:
        ways = {(k, held, place * ratio**each): each for each in steps}
        return ways[best(*ways)]

    presliding = place * ratio ** _uphill(ahead, step)
    _, coulomb, power = explained[k, held, presliding]
    coulomb = coulomb if coulomb < max(float(np.ptp(command)) for command, _ in stage.signals) else 0.0  # it ran away
    level = _Level(coulomb, presliding, both[k], held, 1.0 / np.sqrt(2.0 * power) if power > 0.0 else np.inf)
    level.__dict__["free"] = states(k, presliding)
    return level


def _uphill(best: Callable[..., int], step: int) -> int:
    """Return the place of the greatest gain about 0, by steps that double where they win, else halve; best: of some."""
    at = 0
    while step:
        ahead = best(*(place for place in (at, at - step, at + step) if abs(place) <= _REACH))
        at, step = (at, step // 2) if ahead == at else (ahead, 2 * step)
    return at


def _acting(states: list[FloatArray], held: bool) -> list[FloatArray]:
    """Return Dahl's states, (n,) each, as they act from each sample to the next."""
    if held:
        return states
    return [0.5 * np.append(state[:-1] + state[1:], 2.0 * state[-1]) for state in states]


class _FrictionLines:
    """What a fit leaves of the records' lines without friction, and what its own parameters would take of it, weighted.

    power: the sum of its squares; lines: the numbers in it, of which those are kept that friction moves.
    """

    def __init__(self, now: SpectralEstimate, level: _Level) -> None:
        """Keep what every trial shares; level: what is off the commands of the estimate."""
        fit, columns_of, rest = now.chosen.fit, list[ComplexArray](), list[ComplexArray]()
        self._spectra, self._weighted = now.spectra, list[ComplexArray]()
        # values that are known stay as they are
        self._free = freedom(fit.theta, fit.form, fit.stages)
        self.power, self.lines = 0.0, 0
        for k, (taken, residual) in enumerate(zip(now.spectra, now.residuals, strict=True)):
            weighted = residual.response * residual.weight[1:]
            here = residual.lines[1:] * residual.weight[1:]
            if level.coulomb > 0.0:
                here -= _lines([level.coulomb * level.states[k]], taken, weighted)[0]
            self.power += float(np.sum(here.view(np.float64) ** 2))
            self.lines += 2 * here.size
            last = _moving(weighted, taken.command[1:])
            self._weighted.append(-weighted[:last])
            slopes = log_slopes(fit, taken.frequency_hz[1 : last + 1])
            slopes = slopes @ self._free if fit.form.gain is not None else slopes
            columns_of.append(slopes * (weighted * taken.command[1:])[:last, None])
            rest.append(here[:last])
        self._rows = np.ascontiguousarray(np.concatenate(columns_of).T).view(np.float64)
        self._rest = np.concatenate(rest).view(np.float64)
        self._products, self._along = self._rows @ self._rows.T, self._rows @ self._rest

    def explained(self, pull: FloatArray) -> tuple[float, float, float, FloatArray]:
        """Return by how much the sum of squares falls with a friction's pull, the level that brings it (0, 0 where it
        would be negative), the power of its lines, and what of the fit's parameters makes up for one unit.
        """
        gain, level, powers, moves, _ = self._together([pull])
        if not level[0] > 0.0 or not powers[0] > 0.0:
            return 0.0, 0.0, 0.0, moves[:, 0]
        return gain, float(level[0]), float(powers[0]), moves[:, 0]

    def _together(self, pulls: Sequence[FloatArray]) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return by how much the sum of squares falls with k columns' pulls, the level of each, their powers,
        what of the fit's parameters makes up for one unit of each, (parameters, k), and how these then move.
        """
        last = np.vstack([*pulls, self._rest])
        beside = np.column_stack([self._rows @ last[:-1].T, self._along])
        weights, rest = eliminated(np.block([[self._products, beside], [beside.T, last @ last.T]]), beside.shape[0])
        moves = self._free @ weights
        powers, along = rest[:-1, :-1], rest[:-1, -1]
        level, remaining = eliminated(rest, len(pulls))
        gain = float(rest[-1, -1] - remaining[0, 0]) if np.any(along) else 0.0
        return gain, level[:, 0], powers.diagonal(), moves[:, :-1], moves[:, -1] - moves[:, :-1] @ level[:, 0]

    def pulls(self, ways: Iterable[Sequence[FloatArray]]) -> Iterator[FloatArray]:
        """Yield what one unit of friction of each way's states, (n,) along every record, makes of the position's lines,
        weighted; two ways together, since two transforms in one call take little longer than one.
        """
        further = iter(ways)
        while two := list(islice(further, 2)):
            parts = zip(zip(*two, strict=True), self._spectra, self._weighted, strict=True)
            for rows in zip(*(_lines(states, taken, weight) for states, taken, weight in parts), strict=True):
                yield (rows[0] if len(rows) == 1 else np.concatenate(rows)).view(np.float64)

    def other_laws(self, level: _Level, plain: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return deviations of the fit's parameters (k, parameters) and of the level (k,) by laws that the record does
        not exclude: one that acts otherwise between samples, and those of another level in either direction and of
        one that falls with the speed (Stribeck), by their evidence; plain: the level's own pull.
        """
        free, speed = level.free, [np.abs(np.gradient(path)) for path in level.paths]
        laws = ([np.abs(state) for state in free], level.held), (speed, level.held), (free, not level.held)
        *uneven, otherwise = self.pulls(_acting(*law) for law in laws)
        solved = [self._together([plain]), self._together([plain, *uneven])]
        for shape in (1, 2):
            shares = [(slow / max(float(np.sqrt(np.mean(slow**2))), 1e-300)) ** shape for slow in speed]
            falling = (
                _acting([z * np.exp(-share / fading**shape) for z, share in zip(free, shares, strict=True)], level.held)
                for fading in _FADING
            )
            tried = (self._together([plain, *uneven, pull]) for pull in self.pulls(falling))
            solved.append(max(tried, key=lambda law: law[0]))
        scores = np.array([float(np.log(self.lines)) * law[1].size for law in solved])
        scores -= 2.0 * np.array([gain for gain, *_ in solved])
        evidence = np.exp(-0.5 * (scores - scores.min()))
        reach = _BEYOND / Z95 * np.sqrt(np.append(evidence / evidence.sum(), 1.0))
        solved.append(self._together([otherwise]))
        moves = np.stack([law[4] - solved[0][4] for law in solved])
        levels = np.array([law[1][0] - solved[0][1][0] for law in solved])
        return reach[:, None] * moves, reach * levels


_UNMOVED = 1e-6
"""Share of what a command and a friction of even lines move, weighted, above the highest line that is looked at."""


def _moving(weighted: ComplexArray, command: ComplexArray) -> int:
    """Return the number of lines (m,) that hold all but a millionth of what friction, and the command, can move."""
    power = np.abs(weighted) ** 2
    sums = (np.cumsum(moved) for moved in (power, power * np.abs(command) ** 2))
    return 1 + max(int(np.searchsorted(moved, (1.0 - _UNMOVED) * moved[-1])) for moved in sums)


def _lines(rows: Sequence[FloatArray], taken: Spectrum, weight: ComplexArray) -> list[ComplexArray]:
    """Return the first lines but zero of each row (n,) at the record's command, times their weight (m,)."""
    lines = np.fft.rfft([row - row.mean() for row in (values[: taken.samples] for values in rows)])
    return [weight * (row[1 : weight.size + 1] * (1.0 / np.sqrt(taken.samples))) for row in lines]


def _level_without_model(bare: _Stage) -> _Level | None:
    """Return the level by which the records are most nearly linear, whatever their response: a start where friction
    eats so much of the command that every fit without it goes astray. None where no level makes them more so.
    """
    rate_hz = bare.now.spectra[0].rate_hz

    def misfit(at: Signals) -> float:
        local = [local_response(spectrum(*pair, rate_hz), HIGHEST * rate_hz) for pair in at]
        return sum(2.0 * float(pair.lines @ np.log(np.maximum(pair.noise, 1e-300))) for pair in local)

    best, least, paths = None, misfit(bare.signals) - _CERTAIN, bare.measured
    presliding = 1e-3 * max(float(np.std(path)) for path in paths)
    for coulomb in np.geomspace(0.03, 1.5, 16):
        level = _Level(float(coulomb), presliding, paths)
        here = misfit(level.off(bare.signals))
        if here < least:
            best, least = level, here
    return best
