"""Why no loop satisfies a display file: which requirements bind, and what would be possible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from tactuator.display.description import Channel
from tactuator.errors import BadInput
from tactuator.synthesis.family import Member
from tactuator.synthesis.loop.problem import DB, DEGREES_PER_DB, LoopProblem
from tactuator.synthesis.loop.solution import Solution, is_sound, solve

Array = NDArray[np.float64]


def diagnosis(
    problem: LoopProblem,
    nearest: Sequence[Solution],
    starts: Sequence[Array],
    limits: optimize.Bounds,
    family: Sequence[Member],
) -> str:
    """One line: the requirements that bind at the best compromise, how far each would have to give way alone, or else
    each kind together (all of rejection, of hum, of margins)."""
    names = list(dict.fromkeys(name for name, _ in problem.labels))
    binding = _binding(problem, nearest[0]) if nearest else names
    begin = [one.parameters for one in nearest] or list(starts)
    groups = [frozenset({name}) for name in binding]
    kinds = [frozenset(name for name in names if name.startswith(kind)) for kind in ("|S|", "|T|")]
    possible = _possible(problem, groups, begin, limits, family) or _possible(problem, kinds, begin, limits, family)
    wanted = ", ".join(f"{name} {problem.asked(name):.4g}" for name in binding)
    ways = " or ".join(possible) or "nothing near; more than one kind of requirement has to give way"
    return f"nothing satisfies the requirements; those that bind: {wanted}; allowed, all others kept: {ways}"


def _binding(problem: LoopProblem, nearest: Solution) -> list[str]:
    worst = _worst_excess(problem, nearest.parameters)
    return [name for name, value in worst.items() if value > 0.9 * nearest.excess_db]


def _worst_excess(problem: LoopProblem, parameters: Array) -> dict[str, float]:
    worst: dict[str, float] = {}
    for (name, _), value in zip(problem.labels, problem.at(parameters).excess.tolist(), strict=True):
        worst[name] = max(worst.get(name, -np.inf), value)
    return worst


def _possible(
    problem: LoopProblem,
    groups: Sequence[frozenset[str]],
    begin: Sequence[Array],
    limits: optimize.Bounds,
    family: Sequence[Member],
) -> list[str]:
    """For each group that can give way alone: what it would come to."""
    ways = []
    for group in groups:
        if not group:
            continue
        found = (solve(problem, start, limits, relaxed=group) for start in begin)
        kept = [one for one in found if one and one.excess_db <= 1e-3 and is_sound(problem, one.parameters, family)]
        if kept:
            worst = _worst_excess(problem, min(kept, key=lambda one: one.mean_db).parameters)
            values = [f"{name} {_value(name, problem.asked(name), worst[name]):.4g}" for name in sorted(group)]
            ways.append(", ".join(values))
    return ways


def _value(name: str, asked: float, excess_db: float) -> float:
    """What is got where `asked` is exceeded by `excess_db` (see `LoopProblem`)."""
    if name == "phase_margin_deg":
        return asked - excess_db * DEGREES_PER_DB
    return asked + excess_db if "dB" in name else asked * float(np.exp(excess_db / DB))


def require_consistent(channel: Channel, rate_hz: float) -> None:
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
