"""To and from python-control, and back to continuous form."""

import sys

import control
import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis import paper
from tactuator.synthesis.exchange import continuous_form, from_control, to_control
from tests.synthesis.displays import three_finger_controller

RATE_HZ = 4000.0
FREQUENCY = np.geomspace(0.3, 1500.0, 25)


@pytest.mark.parametrize("system", [paper.PLANT, paper.FEEDBACK, paper.PREFILTER], ids=["P", "C", "F"])
def test_to_control__continuous__same_response_and_back(system: ContinuousSystem) -> None:
    made = to_control(system)
    assert made.dt == 0
    assert np.allclose(made(2j * np.pi * FREQUENCY), system.response(FREQUENCY), rtol=1e-9)
    back = from_control(made)
    assert isinstance(back, ContinuousSystem)
    assert np.allclose(back.response(FREQUENCY), system.response(FREQUENCY), rtol=1e-7)


def test_to_control__sampled_with_delay__same_response_and_back() -> None:
    own = three_finger_controller().channels[0]
    feedback = own.feedback(RATE_HZ)
    for system in (own.prefilter(RATE_HZ), feedback, zero_order_hold(paper.PLANT, RATE_HZ, 1)):
        made = to_control(system)
        assert made.dt == pytest.approx(1.0 / RATE_HZ)
        response = np.array([made(np.exp(2j * np.pi * f / RATE_HZ)) for f in FREQUENCY])
        assert np.allclose(response, system.response(FREQUENCY), rtol=1e-7)
        back = from_control(made)
        assert isinstance(back, SampledSystem)
        assert np.allclose(back.response(FREQUENCY), system.response(FREQUENCY), rtol=1e-4)


@pytest.mark.parametrize(
    ("exchange", "system", "words"),
    [
        (from_control, control.ss(-np.eye(2), np.eye(2), np.ones((1, 2)), np.zeros((1, 2))), "2 inputs"),
        (from_control, control.tf([1.0], [1.0, 0.5], True), "sampling period is True"),
        (to_control, ContinuousSystem([], [-1.0], 1.0, 0.01), "no dead time"),
        (to_control, ContinuousSystem([-1.0, -2.0], [-3.0], 1.0), "no more zeros than poles"),
    ],
)
def test_exchange__what_the_other_does_not_have__refused(exchange, system, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        exchange(system)


def test_to_control__package_missing__says_how(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(BadInput, match="pip install control"):
        to_control(paper.PLANT)


def test_continuous_form__of_a_controller__its_bilinear_transform_is_the_controller() -> None:
    own = three_finger_controller().channels[0]
    papers = [bilinear(system, RATE_HZ) for system in (paper.FEEDBACK, paper.PREFILTER)]
    for system in (own.prefilter(RATE_HZ), own.feedback(RATE_HZ), *papers):
        again = bilinear(continuous_form(system), RATE_HZ)
        assert np.allclose(again.response(FREQUENCY), system.response(FREQUENCY), rtol=1e-7)
