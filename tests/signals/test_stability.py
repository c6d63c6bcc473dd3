"""Closed-loop poles from factors, against polynomials with many digits."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.loop import closed_poles, closed_roots, is_stable
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis import paper


def exact_roots(zeros: list[complex], poles: list[complex], gain: float) -> np.ndarray:
    """Roots of prod(x - poles) + gain prod(x - zeros) with 60 digits."""
    with mpmath.workdps(60):
        left, right = [mpmath.mpf(1)], [mpmath.mpf(gain)]
        for roots, polynomial in ((poles, "left"), (zeros, "right")):
            for root in roots:
                old = left if polynomial == "left" else right
                new = [*old, mpmath.mpf(0)]
                for index, value in enumerate(old):
                    new[index + 1] -= mpmath.mpmathify(root) * value
                if polynomial == "left":
                    left = new
                else:
                    right = new
        shift = len(left) - len(right)
        total = [value + (right[i - shift] if i >= shift else 0) for i, value in enumerate(left)]
        return np.array(
            [complex(root) for root in mpmath.polyroots(total[::-1], maxsteps=500, extraprec=400, asc=True)]
        )


@pytest.mark.parametrize("rate_hz", [4e3, 8e3, 16e3, 32e3, 64e3])
def test_closed_poles__paper_loop__60_digits_agree(rate_hz: float) -> None:
    open_loop = bilinear(paper.FEEDBACK, rate_hz) * zero_order_hold(paper.PLANT, rate_hz)
    delayed = open_loop * SampledSystem(np.empty(0), np.empty(0), 1.0, rate_hz, 1)
    found = np.sort_complex(closed_poles(delayed))
    shifted = [complex(z) - 1.0 for z in delayed.zeros], [*(complex(p) - 1.0 for p in delayed.poles), -1.0 + 0j]
    wanted = np.sort_complex(exact_roots(*shifted, delayed.gain))
    for root in wanted:
        assert np.min(np.abs(found - root)) < 1e-9 * abs(root) + 1e-15


@given(st.lists(st.floats(-50.0, -0.1), min_size=2, max_size=6), st.floats(0.01, 100.0))
def test_closed_roots__random_real_poles__residual_is_small(poles: list[float], gain: float) -> None:
    zeros = np.array([-3.0 + 0j])
    found = closed_roots(zeros, np.array(poles, dtype=complex), gain)
    for root in found:
        parts = np.prod(root - np.array(poles)), gain * np.prod(root - zeros)
        scale = np.prod(np.abs(root) + np.abs(poles)) + abs(gain) * np.prod(np.abs(root) + np.abs(zeros))
        assert abs(sum(parts)) < 1e-9 * scale


def test_is_stable__hidden_unstable_cancellation__not_stable() -> None:
    """A controller that cancels an unstable pole leaves it in the loop."""
    c = ContinuousSystem([2.0], [0.0], 1.0)
    p = ContinuousSystem([], [2.0, -3.0], 5.0)
    assert not is_stable(c * p)


def test_is_stable__dead_time__as_the_closed_form_says() -> None:
    """e^(-sT) k/(s + 1), k = 2: stable while T < arccos(-1/k)/sqrt(k^2 - 1) = 1.2092 s."""
    assert is_stable(ContinuousSystem([], [-1.0], 2.0, 1.20))
    assert not is_stable(ContinuousSystem([], [-1.0], 2.0, 1.22))
    assert is_stable(ContinuousSystem([], [-1.0], 0.9, 50.0))


def test_is_stable__unstable_plant_held_by_feedback_with_dead_time__stable() -> None:
    """k e^(-sT)/(s - 1), k = 2: stable while T < arccos(1/k)/sqrt(k^2 - 1) = 0.6046 s."""
    assert is_stable(ContinuousSystem([], [1.0], 2.0, 0.60))
    assert not is_stable(ContinuousSystem([], [1.0], 2.0, 0.61))


def test_closed_poles__dead_time__refused() -> None:
    with pytest.raises(BadInput, match="dead time"):
        closed_poles(ContinuousSystem([], [-1.0], 1.0, 0.1))


def test_closed_roots__improper__refused() -> None:
    with pytest.raises(BadInput, match="no more zeros than poles"):
        closed_roots(np.array([-1.0 + 0j, -2.0]), np.array([-3.0 + 0j]), 1.0)


def test_closed_roots__algebraic_loop_without_solution__refused() -> None:
    with pytest.raises(BadInput, match="direct gain"):
        closed_roots(np.array([-1.0 + 0j]), np.array([-3.0 + 0j]), -1.0)


def test_is_stable__dead_time_and_direct_path__refused() -> None:
    with pytest.raises(BadInput, match="strictly proper"):
        is_stable(ContinuousSystem([-1.0], [-2.0], 0.5, 0.1))
