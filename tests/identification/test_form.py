"""Freedom that known values leave: every change that it allows keeps them, and there are as many as are left."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.identification.form import (
    Form,
    Pin,
    denominator_polynomial,
    freedom,
    ladder,
    numerator_polynomial,
    settled,
    weights_left,
)

COEFFICIENT = st.floats(0.05, 20.0)
KINDS = {
    "gain": (Pin("gain", 0, 0.7),),
    "lead": (Pin("lead", 2, 3.0),),
    "gain and lead": (Pin("gain", 0, 0.7), Pin("lead", 2, 3.0)),
    "num and den": (Pin("num", 0, 2.0), Pin("den", 1, 4.0)),
    "gain and num": (Pin("gain", 0, 0.7), Pin("num", 0, 2.0)),
    "two of den": (Pin("den", 0, 5.0), Pin("den", 2, 6.0)),
}


def values(pins: tuple[Pin, ...], num: np.ndarray, den: np.ndarray) -> np.ndarray:
    own = {"gain": lambda _: num[-1] / den[-1], "lead": lambda _: num[0]}
    own |= {"num": lambda power: num[-1 - power], "den": lambda power: den[-1 - power]}
    return np.array([own[pin.kind](pin.power) for pin in pins])


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(KINDS)), st.integers(3, 5), st.booleans(), st.lists(COEFFICIENT, min_size=9, max_size=9))
def test_freedom__any_values_and_form__keeps_them_to_first_order(kind, poles, known, numbers) -> None:
    pins = KINDS[kind]
    form = Form(poles, poles - 2, True, 0, 0, ((numbers[8],),) if known else (), pins)
    theta = settled(np.array(numbers[: form.free]), form)
    if theta is None:
        return  # no denominator of positive coefficients has these values
    rungs = ladder(theta, form)
    foot, basis = weights_left(theta, form, rungs)
    weights = foot + basis @ np.array(numbers[: basis.shape[1]])
    den, num = denominator_polynomial(theta, form), numerator_polynomial(rungs, weights, form)
    wanted = np.array([pin.value for pin in pins])
    np.testing.assert_allclose(values(pins, num, den), wanted, rtol=1e-9)
    free = freedom(theta, form, rungs)
    assert free.shape[1] == form.count
    assert np.linalg.matrix_rank(free / np.linalg.norm(free, axis=0)) == form.count
    for column in free.T:
        step = 1e-6 * column / max(1.0, float(np.max(np.abs(column))))
        moved = denominator_polynomial(theta + step[form.numerators : -1], form)
        other = numerator_polynomial(rungs, weights + step[: form.numerators], form)
        np.testing.assert_allclose(values(pins, other, moved), wanted, rtol=1e-7)


def test_settled__coefficient_far_off__is_reached_and_stays_positive() -> None:
    form = Form(4, 0, False, 0, 0, (), (Pin("den", 0, 1e6), Pin("den", 3, 1e-3)))
    theta = settled(np.array([0.5, 1.0, 2.0, 4.0]), form)
    assert theta is not None
    assert np.all(theta > 0.0)
    den = denominator_polynomial(theta, form)
    np.testing.assert_allclose(den[[-1, -4]], [1e6, 1e-3], rtol=1e-12)
