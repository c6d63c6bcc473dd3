"""Loop synthesis: the controller that keeps every requirement on every plant, with the least mean |S| in dB.

A loop is looked for in a fixed set of candidates (`candidates`), which depends on the plant alone: whatever keeps
tight limits is found again under looser ones. Local optima in the parameters of `LoopStructure` then improve on it,
from the candidates found and from a few starts around the plant's own poles. Where these starts find nothing, the
search goes on from the nearest misses, by steps that no limit changes (`problem.hops`). Where nothing is found, the
diagnosis says which requirements bind, and what has been tried instead.

Beyond the file's limits a loop keeps half of the display's resonance objective in reserve where that is possible
(max|T| <= 1.15 for an objective of 1.3), and must not be conditionally stable where the plant allows that: a command
at its limit is a loop of lower gain, and that has to be stable too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from heapq import merge
from itertools import chain, islice

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.model.requirements import FeedbackRequirements
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.assessment import MemberAssessment, assess, figures, shortfalls
from tactuator.synthesis.candidates import LoopStructure, shapes
from tactuator.synthesis.family import Member
from tactuator.synthesis.problem import (
    DB,
    DEGREES_PER_DB,
    LoopProblem,
    Solution,
    bounds,
    classical_starts,
    hops,
    is_sound,
    solve,
)
from tactuator.synthesis.screening import Screen, Survivors

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


_WAYS_MAX = 2
_SLACKENED = (0.05, 0.5)
"""dB by which a limit that is told gives way more than the solver says: the first at which a design is found."""


def diagnosis(task: Task) -> str:
    """Return one line: the requirements that bind at the nearest miss, what it comes to, and which limits would do.

    A limit is told only if the design has been tried with it, and found a loop: first each that binds alone, all
    others kept, then each kind together (all of rejection, of hum), then all.
    """
    problem = LoopProblem(task.family, task.requirements, task.rate_hz, task.resonance_peak)
    starts = [*nearest(task)[:2], *classical_starts(problem, task.family[0], task.rate_hz)[:3]]
    limits = bounds(problem, task.family[0].continuous)
    misses = _sound(task, problem, [solve(problem, start, limits) for start in starts])
    names = list(dict.fromkeys(name for name, _ in problem.labels))
    if not misses:
        asked = ", ".join(f"{name} {problem.asked(name):.4g}" for name in names)
        return f"nothing satisfies the requirements ({asked}), and no stable loop near them was found; {_HELP}"
    worst = _worst_excess(problem, misses[0].parameters)
    most = max(worst.values())
    binding = [name for name in names if worst[name] > max(0.0, 0.9 * most)] or [max(worst, key=worst.__getitem__)]
    begin = [one.parameters for one in misses[:2]]
    groups = [(name,) for name in binding]
    kinds = [tuple(name for name in names if name.startswith(kind)) for kind in ("|S|", "|T|")]
    ways = (
        _possible(task, problem, groups, begin)
        or _possible(task, problem, [kind for kind in kinds if kind], begin)
        or _tried(task, problem, {name: value for name, value in worst.items() if value > 0.0})
    )
    wanted = ", ".join(f"{name} {problem.asked(name):.4g}" for name in binding)
    got = ", ".join(f"{name} {_value(name, problem.asked(name), worst[name]):.4g}" for name in binding)
    advice = f"allowed, all others kept: {' or '.join(ways)}" if ways else _HELP
    return f"nothing satisfies the requirements; those that bind: {wanted}; nearest miss: {got}; {advice}"


_HELP = "allowed: looser limits of more than one kind, a faster rate, less delay, or a stiffer load"


def _sound(task: Task, problem: LoopProblem, solutions: Sequence[Solution | None]) -> list[Solution]:
    """Return the solutions whose loops are stable, the nearest to the requirements first."""
    kept = [
        one
        for one in solutions
        if one is not None
        and is_sound(problem.structure.system(one.parameters), task.family, task.screen.must_bear_less)
    ]
    return sorted(kept, key=lambda one: max(_worst_excess(problem, one.parameters).values()))


def _worst_excess(problem: LoopProblem, parameters: FloatArray) -> dict[str, float]:
    worst: dict[str, float] = {}
    for (name, _), value in zip(problem.labels, problem.at(parameters).excess.tolist(), strict=True):
        worst[name] = max(worst.get(name, -np.inf), value)
    return worst


def _possible(
    task: Task, problem: LoopProblem, groups: Sequence[tuple[str, ...]], begin: Sequence[FloatArray]
) -> list[str]:
    """Return, for each group that can give way alone, what it has to come to, and has been tried at."""
    limits = bounds(problem, task.family[0].continuous)
    ways: list[str] = []
    for group in groups:
        if len(ways) == _WAYS_MAX:
            break
        found = [solve(problem, start, limits, relaxed=frozenset(group)) for start in begin]
        kept = [one for one in _sound(task, problem, found) if one.excess_db <= 1e-3]
        if kept:
            worst = _worst_excess(problem, min(kept, key=lambda one: one.mean_db).parameters)
            ways += _tried(task, problem, {name: worst[name] for name in group if worst[name] > 0.0})
    return ways


def _tried(task: Task, problem: LoopProblem, excess_db: Mapping[str, float]) -> list[str]:
    """Return the limits that give way by `excess_db` and a little, as one phrase, if the design finds a
    loop with them.
    """
    if not excess_db:
        return []
    for more in _SLACKENED:
        values = {
            name: _rounded(name, _value(name, problem.asked(name), excess + more)) for name, excess in excess_db.items()
        }
        if all(_is_looser(name, value, problem.asked(name)) for name, value in values.items()) and is_possible(
            relaxed(task, values)
        ):
            return [", ".join(f"{name} {value:g}" for name, value in sorted(values.items()))]
    return []


def relaxed(task: Task, values: Mapping[str, float]) -> Task:
    """Return the task with other limits, by the names that `LoopProblem` labels them with."""
    asked = task.requirements
    mains = tuple(values.get(f"|T| dB at {f:g} Hz", v) for f, v in zip(asked.mains_hz, asked.mains_max_db, strict=True))
    rejection = tuple(
        values.get(f"|S| dB at {f:g} Hz", v) for f, v in zip(asked.rejection_hz, asked.rejection_max_db, strict=True)
    )
    looser = replace(
        asked,
        mains_max_db=mains,
        rejection_max_db=rejection,
        sensitivity_peak=values.get("sensitivity_peak", asked.sensitivity_peak),
        phase_margin_deg=values.get("phase_margin_deg", asked.phase_margin_deg),
        command_noise_gain_max=values.get("command_noise_gain_max", asked.command_noise_gain_max),
    )
    peak = values.get("resonance_peak", task.resonance_peak)
    return Task(task.family, looser, task.rate_hz, peak)


def _is_looser(name: str, value: float, asked: float) -> bool:
    if name == "phase_margin_deg":
        return 0.0 < value < asked
    return value > asked


def _rounded(name: str, value: float) -> float:
    """Return the value with four digits, rounded to the looser side."""
    if value == 0.0:
        return 0.0
    step = 10.0 ** (np.floor(np.log10(abs(value))) - 3.0)
    whole = np.floor(value / step) if name == "phase_margin_deg" else np.ceil(value / step)
    return float(f"{whole * step:.4g}")


def _value(name: str, asked: float, excess_db: float) -> float:
    """Return the value that is got where `asked` is exceeded by `excess_db` (see `LoopProblem`)."""
    if name == "phase_margin_deg":
        return asked - excess_db * DEGREES_PER_DB
    return asked + excess_db if "dB" in name else asked * float(np.exp(excess_db / DB))


def require_consistent(channel: Channel, rate_hz: float) -> None:
    """Refuse requirements that no loop of this kind can keep, whatever the plant."""
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
