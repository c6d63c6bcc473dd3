"""What is said of the whole-curve procedure, and for whom."""

from tactuator.experiment.procedure.whole_curve import WholeCurveRule
from tactuator.experiment.simulated.quality import Setting, simulate_curve


def test_simulate_curve__no_truth_given__says_that_people_are_drawn() -> None:
    found = simulate_curve(WholeCurveRule(40), Setting(4, seed=1))
    assert "drawn" in found.people
    assert found.trials == 40
    assert found.coverage95 >= 0.8


def test_simulate_curve__same_seed__same_figures() -> None:
    first, second = (simulate_curve(WholeCurveRule(10), Setting(3, seed=5)) for _ in range(2))
    assert first == second
