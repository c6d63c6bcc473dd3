"""The procedures' quality against the table of facts, section 5 (20,000 runs there, another program)."""

import dataclasses

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.procedure.quest_plus import QuestPlusRule
from tactuator.experiment.procedure.up_down import IMECE2004, UpDownRule
from tactuator.experiment.simulated.quality import Setting, run_procedure, simulate

TABLE = [  # slope, lapse, bias dB, sd dB, trials, p05, p95
    (1.5, 0.0, -0.56, 1.48, 80, 63, 101),
    (2.5, 0.0, -0.41, 0.95, 78, 62, 98),
    (2.5, 0.01, -0.34, 0.99, 78, 62, 98),
    (2.5, 0.03, -0.05, 1.45, 80, 62, 104),
    (3.5, 0.0, -0.30, 0.72, 76, 61, 94),
]


@pytest.mark.parametrize(("slope", "lapse", "bias", "sd", "trials", "low", "high"), TABLE)
def test_imece2004__twenty_thousand_runs__reproduce_the_table(
    slope: float, lapse: float, bias: float, sd: float, trials: float, low: float, high: float
) -> None:
    found = run_procedure(IMECE2004, Setting(20_000, (slope, slope), lapse, seed=4))
    assert found.estimates_db_sl.mean() == pytest.approx(bias, abs=0.06)
    assert found.estimates_db_sl.std(ddof=1) == pytest.approx(sd, rel=0.05)
    assert found.trials.mean() == pytest.approx(trials, abs=1.5)
    assert np.percentile(found.trials, [5.0, 95.0]) == pytest.approx([low, high], abs=2)


def test_floor__one_db_below_the_threshold__biases_upwards() -> None:
    free = run_procedure(IMECE2004, Setting(10_000, seed=1))
    clamped = run_procedure(dataclasses.replace(IMECE2004, floor_db_sl=-1.0), Setting(10_000, seed=1))
    assert clamped.estimates_db_sl.mean() > free.estimates_db_sl.mean() + 0.4


def test_fourth_large_step__lets_a_large_reversal_into_the_mean() -> None:
    rule = UpDownRule(steps_db=(4.0, 4.0, 4.0, 4.0, 1.0))
    assert run_procedure(rule, Setting(10_000, seed=1)).estimates_db_sl.mean() > 0.2


@pytest.mark.parametrize("slope", [1.5, 2.0, 2.5, 3.0, 3.5])
def test_refit__each_slope__is_less_wrong_unbiased_and_covers(slope: float) -> None:
    found = simulate(IMECE2004, Setting(1000, (slope, slope), seed=2))
    assert found.refit.rmse_db <= 0.85 * found.rmse_db
    assert abs(found.refit.bias_db) <= 0.2
    assert found.refit.coverage95 >= 0.88


@pytest.mark.parametrize("lapse", [0.0, 0.02])
def test_refit__slopes_drawn__interval_is_calibrated(lapse: float) -> None:
    found = simulate(IMECE2004, Setting(2000, (1.5, 3.5), lapse, seed=3))
    assert 0.92 <= found.refit.coverage95 <= 0.985
    assert found.refit.rmse_db <= 0.85 * found.rmse_db


@pytest.mark.parametrize(("trials", "rmse"), [(30, 1.50), (40, 1.23), (50, 1.08), (60, 0.97)])
def test_quest_plus__number_of_trials__matches_or_beats_the_table(trials: int, rmse: float) -> None:
    found = run_procedure(QuestPlusRule(trials=trials), Setting(700, lapse=0.02, seed=5))
    assert np.sqrt(np.mean(found.estimates_db_sl**2)) <= 1.04 * rmse


def test_simulate__same_seed__gives_the_same() -> None:
    setting = Setting(200, (1.5, 3.5), 0.02, seed=9)
    assert simulate(IMECE2004, setting) == simulate(IMECE2004, setting)
    assert simulate(IMECE2004, setting) != simulate(IMECE2004, dataclasses.replace(setting, seed=10))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"runs": 1}, "runs is 1; allowed: a whole number, 2 or more"),
        ({"runs": 10, "slope": (0.0, 1.0)}, "slope.0 is 0; allowed: .*above 0"),
        ({"runs": 10, "slope": (3.0, 2.0)}, "slope is 3 to 2"),
        ({"runs": 10, "lapse": 0.3}, "lapse 0.3"),
        ({"runs": 10, "start_db": 500.0}, "start_db is 500; allowed: .*-40 to 60"),
        ({"runs": 10, "guessed": 1.5}, "guessed is 1.5; allowed: .*0 to 1"),
        ({"runs": 10, "guessed": -0.1}, "guessed is -0.1"),
        ({"runs": 10, "drift_db": 100.0}, "drift_db is 100; allowed: .*-60 to 60"),
        ({"runs": 10, "loud_share": 0.7}, "loud_share is 0.7; allowed: .*0 to 0.5"),
    ],
)
def test_setting__nonsense__is_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        Setting(**settings)  # type: ignore[arg-type]
