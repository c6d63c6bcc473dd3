"""Flags of runs at one frequency: guessers, lapses, drift; how often they are right and how often they cry wolf."""

import dataclasses
import tomllib
from importlib.resources import files

import numpy as np
import pytest

from tactuator.experiment.procedure.quest_plus import QuestPlus, QuestPlusRule, tables
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.procedure.run_flags import run_flags
from tactuator.experiment.procedure.up_down import IMECE2004, run_tracks
from tactuator.perception.psychometric import Psychometric
from tests.experiment.conftest import Logistic

LOUD_SHARE = 0.2
"""Share of all trials that are loud catch trials, as in the protocols that the package ships."""


def flagged(
    lapse: float, runs: int, loud_share: float = LOUD_SHARE, drift_db: float = 0.0, guess: bool = False, seed: int = 8
) -> dict[str, float]:
    """Share of the paper's tracks with each flag. The people are logistic in dB: the refit believes in a Weibull.

    As in a session, every trial is drawn to be loud or the procedure's, and a loud one lies 20 dB above where the
    procedure stands.
    """
    rng = np.random.default_rng(seed)
    steep = rng.uniform(0.35, 0.75, runs)
    model = Psychometric(Logistic(), lapse=lapse)
    edge = -np.log(model.at_threshold / (1.0 - model.at_threshold))

    def probability(level_db, numbers):
        found = model.guess + (1.0 - model.guess - lapse) / (1.0 + np.exp(edge - steep[numbers] * level_db))
        return np.full_like(found, 1.0 / 3.0) if guess else found

    def chance(level_db, numbers, trial):
        return probability(level_db - drift_db * (min(trial / 80.0, 1.0) - 0.5), numbers)

    tracks = run_tracks(IMECE2004, np.full(runs, 20.0), chance, rng)
    count = rng.negative_binomial(tracks.trials, 1.0 - loud_share)
    extra = np.arange(count.max()) < count[:, None]
    beside = (rng.random(extra.shape) * tracks.trials[:, None]).astype(int)
    loud = np.where(extra, np.take_along_axis(tracks.levels_db_sl, beside, axis=1) + 20.0, np.nan)
    right = rng.random(extra.shape) < probability(np.nan_to_num(loud), np.arange(runs)[:, None])
    levels, correct = np.hstack([tracks.levels_db_sl, loud]), np.hstack([tracks.correct, right & extra])
    fit = refit(levels, correct)
    flags = run_flags(levels, correct, fit, RefitPrior())
    names = [flags.names(run) for run in range(runs)]
    return {name: float(np.mean([name in found for found in names])) for name in ("chance", "lapses", "drift")}


def test_flags__normal_people__are_seldom_raised() -> None:
    found = flagged(0.01, 120)
    assert found["chance"] == 0.0
    assert found["lapses"] <= 0.06
    assert found["drift"] <= 0.08


def test_flags__lapses_of_fifteen_percent_and_catch_trials__are_raised() -> None:
    assert flagged(0.15, 80)["lapses"] >= 0.6


def test_flags__guessers__are_all_raised() -> None:
    assert flagged(0.0, 60, guess=True)["chance"] == 1.0


def test_flags__drift__is_raised_more_often_than_without() -> None:
    assert flagged(0.01, 120, drift_db=12.0)["drift"] >= 0.4


@pytest.mark.parametrize("kind", ["curve", "imece2004", "quest-plus", "up-down"])
def test_flags__loud_share_of_the_figures__is_that_of_the_shipped_protocols(kind: str) -> None:
    text = files("tactuator.io.examples.protocols").joinpath(f"{kind}.toml").read_text()
    assert tomllib.loads(text)["catch"]["loud_share"] == LOUD_SHARE


@pytest.mark.slow
def test_flags__eight_hundred_runs__figures_of_the_documents() -> None:
    normal = flagged(0.02, 800, seed=9)
    assert flagged(0.15, 800, seed=9)["lapses"] >= 0.68
    assert normal["lapses"] <= 0.02
    assert normal["drift"] <= 0.02


def test_quest_plus__estimate__is_of_the_product_of_prior_and_all_answers() -> None:
    rule, rng = QuestPlusRule(trials=25), np.random.default_rng(2)
    run, table = QuestPlus(rule), tables(rule)
    weight = table.prior.copy()
    while (placement := run.placement()) is not None:
        right, psi = bool(rng.random() < 0.7), table.psi[:, np.flatnonzero(table.levels == placement.level_db_sl)[0]]
        weight *= psi if right else 1.0 - psi
        run.record(right)
    mean = np.average(table.parameter_threshold, weights=weight)
    sd = np.sqrt(np.average((table.parameter_threshold - mean) ** 2, weights=weight))
    assert dataclasses.astuple(run.estimate()) == pytest.approx((mean, sd), rel=1e-6)


@pytest.mark.parametrize("target", [0.5**0.5, 0.5 ** (1.0 / 3.0)])
def test_refit__target_of_the_procedure__is_where_psi_reaches_it(target: float) -> None:
    rng, model = np.random.default_rng(4), Psychometric(Logistic(), target=target)
    levels = rng.integers(-6, 7, (40, 300)).astype(float)
    found = refit(levels, rng.random(levels.shape) < model.probability(levels), RefitPrior(target=target))
    assert float(np.mean(found.threshold_db)) == pytest.approx(0.0, abs=0.35)
