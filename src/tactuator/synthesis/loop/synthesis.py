"""Loop synthesis: the controller that keeps every requirement on every plant, with the least mean |S| in dB.

A loop is looked for in a fixed set of candidates (`candidates`), which depends on the plant alone: whatever keeps
tight limits is found again under looser ones. Local optima in the parameters of `LoopStructure` then improve on it,
from the candidates found and from a few starts around the plant's own poles. Where these starts find nothing, the
search goes on from the nearest misses, by steps that no limit changes (`hopping`).

Beyond the file's limits a loop keeps half of the display's resonance objective in reserve where that is possible
(max|T| <= 1.15 for an objective of 1.3), and must not be conditionally stable where the plant allows that: a command
at its limit is a loop of lower gain, and that has to be stable too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import merge
from itertools import chain, islice

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.requirements import FeedbackRequirements
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.family import Member
from tactuator.synthesis.loop.assessment import MemberAssessment, assess, figures, shortfalls
from tactuator.synthesis.loop.candidates import shapes
from tactuator.synthesis.loop.hopping import hops
from tactuator.synthesis.loop.problem import DB, DEGREES_PER_DB, LoopProblem
from tactuator.synthesis.loop.screening import Screen, Survivors
from tactuator.synthesis.loop.solution import Solution, is_sound, solve
from tactuator.synthesis.loop.starts import bounds, classical_starts
from tactuator.synthesis.loop.structure import LoopStructure

_FEASIBLE_DB = 1e-4
_RESERVES_DB = (2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
"""What each round of settling keeps beyond the limits, dB: grids and assessment agree to about that."""
_SAME_DB = 0.02
_RESONANCE_SHARES = (0.5, 1.0)
_WITNESSES = 3
_NEAREST = 3
Found = tuple[float, SampledSystem]
"""Mean |S| in dB of the worst plant, and the controller."""


@dataclass(frozen=True)
class Task:
    """Task of the synthesis: the family of plants, the requirements, the rate, the limit on max|T|."""

    family: Sequence[Member]
    requirements: FeedbackRequirements
    rate_hz: float
    resonance_peak: float
    screen: Screen = field(init=False, repr=False)

    def __post_init__(self) -> None:
        screen = Screen(self.family, self.requirements, self.rate_hz, self.resonance_peak)
        object.__setattr__(self, "screen", screen)

    def peak(self, share: float) -> float:
        """Return the limit on max|T| with 1 - share of the objective in reserve."""
        return 1.0 + share * (self.resonance_peak - 1.0)


def synthesise(task: Task) -> Iterator[Found]:
    """Yield controllers for a family of plants, the best first: integrator, lead-lag, notch; at most three sections.

    Each keeps every requirement in a full assessment. The first ones are local optima, all different; what the fixed
    set of candidates holds comes behind them. Nothing is yielded where nothing is found.
    """
    first = next(shapes(task.family[0].continuous, task.rate_hz))
    held = _witnesses(task, [first])
    found = _improved(task, [one for one, _ in held], classical=True)
    best = next(found, None)
    if best is None and not held:
        held = _hopped(task)
        found = _improved(task, [one for one, _ in held], classical=False)
        best = next(found, None)
    if best is None and not held:
        held = _witnesses(task, _later(task))
        found = _improved(task, [one for one, _ in held], classical=False)
        best = next(found, None)
    if best is None and not held:
        found = _improved(task, nearest(task), classical=False, shares=(1.0,))
        best = next(found, None)
    optima = found if best is None else chain([best], found)
    yield from merge(optima, sorted((kept for _, kept in held), key=_mean_db), key=_mean_db)
    if best is not None or held:
        yield from _all_candidates(task, shapes(task.family[0].continuous, task.rate_hz))


def is_possible(task: Task) -> bool:
    """Tell whether `synthesise` yields anything, from its quickest means alone: never true where it would not."""
    first = next(shapes(task.family[0].continuous, task.rate_hz))
    return bool(_witnesses(task, [first])) or any(_settled(task, 1.0, [], classical=True))


def nearest(task: Task) -> list[FloatArray]:
    """Return the candidates that miss the requirements by least, the nearest first: parameter vectors."""
    blocks = islice(shapes(task.family[0].continuous, task.rate_hz), 2)
    parts = [task.screen.nearest(block, _NEAREST) for block in blocks]
    parameters, miss = (np.concatenate(one) for one in zip(*parts, strict=True))
    order = np.argsort(miss, kind="stable")
    return [parameters[i] for i in order if np.isfinite(miss[i])][:_NEAREST]


def _later(task: Task) -> Iterator[FloatArray]:
    """Yield the blocks of candidates behind the first, each made when it is asked for."""
    return islice(shapes(task.family[0].continuous, task.rate_hz), 1, None)


def _witnesses(task: Task, blocks: Iterable[FloatArray]) -> list[tuple[FloatArray, Found]]:
    """Return the best few candidates, of different shapes, of the first block that holds any."""
    for block in blocks:
        survivors = task.screen.survivors(block)
        for share in _RESONANCE_SHARES:
            found: list[tuple[FloatArray, Found]] = []
            for parameters, one in _assessed(task, survivors, task.peak(share)):
                if all(not np.array_equal(parameters[1:], known[1:]) for known, _ in found):
                    found.append((parameters, one))
                if len(found) == _WITNESSES:
                    break
            if found:
                return found
    return []


def _all_candidates(task: Task, blocks: Iterable[FloatArray]) -> Iterator[Found]:
    """Yield every candidate that keeps all limits, for the case that no prefilter fits the best ones."""
    for block in blocks:
        for _, found in _assessed(task, task.screen.survivors(block), task.resonance_peak):
            yield found


def _assessed(task: Task, survivors: Survivors, resonance_peak: float) -> Iterator[tuple[FloatArray, Found]]:
    """Yield those of a block's survivors that a full assessment finds to keep everything."""
    structure = LoopStructure(task.rate_hz)
    for parameters in survivors.kept(resonance_peak):
        found = judged(task, structure.system(parameters), resonance_peak)
        if found is not None:
            yield parameters, found


def judged(task: Task, feedback: SampledSystem, resonance_peak: float) -> Found | None:
    """Return the controller with its mean |S|, or None if a full assessment finds anything amiss on any plant."""
    if not is_sound(feedback, task.family, task.screen.must_bear_less):
        return None
    assessments = assess(feedback, task.family, task.requirements)
    if shortfalls(assessments, task.requirements, resonance_peak):
        return None
    return _found(assessments, feedback)


def _found(assessments: Sequence[MemberAssessment], feedback: SampledSystem) -> Found:
    return max(one.mean_rejection_db for one in assessments), feedback


def _mean_db(found: Found) -> float:
    return found[0]


def _improved(
    task: Task, starts: Sequence[FloatArray], classical: bool, shares: Sequence[float] = _RESONANCE_SHARES
) -> Iterator[Found]:
    """Yield local optima that keep every requirement, all different, the best first."""
    for share in shares:
        found = False
        for one in _settled(task, share, starts, classical):
            found = True
            yield one
        if found:
            return


def _settled(task: Task, share: float, starts: Sequence[FloatArray], classical: bool) -> Iterator[Found]:
    """Yield local optima that keep every requirement, the best first.

    An optimum is settled only once it may be the next: settling makes its mean worse, if anything.
    """
    problem = LoopProblem(task.family, task.requirements, task.rate_hz, task.peak(share))
    limits = bounds(problem, task.family[0].continuous)
    begin = [*starts, *(classical_starts(problem, task.family[0], task.rate_hz) if classical else [])]
    solutions = [one for one in (solve(problem, start, limits) for start in begin) if one is not None]
    means: list[float] = []
    ready: list[Found] = []
    for solution in sorted(solutions, key=lambda one: one.mean_db):
        if solution.excess_db > _FEASIBLE_DB or any(abs(solution.mean_db - mean) < _SAME_DB for mean in means):
            continue
        while ready and ready[0][0] <= solution.mean_db:
            yield ready.pop(0)
        problem.tighten = np.zeros(len(problem.labels))
        settled = _settle(task, problem, solution)
        if settled is not None:
            means.append(solution.mean_db)
            ready = sorted([*ready, settled], key=_mean_db)
    yield from ready


def _hopped(task: Task) -> list[tuple[FloatArray, Found]]:
    """Return the first loop, if any, that steps from one local optimum to the next come upon."""
    problem = LoopProblem(task.family, task.requirements, task.rate_hz, task.resonance_peak)
    limits = bounds(problem, task.family[0].continuous)
    starts = [*classical_starts(problem, task.family[0], task.rate_hz), *nearest(task)]
    for solution in hops(problem, starts, limits, task.family, task.screen.must_bear_less):
        if solution.excess_db <= _FEASIBLE_DB:
            settled = _settle(task, problem, solution)
            problem.tighten = np.zeros(len(problem.labels))
            if settled is not None:
                return [(solution.parameters, settled)]
    return []


def _settle(task: Task, problem: LoopProblem, solution: Solution) -> Found | None:
    """Return the solution with what its grids overlooked taken into account: a full assessment finds no shortfall."""
    limits = bounds(problem, task.family[0].continuous)
    for reserve_db in _RESERVES_DB:
        feedback = problem.structure.system(solution.parameters)
        if not is_sound(feedback, task.family, task.screen.must_bear_less):
            return None
        assessments = assess(feedback, task.family, task.requirements)
        if not shortfalls(assessments, task.requirements, problem.resonance_peak):
            return _found(assessments, feedback)
        _tighten(problem, solution.parameters, assessments, reserve_db)
        again = solve(problem, solution.parameters, limits)
        if again is None or again.excess_db > _FEASIBLE_DB:
            return None
        solution = again
    return None


def _tighten(
    problem: LoopProblem, parameters: FloatArray, assessments: Sequence[MemberAssessment], reserve_db: float
) -> None:
    """Set the problem's `tighten` so that every excess is that of the assessment, and reserve_db more."""
    seen = problem.at(parameters).excess - problem.tighten
    true = {
        (name, one.member.name): _excess_db(name, asked, got)
        for one in assessments
        for name, asked, got, _ in figures(one, problem.requirements, problem.resonance_peak)
    }
    problem.tighten = np.array(
        [true.get(label, value) - value + reserve_db for label, value in zip(problem.labels, seen, strict=True)]
    )


def _excess_db(name: str, asked: float, got: float) -> float:
    if name == "phase_margin_deg":
        return (asked - got) / DEGREES_PER_DB
    return got - asked if "dB" in name else DB * float(np.log(got / asked))
