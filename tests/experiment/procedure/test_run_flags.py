"""Flags of runs at one frequency: guessers, lapses, drift; how often they are right and how often they cry wolf."""

import dataclasses
import tomllib
from collections import Counter
from importlib.resources import files

import numpy as np
import pytest

from tactuator.experiment.procedure.quest_plus import QuestPlus, QuestPlusRule, tables
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.perception.psychometric import Psychometric
from tests.experiment.conftest import Logistic
from witnesses.people.flags import LOUD_SHARE, judged


def test_flags__of_the_witness_s_people__are_seldom_wrong_and_mostly_right() -> None:
    """A sample of `witnesses.people.flags`: seven of 100 flagged wrongly are seen."""
    for kind in ("curve", "imece2004", "quest-plus", "up-down"):  # its rates are those of what is shipped
        text = files("tactuator.io.examples.protocols").joinpath(f"{kind}.toml").read_text()
        assert tomllib.loads(text)["catch"]["loud_share"] == LOUD_SHARE
    counts = {
        name: Counter(flag for flags in judged("imece2004", name, people, 1, []) for flag in flags)
        for name, people in (("normal", 100), ("lapsing", 50), ("guessing", 20))
    }
    assert max(counts["normal"].values(), default=0) <= 4
    assert counts["lapsing"]["lapses"] >= 30
    assert counts["guessing"]["chance"] == 20


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
