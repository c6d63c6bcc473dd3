"""Loud catch trials among simulated runs: every trial of the procedure in its order, loud ones by lot between them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.experiment.procedure.quest_plus import QuestPlusRule
from tactuator.experiment.procedure.up_down import IMECE2004
from tactuator.experiment.procedure.whole_curve import WholeCurveRule
from tactuator.experiment.simulated.quality import Setting, simulate, simulate_curve, with_loud_trials


@settings(max_examples=50)
@given(st.lists(st.integers(1, 12), min_size=1, max_size=5), st.floats(0.0, 0.5), st.integers(0, 2**20))
def test_with_loud_trials__any_runs__keep_every_trial_of_the_procedure_in_its_order(lengths, share, seed) -> None:
    trials = np.array(lengths)
    order = with_loud_trials(trials, share, np.random.default_rng(seed))
    own_db = np.arange(trials.max())[None, :] + np.zeros((trials.size, 1))
    levels = order.levels(own_db)
    right = np.ones(own_db.shape, dtype=bool)
    outcomes = order.outcomes(right, np.zeros(order.placed.shape, dtype=bool))
    for run, count in enumerate(lengths):
        own = order.there[run] & ~order.loud[run]
        assert order.placed[run][own].tolist() == list(range(count))
        assert (levels[run][own] == np.arange(count)).all()
        assert outcomes[run].tolist() == own.tolist()
        loud = order.loud[run]
        assert (levels[run][loud] == order.placed[run][loud] + 20.0).all()
        assert not loud[order.there[run].sum() - 1]  # a run ends with its procedure
        assert np.isnan(levels[run][~order.there[run]]).all()


def test_with_loud_trials__many__are_their_share_of_all() -> None:
    order = with_loud_trials(np.full(200, 50), 0.2, np.random.default_rng(1))
    assert order.loud.sum() / order.there.sum() == pytest.approx(0.2, abs=0.01)


def test_simulate__loud_trials_and_lapses__are_flagged_as_in_runs_of_another_generator() -> None:
    """The other generator (logistic people, loud trials after the run): test_run_flags, 0.84 and 0.03."""
    often = simulate(IMECE2004, Setting(300, lapse=0.15, seed=1, loud_share=0.2))
    seldom = simulate(IMECE2004, Setting(300, lapse=0.02, seed=2, loud_share=0.2))
    assert 0.78 <= often.flags["lapses"] <= 0.92
    assert often.flags["attention"] > 0.3
    assert seldom.flags.get("lapses", 0.0) <= 0.05
    assert simulate(IMECE2004, Setting(300, lapse=0.15, seed=1)).flags["lapses"] < often.flags["lapses"] - 0.15


def test_simulate__few_answers_of_normal_people__are_seldom_flagged_for_lapses() -> None:
    """0.029 of 2,000 runs; 0.068 where frequent lapses were held against the mean of the rare rates."""
    found = simulate(QuestPlusRule(), Setting(400, lapse=0.02, slope=(1.5, 3.5), seed=4, loud_share=0.2))
    assert found.flags["lapses"] <= 0.045


def test_simulate__drift_and_guessing__are_flagged_with_every_procedure() -> None:
    still, moving = (simulate(QuestPlusRule(), Setting(200, seed=1, drift_db=drift)) for drift in (0.0, 12.0))
    assert moving.flags["drift"] >= 0.5
    assert still.flags.get("drift", 0.0) <= 0.07
    assert simulate(IMECE2004, Setting(40, seed=1, guessed=1.0)).flags["chance"] == 1.0


def test_simulate_curve__loud_trials_missed__are_flagged() -> None:
    found = simulate_curve(WholeCurveRule(24), Setting(3, lapse=0.2, seed=2, loud_share=0.5))
    assert found.flags["attention"] >= 0.5
    assert simulate_curve(WholeCurveRule(24), Setting(3, seed=2, loud_share=0.5)).flags.get("attention", 0.0) == 0.0
