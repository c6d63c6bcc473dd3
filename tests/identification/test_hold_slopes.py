"""Derivatives of the held response by coefficients and dead time, against differences of the response itself."""

import numpy as np
import pytest

from tactuator.identification.form import Form, ladder
from tactuator.identification.hold import Grid, held_slopes, response_columns

FORMS = {
    "a dead time": (Form(3, 1, True), [0.3, 1.1, 0.7], 0.4),
    "hardly damped": (Form(2, 0), [0.01, 2.0], 0.0),
    "as many zeros as poles": (Form(4, 4, True), [0.3, 1.1, 1.7, 0.6], 0.9),
    "an integrator": (Form(2, 0, False, 1), [0.7], 0.3),
    "an unstable pair": (Form(3, 2, True, 0, 1), [-0.1, 1.0, 30.0], 0.01),
}


@pytest.mark.parametrize("name", FORMS)
def test_held_slopes__every_form__are_those_of_the_response(name: str) -> None:
    form, coefficients, delay = FORMS[name]
    theta = np.array(coefficients)
    grid = Grid(np.geomspace(1.0, 480.0, 200), 1000.0, 2.0 * np.pi * 60.0, "zero-order")
    rungs, numerator = ladder(theta, form), np.random.default_rng(0).standard_normal(form.numerators)

    def response(at: np.ndarray, late: float) -> np.ndarray:
        return response_columns(grid, at, late, form, rungs) @ numerator

    found = held_slopes(grid, theta, delay, form, rungs, numerator, np.full(theta.size, 1e-7))
    moves = [(step, 0.0, step.sum()) for step in 1e-5 * np.eye(theta.size) * np.maximum(np.abs(theta), 0.1)]
    moves += [(np.zeros(theta.size), 1e-5, 1e-5)] * form.dead_time
    for j, (step, late, size) in enumerate(moves):
        expected = (response(theta + step, delay + late) - response(theta - step, delay - late)) / (2.0 * size)
        np.testing.assert_allclose(found[:, j], expected, atol=1e-4 * float(np.max(np.abs(expected))))


def test_held_slopes__poles_that_coincide__are_left_to_differences() -> None:
    form, theta = Form(2, 0), np.array([2.0, 1.0])
    grid = Grid(np.array([1.0, 50.0]), 1000.0, 300.0, "zero-order")
    assert held_slopes(grid, theta, 0.0, form, ladder(theta, form), np.ones(1), np.full(2, 1e-7)) is None
