"""Loop synthesis: the controller that keeps every requirement on every plant, with the least mean |S| in dB.

Sequential quadratic programming (SLSQP) on the parameters of `LoopStructure`, from a few fixed starts around the
plant's own poles. Two further unknowns make the problem smooth and always solvable: the worst member's mean |S|, and
one common excess that is punished so hard that it is zero wherever that is possible.

Beyond the file's limits a loop keeps half of the display's resonance objective in reserve (max|T| <= 1.15 for an
objective of 1.3), and must not be conditionally stable: a command at its limit is a loop of lower gain, and that has
to be stable too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from tactuator.design.assessment import MemberAssessment, assess, figures, shortfalls
from tactuator.design.family import Member
from tactuator.design.loop_problem import DB, DEGREES_PER_DB, LoopProblem, Point
from tactuator.design.loop_structure import COUNT, FREQUENCIES, POLE_DAMPINGS, ZERO_DAMPINGS
from tactuator.errors import BadInput
from tactuator.loop.feedback import FeedbackLoop
from tactuator.plant.display import Channel
from tactuator.plant.requirements import FeedbackRequirements
from tactuator.signals.systems import SampledSystem

Array = NDArray[np.float64]

_PUNISHMENT = 30.0
_FEASIBLE_DB = 1e-4
_RESERVE_DB = 2e-4
_RESONANCE_SHARE = 0.5
_SLOWEST_ZEROS_HZ = 1.0
_ZERO_DAMPING = (0.7, 4.0)
_POLE_DAMPING = (0.9, 2.0)
_STARTS = ((1.0, 1.0), (2.0, 1.0), (3.0, 1.0), (1.5, 0.5), (2.0, 2.0))
"""(crossover over the rejection band's upper edge, corner of the lead over the crossover)."""


@dataclass(frozen=True)
class _Solution:
    parameters: Array
    mean_db: float
    excess_db: float


def synthesise(channel: Channel, family: Sequence[Member], rate_hz: float, resonance_peak: float) -> SampledSystem:
    """The controller for a family of plants: integrator, lead-lag, notch; at most three sections.

    Raises BadInput if the requirements contradict each other or if nothing satisfies them: the message names those
    that bind, and what would be possible.
    """
    requirements = channel.feedback
    _require_consistent(channel, rate_hz)
    problem = LoopProblem(family, requirements, rate_hz, 1.0 + _RESONANCE_SHARE * (resonance_peak - 1.0))
    found = (_solve(problem, start) for start in _starts(problem, family, requirements, rate_hz))
    solutions = [one for one in found if one is not None and _is_sound(problem, one.parameters, family)]
    kept = sorted((one for one in solutions if one.excess_db <= _FEASIBLE_DB), key=lambda one: one.mean_db)
    for solution in kept:
        settled = _settle(problem, solution, family, requirements)
        if settled is not None:
            return settled
    raise BadInput(f"channel {channel.name!r}: " + _diagnosis(problem, solutions, family))


def _solve(problem: LoopProblem, start: Array, relaxed: str | None = None) -> _Solution | None:
    """One local solution; with `relaxed`, that requirement's own excess is minimised and all others are kept."""
    free = np.array([label == relaxed for label, _ in problem.labels])
    cache: dict[bytes, Point] = {}

    def at(unknowns: Array) -> Point:
        key = unknowns[:COUNT].tobytes()
        if key not in cache:
            cache.clear()
            cache[key] = problem.at(unknowns[:COUNT])
        return cache[key]

    def aims(point: Point) -> tuple[Array, Array]:
        return (point.excess[free], point.excess_slope[free]) if relaxed else (point.mean_db, point.mean_slope)

    def rooms(unknowns: Array) -> Array:
        point = at(unknowns)
        return np.concatenate([unknowns[COUNT] - aims(point)[0], unknowns[COUNT + 1] - point.excess[~free]])

    def slopes(unknowns: Array) -> Array:
        point = at(unknowns)
        aim = aims(point)[1]
        rows = np.zeros((aim.shape[0] + int(np.sum(~free)), COUNT + 2))
        rows[: aim.shape[0], :COUNT], rows[: aim.shape[0], COUNT] = -aim, 1.0
        rows[aim.shape[0] :, :COUNT], rows[aim.shape[0] :, COUNT + 1] = -point.excess_slope[~free], 1.0
        return rows

    cost = np.append(np.zeros(COUNT), [1.0, _PUNISHMENT])
    with np.errstate(all="ignore"):
        point = problem.at(start)
        first = [float(np.max(aims(point)[0])), max(0.0, float(np.max(point.excess[~free], initial=0.0)))]
        result = optimize.minimize(
            lambda unknowns: float(cost @ unknowns),
            np.append(start, first),
            jac=lambda unknowns: cost,
            bounds=_bounds(problem, start),
            constraints=[{"type": "ineq", "fun": rooms, "jac": slopes}],
            method="SLSQP",
            options={"maxiter": 120, "ftol": 1e-5},
        )
    if not np.all(np.isfinite(result.x)):
        return None
    return _Solution(result.x[:COUNT], float(result.x[COUNT]), float(result.x[COUNT + 1]))


def _bounds(problem: LoopProblem, start: Array) -> optimize.Bounds:
    """Zeros of the integrator's section from 1 Hz, everything else from the rejection band's upper edge, up to just
    below half the rate; zeros damped by 0.7 or more, poles by 0.9: nothing in the controller rings, and T stays smooth
    enough for a prefilter of few poles."""
    to_radians = 2.0 * np.pi / problem.structure.rate_hz
    low, high = np.full(COUNT + 2, -np.inf), np.full(COUNT + 2, np.inf)
    low[0], high[0] = start[0] - 5.0, start[0] + 5.0
    fast = [*FREQUENCIES, 3]
    low[fast] = np.log(to_radians * problem.requirements.rejection_band_hz[1])
    low[1] = np.log(to_radians * _SLOWEST_ZEROS_HZ)
    high[fast] = np.log(2.0 * np.pi * 0.45)
    for places, (least, most) in ((ZERO_DAMPINGS, _ZERO_DAMPING), (POLE_DAMPINGS, _POLE_DAMPING)):
        low[list(places)], high[list(places)] = np.log(least), np.log(most)
    low[COUNT + 1] = 0.0
    return optimize.Bounds(low, high)


def _starts(
    problem: LoopProblem, family: Sequence[Member], requirements: FeedbackRequirements, rate_hz: float
) -> list[Array]:
    """Zeros on the plant's two slowest poles, and several crossovers."""
    plant = family[0]
    poles = plant.continuous.poles[np.argsort(np.abs(plant.continuous.poles))][:2]
    own = float(np.sqrt(np.abs(np.prod(poles)))) if poles.size == 2 else 2.0 * np.pi * 10.0
    damping = float(np.clip(np.abs(np.sum(poles).real) / 2.0 / own, 0.5, 3.9)) if poles.size == 2 else 1.0
    found = []
    for times, corner in _STARTS:
        crossover = min(times * requirements.rejection_band_hz[1], 0.05 * rate_hz)
        omega = 2.0 * np.pi * crossover / rate_hz
        lead, notch = 2.0 * omega * corner, 4.0 * omega
        parameters = np.log(
            [1.0, own / rate_hz, damping, 2.0 * omega, lead, 1.0, 2.0 * lead, 1.0, notch, 0.8, notch, 1.0]
        )
        unit = problem.structure.system(parameters).response(crossover) * plant.sampled.response(crossover)
        parameters[0] -= np.log(np.abs(unit))
        found.append(parameters)
    return found


def _is_sound(problem: LoopProblem, parameters: Array, family: Sequence[Member]) -> bool:
    """Stable on every plant, and at lower gains too."""
    feedback = problem.structure.system(parameters)
    for member in family:
        for factor in (1.0, 0.5, 0.2, 0.05):
            weaker = SampledSystem(feedback.zeros, feedback.poles, feedback.gain * factor, feedback.rate_hz)
            if not FeedbackLoop(weaker, member.sampled).is_stable:
                return False
    return True


def _settle(
    problem: LoopProblem, solution: _Solution, family: Sequence[Member], requirements: FeedbackRequirements
) -> SampledSystem | None:
    """The solution with what its grids overlooked taken into account: a full assessment finds no shortfall."""
    for _ in range(4):
        feedback = problem.structure.system(solution.parameters)
        assessments = assess(feedback, family, requirements)
        if not shortfalls(assessments, requirements):
            return feedback
        _tighten(problem, solution.parameters, assessments, requirements)
        again = _solve(problem, solution.parameters)
        if again is None or again.excess_db > _FEASIBLE_DB or not _is_sound(problem, again.parameters, family):
            return None
        solution = again
    return None


def _tighten(
    problem: LoopProblem, parameters: Array, assessments: Sequence[MemberAssessment], requirements: FeedbackRequirements
) -> None:
    """Set the problem's `tighten` so that every excess is that of the assessment, and a trifle more."""
    seen = problem.at(parameters).excess - problem.tighten
    true = {
        (name, one.member.name): _excess_db(name, asked, got)
        for one in assessments
        for name, asked, got, _ in figures(one, requirements)
    }
    problem.tighten = np.array(
        [true.get(label, value) - value + _RESERVE_DB for label, value in zip(problem.labels, seen, strict=True)]
    )


def _excess_db(name: str, asked: float, got: float) -> float:
    if name == "phase_margin_deg":
        return (asked - got) / DEGREES_PER_DB
    return got - asked if "dB" in name else DB * float(np.log(got / asked))


def _value(name: str, asked: float, excess_db: float) -> float:
    """The inverse of `_excess_db`."""
    if name == "phase_margin_deg":
        return asked - excess_db * DEGREES_PER_DB
    return asked + excess_db if "dB" in name else asked * float(np.exp(excess_db / DB))


def _diagnosis(problem: LoopProblem, solutions: Sequence[_Solution], family: Sequence[Member]) -> str:
    """Which requirements bind at the best compromise, and how far each would have to give way alone."""
    if not solutions:
        return "no stable loop was found for the requirements; allowed: requirements that some loop keeps"
    best = min(solutions, key=lambda one: one.excess_db)
    excess = problem.at(best.parameters).excess
    binding = {label for (label, _), value in zip(problem.labels, excess, strict=True) if value > 0.5 * best.excess_db}
    alone = []
    for name in sorted(binding):
        found = [_solve(problem, one.parameters, relaxed=name) for one in solutions[:3]]
        good = [
            one.mean_db
            for one in found
            if one is not None and one.excess_db <= 1e-3 and _is_sound(problem, one.parameters, family)
        ]
        if good:
            alone.append(f"{name} {_value(name, problem.asked(name), min(good)):.4g}")
    possible = " or ".join(alone) or "nothing, by giving up one requirement alone"
    wanted = ", ".join(f"{name} {problem.asked(name):.4g}" for name in sorted(binding))
    return f"nothing satisfies the requirements; those that bind: {wanted}; allowed, all others kept: {possible}"


def _require_consistent(channel: Channel, rate_hz: float) -> None:
    """Refuse requirements that no loop of this kind can keep, whatever the plant."""
    asked = channel.feedback
    where = f"channel {channel.name!r}: feedback"
    if asked.sensitivity_peak is not None and asked.sensitivity_peak <= 1.0:
        raise BadInput(
            f"{where} sensitivity_peak is {asked.sensitivity_peak:g}; allowed: above 1, which every loop passes"
        )
    if asked.phase_margin_deg is not None and asked.phase_margin_deg >= 90.0:
        raise BadInput(
            f"{where} phase_margin_deg is {asked.phase_margin_deg:g}; allowed: below 90 for a loop that rolls off"
        )
    for name in ("mains_hz", "rejection_hz", "rejection_band_hz"):
        beyond = [f for f in getattr(asked, name) if f >= 0.45 * rate_hz]
        if beyond:
            raise BadInput(f"{where} {name} has {beyond[0]:g} Hz; allowed: below {0.45 * rate_hz:g} Hz at this rate")
    rejection = dict(zip(asked.rejection_hz, asked.rejection_max_db, strict=True))
    for frequency, limit in zip(asked.mains_hz, asked.mains_max_db, strict=True):
        both = 10.0 ** (limit / 20.0) + 10.0 ** (rejection.get(frequency, 40.0) / 20.0)
        if both < 1.0:
            raise BadInput(
                f"{where} asks |T| <= {limit:g} dB and |S| <= {rejection[frequency]:g} dB at {frequency:g} Hz, "
                "where S + T = 1; allowed: limits whose ratios add up to one or more"
            )
