import numpy as np
import pytest
from scipy import signal

from tactuator.errors import BadInput
from tactuator.identification.friction import dahl_state
from tactuator.identification.recursive import companion_states, recursive_least_squares
from tests.identification.plants import PAPER, RATE_HZ


@pytest.mark.parametrize(("hold", "method"), [("zero-order", "zoh"), ("first-order", "foh")])
def test_companion_states__paper_plant__agree_with_scipys_hold(hold: str, method: str) -> None:
    command = np.cumsum(np.random.default_rng(1).standard_normal(5000))
    command -= command[0]
    a, b, c, d, _ = signal.cont2discrete(signal.tf2ss(PAPER.num, PAPER.den), 1.0 / RATE_HZ, method=method)
    _, expected, _ = signal.dlsim((a, b, c, d, 1.0 / RATE_HZ), command)
    states = companion_states(PAPER.den, command, RATE_HZ, hold=hold)
    np.testing.assert_allclose(2875.0 * states[0], expected[:, 0], atol=1e-8)


def test_recursive_least_squares__no_forgetting__is_batch_least_squares() -> None:
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((3000, 4))
    output = rows @ [1.0, -2.0, 3.0, 0.5] + 0.1 * rng.standard_normal(3000)
    theta, inverse_information, _, _ = recursive_least_squares(rows, output)
    np.testing.assert_allclose(theta, np.linalg.lstsq(rows, output)[0], atol=1e-7)
    np.testing.assert_allclose(inverse_information, np.linalg.inv(rows.T @ rows), rtol=1e-5, atol=1e-9)


def test_recursive_least_squares__agrees_with_a_plain_numpy_recursion() -> None:
    rng = np.random.default_rng(5)
    rows, output = rng.standard_normal((200, 3)), rng.standard_normal(200)
    theta, m = np.zeros(3), np.eye(3) * 1e3
    for phi, y in zip(rows, output, strict=True):
        gain = m @ phi / (0.98 + phi @ m @ phi)
        theta = theta + gain * (y - phi @ theta)
        m = (m - np.outer(gain, phi @ m)) / 0.98
    found, inverse_information, _, _ = recursive_least_squares(rows, output, forgetting=0.98, start_variance=1e3)
    np.testing.assert_allclose(found, theta, rtol=1e-9)
    np.testing.assert_allclose(inverse_information, m, rtol=1e-8)


def test_core__out_of_range__is_refused() -> None:
    with pytest.raises(BadInput, match="forgetting"):
        recursive_least_squares(np.ones((5, 1)), np.ones(5), forgetting=1.5)


def test_dahl_state__long_stroke__saturates_and_turns_within_the_presliding() -> None:
    position = np.concatenate([np.linspace(0.0, 1.0, 1000), np.linspace(1.0, 0.0, 1000)])
    state = dahl_state(position, 0.01)
    assert state[999] == pytest.approx(1.0, abs=1e-3)
    assert state[1100] == pytest.approx(-1.0, abs=1e-3)
    assert np.max(np.abs(state)) <= 1.0
