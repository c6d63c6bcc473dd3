"""The best of several fits, where costs are large, or no numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.identification.search import _best


def fits(costs):
    return {place: SimpleNamespace(cost=cost, form=SimpleNamespace(poles=place, count=place)) for place, cost in costs}


@pytest.mark.parametrize(
    ("costs", "poles"),
    [
        ([(2, 100.0), (3, 50.0)], 3),
        ([(2, np.nan), (3, 1e5)], 3),
        ([(2, 1e5), (3, np.nan)], 2),
        ([(4, 1e20), (3, 1e20)], 3),
        ([(4, np.inf), (3, np.nan)], 3),
    ],
)
def test_best__whatever_the_costs__is_one_of_them(costs, poles):
    """Found with a threefold integrator: beside a cost of 1e17 a tie's width is nothing."""
    problem = SimpleNamespace(given=SimpleNamespace(total=1000))
    assert _best(problem, fits(costs)).form.poles == poles
