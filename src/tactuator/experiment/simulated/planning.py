"""Planning a study of thresholds: how many subjects it takes, how many trials each of them does, and the power.

The error of a threshold is that of the procedure, from simulated runs. Of T trials that a person has time for, each of
the conditions gets r runs, so that a person's threshold has the variance s^2 + e^2 / r about the group's mean: s is the
spread between people, e the error of a run. Two groups of n people are compared by a t test with 2 n - 2 degrees of
freedom and the noncentrality d / sqrt(2 v / n); one group with a norm by n - 1 and d / sqrt(v / n); the same people
under two conditions by n - 1 and d / sqrt(2 v / n), where s is then the spread of a person from one occasion to the
next. The power is the noncentral t distribution's mass beyond the critical values (Cohen 1988, chapter 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import scipy
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.result.group_level import group_level
from tactuator.experiment.result.thresholds import MeasuredThreshold
from tactuator.parameters import Number, Positive, Whole, table

Design = Literal["between", "within", "norm"]
_MOST_SUBJECTS = 10_000
_CERTAIN = 30.0
"""Noncentrality from which the power is 1 in all digits."""
_FORMS: dict[str, tuple[int, float]] = {"between": (2, 2.0), "within": (1, 2.0), "norm": (1, 1.0)}
"""Groups of people, and variances in the difference of means, of each design."""


@table("study")
class PlannedStudy:
    """What a study looks for, and the time that it has.

    design: two groups, one group under two conditions, or one group against a norm.
    """

    effect_db: Annotated[Positive, Field(description="difference to be found")]
    spread_db: Annotated[Positive, Field(description="standard deviation between people, or (within) occasions")]
    design: Annotated[Design, Field(description="between, within or norm")] = "between"
    minutes: Annotated[Positive, Field(description="of a person at the rig, breaks left out")] = 60.0
    trial_s: Annotated[Positive, Field(description="from trial to trial, s")] = 4.3
    conditions: Annotated[Whole, Field(ge=1, description="frequencies times fingers")] = 8
    alpha: Annotated[Number, Field(gt=0.0, lt=0.5, description="false alarms allowed, both sides together")] = 0.05
    comparisons: Annotated[Whole, Field(ge=1, description="tests that share alpha (Bonferroni)")] = 1
    power: Annotated[Number, Field(gt=0.05, lt=0.9999, description="probability of finding the effect")] = 0.8

    def variance(self, error_db: float, repeats: int) -> float:
        """Return the variance of a person's threshold from runs with that error."""
        return self.spread_db**2 + error_db**2 / repeats

    def power_of(self, subjects: int | FloatArray, variance: float) -> FloatArray:
        """Return the power with so many subjects in each group, two or more."""
        groups, variances = _FORMS[self.design]
        count = np.asarray(subjects, dtype=np.float64)
        freedom = groups * (count - 1.0)
        shift = self.effect_db / np.sqrt(variances * variance / count)
        critical = scipy.stats.t.isf(0.5 * self.alpha / self.comparisons, freedom)
        below = np.nan_to_num(scipy.stats.nct.cdf(-critical, freedom, shift))  # undefined where it underflows
        return np.asarray(np.where(shift > _CERTAIN, 1.0, scipy.stats.nct.sf(critical, freedom, shift) + below))


@dataclass(frozen=True)
class StudyPlan:
    """What a study takes. subjects: in each group, and altogether. repeats: runs of each condition and person. trials,
    minutes: of a person. error_db: of a person's threshold, of these runs. power: with that many subjects. curve: power
    against subjects in each group.
    """

    subjects: int
    subjects_in_all: int
    repeats: int
    trials: int
    minutes: float
    error_db: float
    power: float
    curve: tuple[tuple[int, float], ...]


def plan_study(study: PlannedStudy, error_db: float, run_trials: float, whole_curve: bool = False) -> StudyPlan:
    """Return what the study takes with a procedure whose runs have so many trials and that error.

    whole_curve: a run measures all frequencies. Raises BadInput where a person's time does not hold one run of every
    condition, or no number of subjects reaches the power.
    """
    occasions = 2 if study.design == "within" else 1
    runs = occasions * (1 if whole_curve else study.conditions)
    needed = runs * run_trials * study.trial_s / 60.0
    repeats = int(study.minutes / needed + 1e-9)
    if repeats < 1:
        raise BadInput(
            f"{runs} runs of {run_trials:.0f} trials take {needed:.0f} min",
            f"{study.minutes:g} min or less: fewer frequencies, a shorter procedure, or more visits",
        )
    variance = study.variance(error_db, repeats)
    low, high = 1, _MOST_SUBJECTS
    if study.power_of(high, variance) < study.power:
        raise BadInput(f"an effect of {study.effect_db:g} dB", f"one that {_MOST_SUBJECTS} people show")
    while high - low > 1:  # the power rises with the number of subjects
        middle = (low + high) // 2
        low, high = (low, middle) if study.power_of(middle, variance) >= study.power else (middle, high)
    several = np.unique(np.round(np.geomspace(2, max(2 * high, 8), 40)))
    return StudyPlan(
        subjects=high,
        subjects_in_all=_FORMS[study.design][0] * high,
        repeats=repeats,
        trials=round(repeats * runs * run_trials),
        minutes=repeats * needed,
        error_db=error_db / float(np.sqrt(repeats)),
        power=float(study.power_of(high, variance)),
        curve=tuple((int(n), float(study.power_of(n, variance))) for n in several),
    )


def measured_spread(thresholds: Sequence[MeasuredThreshold]) -> tuple[float, int]:
    """Return the spread between people at a frequency and on a finger, rms over these, dB, with the number of people.

    What the measurements' own errors add is taken out; people who lie beyond what was played count as that
    (`group_level`). Raises BadInput where no two people were measured under the same condition.
    """
    under: dict[tuple[float, str], dict[tuple[int, str], MeasuredThreshold]] = {}
    for threshold in thresholds:
        person = threshold.study_number, threshold.subject
        under.setdefault((threshold.frequency_hz, threshold.finger), {})[person] = threshold
    variances, people = list[float](), 0
    for of_people in under.values():
        columns = [(point.level_db_re_1um, point.sd_db) for point in of_people.values()]
        level, error = np.nan_to_num(np.array(columns)).T
        group = group_level(level, error, [point.bound for point in of_people.values()])
        if np.isfinite(group.spread_db):
            variances.append(max(group.spread_db**2 - float(np.mean(error**2)), 0.0))
            people = max(people, len(of_people))
    if not variances:
        raise BadInput("a spread of people of whom no two were measured alike", "a store of three people or more")
    return float(np.sqrt(np.mean(variances))), people
