"""The plan of a study against oracles of its own: an integral over the spread's distribution, and simulated studies."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from tactuator.errors import BadInput
from tactuator.experiment.simulated.planning import PlannedStudy, measured_spread, plan_study
from tests.experiment.result.test_tables import ONE

GROUPS = {"between": 2, "within": 1, "norm": 1}
DIFFERENCES = {"between": 2.0, "within": 2.0, "norm": 1.0}


def power_by_integral(design: str, effect_db: float, sd_db: float, subjects: int, alpha: float) -> float:
    """Power of the t test as an integral over the estimated spread: given it, the mean difference is normal."""
    freedom = GROUPS[design] * (subjects - 1)
    shift = effect_db / (sd_db * math.sqrt(DIFFERENCES[design] / subjects))
    critical = stats.t.ppf(1.0 - alpha / 2.0, freedom)

    def density(ratio: float) -> float:
        beyond = stats.norm.sf(critical * ratio - shift) + stats.norm.cdf(-critical * ratio - shift)
        return float(beyond * 2.0 * ratio * freedom * stats.chi2.pdf(freedom * ratio**2, freedom))

    return float(integrate.quad(density, 0.0, 8.0, limit=200)[0])


@pytest.mark.parametrize("design", GROUPS)
@pytest.mark.parametrize(("effect_db", "subjects"), [(1.0, 40), (3.0, 12), (6.0, 5), (9.0, 3)])
def test_power__each_design__is_the_integral_over_the_spread(design: str, effect_db: float, subjects: int) -> None:
    study = PlannedStudy(effect_db, 4.0, design, alpha=0.02)
    variance = study.variance(error_db=2.0, repeats=2)
    assert variance == pytest.approx(18.0)
    expected = power_by_integral(design, effect_db, math.sqrt(18.0), subjects, 0.02)
    assert float(study.power_of(subjects, variance)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("design", GROUPS)
def test_plan__studies_of_that_size__find_the_effect_as_often_as_it_says(design: str) -> None:
    """People, runs with errors, and SciPy's t tests, 4,000 studies."""
    study = PlannedStudy(3.0, 3.0, design, minutes=60.0, conditions=4, comparisons=2)
    found = plan_study(study, error_db=1.5, run_trials=60.0)
    rng, size = np.random.default_rng(3), (4000, found.subjects)
    occasions = 2 if design == "within" else 1
    assert found.repeats == int(60.0 * 60.0 / (4 * occasions * 60 * study.trial_s))

    def people(mean: float) -> np.ndarray:
        runs = rng.normal(0.0, 1.5, (*size, found.repeats)).mean(axis=2)
        return mean + rng.normal(0.0, 3.0, size) + runs

    if design == "between":
        p = stats.ttest_ind(people(3.0), people(0.0), axis=1).pvalue
    elif design == "within":
        own = rng.normal(0.0, 10.0, size)  # what a person is like stays from occasion to occasion
        p = stats.ttest_rel(own + people(3.0), own + people(0.0), axis=1).pvalue
    else:
        p = stats.ttest_1samp(people(3.0), 0.0, axis=1).pvalue
    assert float(np.mean(p < 0.025)) == pytest.approx(found.power, abs=0.025)
    assert found.power >= 0.8
    assert float(study.power_of(found.subjects - 1, study.variance(1.5, found.repeats))) < 0.8
    assert found.subjects_in_all == GROUPS[design] * found.subjects


def test_plan__too_little_time_or_too_small_an_effect__is_refused() -> None:
    with pytest.raises(BadInput, match="8 runs of 60 trials take 34 min; allowed: 20 min or less"):
        plan_study(PlannedStudy(3.0, 3.0, minutes=20.0), 1.0, 60.0)
    with pytest.raises(BadInput, match=r"effect of 0\.01 dB"):
        plan_study(PlannedStudy(0.01, 9.0), 1.0, 48.0)
    assert plan_study(PlannedStudy(3.0, 3.0, minutes=20.0), 1.0, 150.0, whole_curve=True).repeats == 1
    for effect_db in (0.1, 1.0, 8.0, 40.0):
        power = PlannedStudy(effect_db, 4.5).power_of(np.arange(2, 3000, 7), 20.0)
        assert np.all((power >= 0.05 - 1e-9) & (power <= 1.0))
        assert np.all(np.diff(power) >= -1e-9)


def test_measured_spread__of_a_pilot__is_that_of_the_people_without_their_errors() -> None:
    levels = np.random.default_rng(2).normal(5.0, math.hypot(4.0, 3.0), (3, 400))  # people of 4 dB, errors of 3
    pilot = [
        replace(ONE, subject=f"S{number}", frequency_hz=hertz, level_db_re_1um=level, sd_db=3.0)
        for hertz, row in zip((10.0, 50.0, 250.0), levels, strict=True)
        for number, level in enumerate(row)
    ]
    spread, people = measured_spread(pilot)
    assert people == 400
    assert spread == pytest.approx(4.0, rel=0.06)
    with pytest.raises(BadInput, match="no two were measured alike"):
        measured_spread(pilot[::400])
