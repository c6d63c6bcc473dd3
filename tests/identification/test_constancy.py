"""What a mechanism that does not stay the same does to a model of it: NumPy and SciPy's own simulation."""

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from tactuator.identification.identify import identify
from tactuator.signals.record import Record

RATE_HZ, OMEGA, DAMPING = 1000.0, 2.0 * np.pi * 25.0, 0.5


def response_db(mass: float, hertz: NDArray[np.float64]) -> NDArray[np.float64]:
    s = 2j * np.pi * hertz
    return 20.0 * np.log10(np.abs(OMEGA**2 / mass / (s**2 + 2.0 * DAMPING * OMEGA * s + OMEGA**2 / mass)))


def touched(added: float, begin: float, end: float, seed: int = 1) -> Record:
    """A motor of mass 1 on which a finger rests between two shares of nine seconds: its states are carried over."""
    rng, count = np.random.default_rng(seed), 9000
    command = np.repeat(rng.choice([-1.0, 1.0], count // 5), 5)
    steps = []
    for mass in (1.0, 1.0 + added):
        a = np.array([[-2.0 * DAMPING * OMEGA, -(OMEGA**2) / mass, OMEGA**2 / mass], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        steps.append(scipy.linalg.expm(a / RATE_HZ))
    state, position = np.zeros(3), np.zeros(count)
    for k in range(count):
        position[k], state[2] = state[1], command[k]
        state = steps[begin * count <= k < end * count] @ state
    return Record(RATE_HZ, command, position + 3e-3 * np.std(position) * rng.standard_normal(count))


@pytest.mark.parametrize(("begin", "end"), [(0.33, 0.67), (0.0, 0.5), (0.8, 1.0), (0.1, 0.4)])
@pytest.mark.parametrize("added", [0.0, 0.1, 0.3])
def test_identify__finger_that_rests_for_a_while__is_in_the_band_or_refused(added, begin, end) -> None:
    model = identify(touched(added, begin, end), friction=False).model
    hertz = np.geomspace(1.0, 200.0, 30)
    found, band = 20.0 * np.log10(np.abs(model.response(hertz))), model.band_db(hertz)
    assert any("change of the response along the record" in reason for reason in model.distrust) == (added > 0.2)
    for mass in (1.0, 1.0 + added):
        np.testing.assert_array_less(np.abs(found - response_db(mass, hertz)), 1.5 * band + 0.05)
    assert added > 0.0 or band.max() < 0.1  # what stays the same is known as well as ever


def test_identify__finger_in_the_last_third__says_where() -> None:
    (reason,) = identify(touched(0.3, 0.7, 1.0), friction=False).model.distrust
    assert reason.startswith("change of the response along the record, most at 8.1 s, use a shorter part")


def test_identify__two_records_of_two_mechanisms__are_refused_together() -> None:
    both = [touched(0.3, 0.0, 0.0), touched(0.3, 0.0, 1.0, seed=2)]
    assert "change of the response along the record" in " ".join(identify(both, friction=False).model.distrust)
