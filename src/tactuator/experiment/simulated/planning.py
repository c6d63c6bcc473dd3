"""How many subjects a comparison of thresholds takes, and its power.

A person's threshold, of r runs with the error e, has the variance v = s^2 + e^2 / r about the group's mean: s is the
spread between people. Two groups of n people are compared by a t test with 2 n - 2 degrees of freedom and the
noncentrality d / sqrt(2 v / n); the same people under two conditions by one with n - 1, where s is the spread of a
person from one occasion to the next. The power is the noncentral t distribution's mass beyond the critical values
(Cohen 1988, chapter 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import scipy
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.parameters import Number, Positive, Whole, table

Design = Literal["between", "within"]
_MOST_SUBJECTS = 10_000
_CERTAIN = 30.0
"""Noncentrality from which the power is 1 in all digits."""


@dataclass(frozen=True)
class StudyPlan:
    """What a study takes. subjects: in each group. power: with so many. error_db: of a person's threshold."""

    subjects: int
    power: float
    error_db: float


@table("")
class PlannedStudy:
    """A difference of means that a study is to find."""

    effect_db: Annotated[Positive, Field(description="Difference to be found.")]
    spread_db: Annotated[Positive, Field(description="Standard deviation between people, or (within) occasions.")]
    design: Annotated[Design, Field(description="Two groups, or one group under two conditions.")] = "between"
    repeats: Annotated[Whole, Field(ge=1, description="Runs of a person under a condition.")] = 1
    alpha: Annotated[Number, Field(gt=0.0, lt=0.5, description="Two-sided significance level.")] = 0.05
    power: Annotated[Number, Field(gt=0.05, lt=0.9999, description="Probability of finding the effect.")] = 0.8

    def power_of(self, subjects: int | FloatArray, run_error_db: float) -> FloatArray:
        """Return the power with so many subjects in each group, two or more, by runs with that error."""
        count = np.asarray(subjects, dtype=np.float64)
        freedom = (2.0 if self.design == "between" else 1.0) * (count - 1.0)
        variance = self.spread_db**2 + run_error_db**2 / self.repeats
        shift = self.effect_db / np.sqrt(2.0 * variance / count)
        critical = scipy.stats.t.isf(0.5 * self.alpha, freedom)
        below = np.nan_to_num(scipy.stats.nct.cdf(-critical, freedom, shift))  # undefined where it underflows
        return np.asarray(np.where(shift > _CERTAIN, 1.0, scipy.stats.nct.sf(critical, freedom, shift) + below))

    def plan(self, run_error_db: float) -> StudyPlan:
        """Return what the study takes by runs with that error. Raises BadInput where no number of subjects will do."""
        low, high = 1, _MOST_SUBJECTS
        if self.power_of(high, run_error_db) < self.power:
            raise BadInput(f"an effect of {self.effect_db:g} dB", f"one that {_MOST_SUBJECTS} people show")
        while high - low > 1:  # the power rises with the number of subjects
            middle = (low + high) // 2
            low, high = (low, middle) if self.power_of(middle, run_error_db) >= self.power else (middle, high)
        return StudyPlan(high, float(self.power_of(high, run_error_db)), run_error_db / float(np.sqrt(self.repeats)))
