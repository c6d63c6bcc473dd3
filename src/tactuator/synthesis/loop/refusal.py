"""Reasons for which no loop satisfies a display file: the nearest miss, which requirements bind, and what has been
tried instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.synthesis.loop.problem import DB, DEGREES_PER_DB, LoopProblem
from tactuator.synthesis.loop.solution import Solution, is_sound, solve
from tactuator.synthesis.loop.starts import bounds, classical_starts
from tactuator.synthesis.loop.synthesis import Task, is_possible, nearest

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
