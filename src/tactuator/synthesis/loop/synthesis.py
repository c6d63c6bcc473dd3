"""Loop synthesis: the controller that keeps every requirement on every plant, with the least mean |S| in dB.

Local optima in the parameters of `LoopStructure`, from a few fixed starts around the plant's own poles.

Beyond the file's limits a loop keeps half of the display's resonance objective in reserve where that is possible
(max|T| <= 1.15 for an objective of 1.3), and must not be conditionally stable: a command at its limit is a loop of
lower gain, and that has to be stable too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from tactuator.display.description import Channel
from tactuator.errors import NoDesign
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis.family import Member
from tactuator.synthesis.loop.assessment import MemberAssessment, assess, figures, shortfalls
from tactuator.synthesis.loop.problem import DB, DEGREES_PER_DB, LoopProblem
from tactuator.synthesis.loop.refusal import diagnosis, require_consistent
from tactuator.synthesis.loop.solution import Solution, is_sound, solve
from tactuator.synthesis.loop.structure import COUNT, FREQUENCIES, POLE_DAMPINGS, ZERO_DAMPINGS

Array = NDArray[np.float64]

_FEASIBLE_DB = 1e-4
_RESERVE_DB = 2e-4
_SAME_DB = 0.02
_RESONANCE_SHARES = (0.5, 1.0)
_SLOWEST_ZEROS_HZ = 1.0
_ZERO_DAMPING = (0.7, 4.0)
_POLE_DAMPING = (0.9, 2.0)
_STARTS = ((1.0, 1.0), (2.0, 1.0), (3.0, 1.0), (1.5, 0.5), (2.0, 2.0))
"""(crossover over the rejection band's upper edge, corner of the lead over the crossover)."""


def synthesise(
    channel: Channel, family: Sequence[Member], rate_hz: float, resonance_peak: float
) -> Iterator[tuple[float, SampledSystem]]:
    """Controllers for a family of plants, the best first: integrator, lead-lag, notch; at most three sections.

    Each keeps every requirement, and comes with the worst plant's mean |S| in dB; they are local optima, all different.
    Raises NoDesign if
    the requirements contradict each other or if nothing satisfies them: the message names those that bind, and what
    would be possible.
    """
    require_consistent(channel, rate_hz)
    for share in _RESONANCE_SHARES:
        problem = LoopProblem(family, channel.feedback, rate_hz, 1.0 + share * (resonance_peak - 1.0))
        limits = _bounds(problem, family[0].continuous)
        starts = _starts(problem, family[0], rate_hz)
        found = (solve(problem, start, limits) for start in starts)
        solutions = [one for one in found if one is not None and is_sound(problem, one.parameters, family)]
        kept = sorted((one for one in solutions if one.excess_db <= _FEASIBLE_DB), key=lambda one: one.mean_db)
        means: list[float] = []
        for solution in kept:
            if means and solution.mean_db - means[-1] < _SAME_DB:
                continue
            settled = _settle(problem, solution, limits, family)
            if settled is not None:
                means.append(solution.mean_db)
                yield solution.mean_db, settled
        if means:
            return
    nearest = sorted(solutions, key=lambda one: one.excess_db)[:3]
    raise NoDesign(f"channel {channel.name!r}: " + diagnosis(problem, nearest, starts, limits, family))


def _bounds(problem: LoopProblem, plant: ContinuousSystem) -> optimize.Bounds:
    """Zeros of the integrator's section from 1 Hz, everything else from the rejection band's upper edge, up to just
    below half the rate; zeros damped by 0.7 or more, poles by 0.9: nothing in the controller rings, and T stays smooth
    enough for a prefilter of few poles. Zeros may be as soft as the plant's own resonances, to cancel them."""
    to_radians = 2.0 * np.pi / problem.structure.rate_hz
    low, high = np.full(COUNT + 2, -np.inf), np.full(COUNT + 2, np.inf)
    fast = [*FREQUENCIES, 3]
    low[fast] = np.log(to_radians * problem.requirements.rejection_band_hz[1])
    low[1] = np.log(to_radians * _SLOWEST_ZEROS_HZ)
    high[fast] = np.log(2.0 * np.pi * 0.45)
    softest = min(_ZERO_DAMPING[0], 0.6 * _resonance(plant)[1])
    low[list(ZERO_DAMPINGS)], high[list(ZERO_DAMPINGS)] = np.log(softest), np.log(_ZERO_DAMPING[1])
    low[list(POLE_DAMPINGS)], high[list(POLE_DAMPINGS)] = np.log(_POLE_DAMPING[0]), np.log(_POLE_DAMPING[1])
    low[COUNT + 1] = 0.0
    return optimize.Bounds(low, high)


def _resonance(plant: ContinuousSystem) -> tuple[float, float]:
    """Natural frequency (rad/s) and damping of the plant's softest pole pair; (0, 1) if it has none."""
    pairs = plant.poles[plant.poles.imag > 0.0]
    if pairs.size == 0:
        return 0.0, 1.0
    damping = -pairs.real / np.abs(pairs)
    softest = int(np.argmin(damping))
    return float(np.abs(pairs[softest])), float(damping[softest])


def _starts(problem: LoopProblem, nominal: Member, rate_hz: float) -> list[Array]:
    """Zeros on the plant's two slowest poles, the notch on its resonance, and several crossovers."""
    poles = nominal.continuous.poles[np.argsort(np.abs(nominal.continuous.poles))][:2]
    own = float(np.sqrt(np.abs(np.prod(poles)))) if poles.size == 2 else 2.0 * np.pi * 10.0
    damping = float(np.clip(np.abs(np.sum(poles).real) / 2.0 / own, 0.01, 3.9)) if poles.size == 2 else 1.0
    resonance, softness = _resonance(nominal.continuous)
    upper = problem.requirements.rejection_band_hz[1]
    found = []
    for times, corner in _STARTS:
        crossover = min(times * upper, 0.05 * rate_hz)
        omega = 2.0 * np.pi * crossover / rate_hz
        lead = 2.0 * omega * corner
        notch, depth = (resonance / rate_hz, softness) if resonance > 1.5 * own else (4.0 * omega, 0.8)
        values = [1.0, own / rate_hz, damping, 2.0 * omega, lead, 1.0, 2.0 * lead, 1.0, notch, depth, notch, 1.0]
        parameters = np.log(values)
        unit = problem.structure.system(parameters).response(crossover) * nominal.sampled.response(crossover)
        parameters[0] -= np.log(np.abs(unit))
        found.append(parameters)
    return found


def _settle(
    problem: LoopProblem, solution: Solution, limits: optimize.Bounds, family: Sequence[Member]
) -> SampledSystem | None:
    """The solution with what its grids overlooked taken into account: a full assessment finds no shortfall."""
    for _ in range(4):
        feedback = problem.structure.system(solution.parameters)
        assessments = assess(feedback, family, problem.requirements)
        if not shortfalls(assessments, problem.requirements):
            return feedback
        _tighten(problem, solution.parameters, assessments)
        again = solve(problem, solution.parameters, limits)
        if again is None or again.excess_db > _FEASIBLE_DB or not is_sound(problem, again.parameters, family):
            return None
        solution = again
    return None


def _tighten(problem: LoopProblem, parameters: Array, assessments: Sequence[MemberAssessment]) -> None:
    """Set the problem's `tighten` so that every excess is that of the assessment, and a trifle more."""
    seen = problem.at(parameters).excess - problem.tighten
    true = {
        (name, one.member.name): _excess_db(name, asked, got)
        for one in assessments
        for name, asked, got, _ in figures(one, problem.requirements)
    }
    problem.tighten = np.array(
        [true.get(label, value) - value + _RESERVE_DB for label, value in zip(problem.labels, seen, strict=True)]
    )


def _excess_db(name: str, asked: float, got: float) -> float:
    if name == "phase_margin_deg":
        return (asked - got) / DEGREES_PER_DB
    return got - asked if "dB" in name else DB * float(np.log(got / asked))
