"""Do the bands of whole curves hold for people who are not like the prior, at every frequency that is exported?

The people are people.py's, which uses nothing of the program. The curve is what `thresholds` would export of the
trials: the same points, means and ends.
Seen to fail with --narrow, which judges bands of half the width. One process takes about 0.5 s for each person.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tactuator.experiment.procedure.procedure import Playable
from tactuator.experiment.procedure.run_flags import unseen_notch
from tactuator.experiment.procedure.whole_curve import WholeCurve
from witnesses.curve.people import GUESS, POPULATIONS, Floats, People, Population

LEAST_COVERAGE, MOST_RMS_DB = 0.93, 1.8
_AT_ONCE = 20
_EARLY = 50


@dataclass
class Judged:
    """What was found of each person at each point, (people, points) each.

    error, inside: of the curve and its band. half_width: of the band, dB. early: error after _EARLY trials. trials: how
    many were put there. excluded: whether a notch is said to be excluded. missed: the curve is 10 dB too good there,
    within a notch.
    """

    error: Floats
    inside: NDArray[np.bool_]
    early: Floats
    trials: NDArray[np.intp]
    excluded: NDArray[np.bool_]
    missed: NDArray[np.bool_]
    half_width: Floats

    def row(self) -> dict[str, float]:
        """Return the figures of the table."""
        at = self.inside.mean(axis=0)
        return {
            "rms": _rms(self.error),
            "rms50": _rms(self.early),
            "coverage": float(at.mean()),
            "least": float(at.min()),
            "half_width": float(self.half_width.mean()),
            "fewest": int(self.trials.min()),
            "excluded": float(self.excluded.mean()),
            "missed": int(self.missed.sum()),
            "missed_though_excluded": int((self.missed & self.excluded).sum()),
        }


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2)))


def measured(rule: WholeCurve, people: People, narrow: bool) -> Judged:
    """Run the procedure on some people."""
    hertz, count = rule.places(Playable()), people.count
    runs, truth = rule.begin(GUESS, Playable(), count), people.threshold(hertz)
    belief = runs.belief
    played, early = np.zeros((count, hertz.size), dtype=np.intp), np.zeros_like(truth)
    for trial in range(rule.trials):
        point = np.argmin(np.abs(np.log(runs.frequency_hz[:, None] / hertz)), axis=1)
        runs.record(people.answers(hertz[point], runs.level_db_sl, trial))
        played[np.arange(count), point] += 1
        if trial + 1 == _EARLY:
            early = belief.curve(hertz).mean - truth
    belief.refine()
    read = belief.curve(hertz)
    low, high = ((read.mean + (0.5 if narrow else 1.0) * (end - read.mean)) for end in (read.low, read.high))
    middle = np.abs(np.log10(hertz) - np.log10(people.notch_hz)[:, None]) < 0.5 * people.notch_decades[:, None]
    missed = middle & (read.mean < truth - 10.0)
    inside = (low <= truth) & (truth <= high)
    excluded = unseen_notch(belief).trials == 0
    return Judged(read.mean - truth, inside, early, played, excluded, missed, (high - low) / 2.0)


def together(parts: list[Judged]) -> Judged:
    """Return the people of all parts as one."""
    return Judged(
        **{field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Judged)}
    )


def run(population: Population, number: int, count: int, seed: int, narrow: bool) -> dict[str, object]:
    """Run a population and return its figures."""
    rule, parts = WholeCurve(), []
    hertz, begun = rule.places(Playable()), time.process_time()
    for first in range(0, count, _AT_ONCE):
        size = min(_AT_ONCE, count - first)
        people = People(population, size, rule.trials, np.random.default_rng((seed, number, first)))
        parts.append(measured(rule, people, narrow))
    spent, judged = time.process_time() - begun, together(parts)
    figures: dict[str, object] = {"population": population.name, "people": count, **judged.row()}
    figures["ms_a_trial"] = 1e3 * spent / count / rule.trials
    figures["by_frequency"] = [
        (round(float(f), 2), round(_rms(judged.error[:, at]), 2), float(judged.inside[:, at].mean()))
        for at, f in enumerate(hertz)
    ]
    return figures


def main() -> int:
    """Print a table and return 0 where every claim holds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--people", type=int, default=200)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of populations, from 0")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--narrow", action="store_true")
    parser.add_argument("--json", action="store_true")
    given, holds = parser.parse_args(), True
    for number, population in enumerate(POPULATIONS):
        if given.only and number not in given.only:
            continue
        one = run(population, number, given.people, given.seed, given.narrow)
        if population.honest:
            holds &= one["least"] >= LEAST_COVERAGE  # type: ignore[operator]
        if number == 0:
            holds &= one["rms"] <= MOST_RMS_DB  # type: ignore[operator]
        by = one if given.json else {key: value for key, value in one.items() if key != "by_frequency"}
        print(json.dumps({k: round(v, 3) if isinstance(v, float) else v for k, v in by.items()}), flush=True)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
