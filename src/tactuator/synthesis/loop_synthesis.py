"""Loop synthesis: the controller that keeps every requirement on every plant, with the least mean |S| in dB.

Local optima in the parameters of `LoopStructure` are looked for from a few starts that invert the plant; where these
find one loop or none, from starts that cross over below a mode of the plant; where these find nothing either, steps
lead from one local optimum to the next (`problem.hops`). Where nothing is found, the diagnosis says which requirements
bind, and what has been tried instead.

Beyond the file's limits a loop keeps half of the display's resonance objective in reserve where that is possible
(max|T| <= 1.15 for an objective of 1.3), and must not be conditionally stable where the plant allows that: a command
at its limit is a loop of lower gain, and that has to be stable too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from operator import itemgetter

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.signals.loop import UnstableLoop
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.assessment import MemberAssessment, all_kept, assess
from tactuator.synthesis.limits import Limit, Task
from tactuator.synthesis.problem import (
    LoopProblem,
    Solution,
    hops,
    is_sound,
    polished,
    problem_of,
    solve,
    start_near,
    starts,
    starts_below_modes,
)

_FEASIBLE_DB, _NEARLY_DB = 1e-4, 0.1
_RESERVES_DB = (2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
"""What each round of settling keeps beyond the limits, dB: grids and assessment agree to about that."""
_SAME_DB, _AGAIN_DB, _ENOUGH = 0.02, 0.05, 3
_POLISHED = 2
"""Solutions that are polished: the first end 0.5 to 2 dB early around a resonator, the second best often ends ahead of
the best."""
_RESONANCE_SHARES = (0.5, 1.0)
"""Shares of what a resonance may take, with which the search is begun."""
Candidate = tuple[float, SampledSystem]
"""Mean |S| in dB of the worst plant, and the controller."""


def synthesise(task: Task, near: SampledSystem | None = None) -> Iterator[Candidate]:
    """Yield controllers for a family of plants, the best first: integrator, lead-lag, notch; at most three sections.

    near: the controller of a plant like this one, of the same structure: the local optimum next to it comes first.

    Each keeps every requirement in a full assessment. They are local optima, all different; where the starts lead to
    none, steps from one local optimum to the next are tried. Nothing is yielded where nothing is found.
    """
    if near is not None:
        problem = problem_of(task, _RESONANCE_SHARES[0])
        start = start_near(problem, near)
        solution = polished(problem, start) or solve(problem, start)
        settled = None if solution is None else _settle(problem, solution)
        if settled is not None:
            yield settled
    for begin, share in product((starts, starts_below_modes), _RESONANCE_SHARES):
        optima = _settled(problem_of(task, share), begin)
        best = next(optima, None)
        if best is not None:
            yield best
            yield from optima
            return
    yield from _hopped(task)


def is_possible(task: Task) -> bool:
    """Return whether `synthesise` finds anything from its starts."""
    problem = problem_of(task)
    return any(next(_settled(problem, begin), None) is not None for begin in (starts, starts_below_modes))


def judged(task: Task, feedback: SampledSystem) -> tuple[MemberAssessment, ...]:
    """Return the full assessment of a controller, or nothing if it is unstable on any plant."""
    try:
        return assess(feedback, task.family, task.rejection_band_hz)
    except UnstableLoop:
        return ()


def _settled(problem: LoopProblem, begin: Callable[[LoopProblem], Sequence[FloatArray]]) -> Iterator[Candidate]:
    """Yield local optima that keep every requirement, the best first to the tenths of a dB that settling changes; one
    optimum alone may be a poor one, and those below the modes are asked as well."""
    solutions = _solutions(problem, begin(problem))
    if sum(solution.excess_db <= _NEARLY_DB for solution in solutions) == 1:
        solutions += _solutions(problem, starts_below_modes(problem))
    solutions = sorted(solutions, key=lambda solution: solution.merit_db)
    solutions[:_POLISHED] = [polished(problem, solution.parameters) or solution for solution in solutions[:_POLISHED]]
    means: list[float] = []
    ready: list[Candidate] = []
    for solution in sorted(solutions, key=lambda solution: solution.mean_db):
        if solution.excess_db > _NEARLY_DB or any(abs(solution.mean_db - mean) < _SAME_DB for mean in means):
            continue
        while ready and ready[0][0] <= solution.mean_db:
            yield ready.pop(0)
        settled = _settle(problem, solution)
        if settled is not None:
            means.append(solution.mean_db)
            ready = sorted([*ready, settled], key=itemgetter(0))
    yield from ready


def _solutions(problem: LoopProblem, beginnings: Sequence[FloatArray]) -> list[Solution]:
    """Return the local solutions from `beginnings`: of three, if two keep the limits; of two that do and agree."""
    solutions: list[Solution] = []
    for start in beginnings:
        solution = solve(problem, start)
        if solution is not None:
            solutions = sorted([*solutions, solution], key=lambda known: known.merit_db)
        kept = [known for known in solutions if known.excess_db <= _NEARLY_DB]
        if len(kept) > 1 and (len(solutions) >= _ENOUGH or kept[1].merit_db < kept[0].merit_db + _AGAIN_DB):
            break
    return solutions


def _hopped(task: Task) -> Iterator[Candidate]:
    """Yield the first loop, if any, that steps from one local optimum to the next come upon."""
    problem = problem_of(task)
    for solution in hops(problem, starts(problem)):
        settled = _settle(problem, solution) if solution.excess_db <= _FEASIBLE_DB else None
        if settled is not None:
            yield settled
            return


def _settle(problem: LoopProblem, solution: Solution) -> Candidate | None:
    """Return the solution with what its grids overlooked taken into account: a full assessment finds every limit kept.

    After every round the frequencies at which |S| and |T| are greatest join the grid, and the problem is tightened so
    that each excess is that of the assessment, and a reserve more. A solution that keeps every limit at once goes
    through one round all the same, for what its grids exaggerated.
    """
    stays = np.array([not limit.relaxable for limit in problem.limits])
    settled: Candidate | None = None
    for reserve_db in _RESERVES_DB:
        feedback = problem.structure.system(solution.parameters)
        assessments = judged(problem.task, feedback)
        if not assessments:
            break
        if all_kept(assessments, problem.loop_limits):
            candidate = max(assessment.mean_rejection_db for assessment in assessments), feedback
            if settled is not None or reserve_db > _RESERVES_DB[0]:
                return candidate if settled is None else min(settled, candidate, key=itemgetter(0))
            settled = candidate
        peaks = [peak.frequency_hz for of in assessments for peak in (of.margins.sensitivity, of.margins.complementary)]
        before, problem = problem.tighten, LoopProblem(problem.task, problem.share, [*problem.peaks_hz, *peaks])
        seen = problem.at(solution.parameters).excess[: problem.tighten.size]
        by_load = {assessment.member.name: assessment for assessment in assessments}
        true = [limit.excess_db(by_load[limit.load or ""].figure(limit)) for limit in problem.limits]
        problem.tighten = np.where(stays, before + (np.array(true) > 0.0), np.array(true) - seen + reserve_db)
        again = polished(problem, solution.parameters) or solve(problem, solution.parameters)
        if again is None or again.excess_db > _NEARLY_DB:
            break
        solution = again
    return settled


_SLACKENED = (0.05, 0.5, 1.5)
"""dB by which a reported limit is loosened beyond the solver's answer: the first with which a design is found."""


def diagnosis(task: Task) -> list[str]:
    """Return short lines: the requirements that bind at the nearest miss, what it comes to, and which limits would do.

    A limit is proposed only if the design has been tried with it, and found a loop: first each that binds alone, all
    others kept, then each kind together (all of rejection, of hum), then all.
    """
    problem = problem_of(task)
    misses = _sound(problem, starts(problem)[:5])
    if not misses:
        asked = ", ".join(str(limit) for limit in task.limits)
        return [f"not even a stable loop is near them: {asked}", _HELP]
    worst = _worst_excess(problem, misses[0])
    most = max(worst.values())
    binding = [limit for limit in task.limits if worst[limit] > max(0.0, 0.9 * most)]
    binding = binding or [max(worst, key=worst.__getitem__)]
    kinds = [tuple(limit for limit in task.limits if limit.quantity == kind) for kind in ("|S|", "|T|")]
    begin = [miss.parameters for miss in misses[:2]]
    ways = (
        _possible(problem, [(limit,) for limit in binding], begin)
        or _possible(problem, [kind for kind in kinds if kind], begin)
        or _tried(task, {limit: excess for limit, excess in worst.items() if excess > 0.0})
    )
    wanted = ", ".join(str(limit) for limit in binding)
    reached = ", ".join(str(replace(limit, asked=limit.figure_at(worst[limit]))) for limit in binding)
    advice = [f"works, all others kept: {way}" for way in ways] or [_HELP]
    return [f"binding: {wanted}", f"nearest miss: {reached}", *advice]


_HELP = "try looser limits of more than one kind, a higher rate, less delay, or a stiffer load"


def _sound(problem: LoopProblem, starts: Sequence[FloatArray], relaxed: Sequence[Limit] = ()) -> list[Solution]:
    """Return the solutions from `starts` whose loops are stable, the nearest to the requirements first."""
    solutions = [solve(problem, start, relaxed) for start in starts]
    kept = [
        solution
        for solution in solutions
        if solution and is_sound(problem.structure.system(solution.parameters), problem.task)
    ]
    return sorted(kept, key=lambda solution: max(_worst_excess(problem, solution).values()))


def _worst_excess(problem: LoopProblem, solution: Solution) -> dict[Limit, float]:
    worst: dict[Limit, float] = {}
    for limit, excess in zip(problem.limits, problem.at(solution.parameters).excess.tolist(), strict=True):
        worst[limit.under(None)] = max(worst.get(limit.under(None), -np.inf), excess)
    return worst


def _possible(problem: LoopProblem, groups: Sequence[tuple[Limit, ...]], begin: Sequence[FloatArray]) -> list[str]:
    """Return, for each group that can give way alone, what it has to come to, and has been tried at."""
    ways: list[str] = []
    for group in groups:
        # two ways out are reported
        if len(ways) == 2:
            break
        kept = [solution for solution in _sound(problem, begin, group) if solution.excess_db <= _NEARLY_DB]
        if kept:
            worst = _worst_excess(problem, min(kept, key=lambda solution: solution.mean_db))
            ways += _tried(problem.task, {limit: worst[limit] for limit in group if worst[limit] > 0.0})
    return ways


def _tried(task: Task, excess_db: Mapping[Limit, float]) -> list[str]:
    """Return the limits that give way by `excess_db` and a little, as one phrase, if the design finds a
    loop with them.
    """
    if not excess_db:
        return []
    for more in _SLACKENED:
        looser = {limit: limit.loosened(excess + more) for limit, excess in excess_db.items()}
        if all(looser.values()) and is_possible(
            replace(task, limits=tuple(looser.get(limit) or limit for limit in task.limits))
        ):
            return [", ".join(sorted(f"{limit.name} {limit.asked:g}" for limit in looser.values() if limit))]
    return []


def require_consistent(channel: Channel, rate_hz: float, resonance_peak: float) -> None:
    """Refuse requirements that no loop of this kind can keep, whatever the plant."""
    if resonance_peak < 1.0:
        raise BadInput(f"{resonance_peak:g}", "1 or more, which max|T| has at rest", key="resonance_peak")
    asked = channel.feedback
    where = f"channel {channel.name!r}: feedback"
    if asked.sensitivity_peak is not None and asked.sensitivity_peak <= 1.0:
        raise BadInput(f"{where} sensitivity_peak is {asked.sensitivity_peak:g}", "above 1, which every loop passes")
    if asked.phase_margin_deg is not None and asked.phase_margin_deg >= 90.0:
        raise BadInput(f"{where} phase_margin_deg is {asked.phase_margin_deg:g}", "below 90 for a loop that rolls off")
    for name in ("mains_hz", "rejection_hz", "rejection_band_hz"):
        beyond = [f for f in getattr(asked, name) if f >= 0.45 * rate_hz]
        if beyond:
            raise BadInput(f"{where} {name} has {beyond[0]:g} Hz", f"below {0.45 * rate_hz:g} Hz at this rate")
    rejection = dict(zip(asked.rejection_hz, asked.rejection_max_db, strict=True))
    for frequency, limit in zip(asked.mains_hz, asked.mains_max_db, strict=True):
        both = 10.0 ** (limit / 20.0) + 10.0 ** (rejection.get(frequency, 40.0) / 20.0)
        if both < 1.0:
            raise BadInput(
                f"{where} asks |T| <= {limit:g} dB and |S| <= {rejection[frequency]:g} dB at {frequency:g} Hz, "
                "where S + T = 1",
                "limits whose ratios add up to one or more",
            )
