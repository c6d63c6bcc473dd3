"""Frequency responses by themselves: simulate, identify, recover, refuse."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.identification.asked import Asked
from tactuator.identification.by_response import identify_response
from tactuator.identification.trust import RESPONSE_ALIKE, RESPONSE_OFF
from tactuator.signals.record import FrequencyResponse, minimum_phase
from tests.identification.others import Plant

PLANT = Plant(np.array([-900.0]), np.array([-60.0 + 500.0j, -60.0 - 500.0j]), 2.0, 0.0)
HERTZ = np.geomspace(5.0, 500.0, 60)


def test_minimum_phase__of_a_plant_without_dead_time__is_its_phase() -> None:
    value = PLANT.response(HERTZ)
    assert np.max(np.abs(minimum_phase(HERTZ, np.abs(value)) - np.unwrap(np.angle(value)))) < np.radians(5.0)


@pytest.mark.parametrize("with_phase", [True, False])
def test_identify_response__of_a_known_plant__recovers_it(with_phase: bool) -> None:
    rng = np.random.default_rng(5)
    value = PLANT.response(HERTZ) * (1.0 + 0.003 * rng.standard_normal(HERTZ.size))
    phase = np.unwrap(np.angle(value)) if with_phase else None
    given = FrequencyResponse(HERTZ, np.abs(value), phase, np.full(HERTZ.size, 0.003 if with_phase else 0.01))
    found = identify_response(given, Asked())
    assert found.order == 2
    assert not found.distrust
    off = np.log(found.model.response(HERTZ) / PLANT.response(HERTZ))
    assert np.max(np.abs(off.real)) * 8.686 < (0.05 if with_phase else 0.3)
    assert found.model.valid_hz == pytest.approx((HERTZ[0], HERTZ[-1]))


@pytest.mark.parametrize("turned", [0.0, 1.0])
def test_identify_response__without_confidence_and_with_noise__keeps_to_its_poles(turned: float) -> None:
    rng = np.random.default_rng(1)
    value = PLANT.response(HERTZ)
    for deviation in (0.02, 0.06):
        noise = rng.standard_normal(HERTZ.size) + 1j * turned * rng.standard_normal(HERTZ.size)
        seen = value * (1.0 + deviation * noise)
        guess = np.full(HERTZ.size, 0.01)
        given = FrequencyResponse(HERTZ, np.abs(seen), np.unwrap(np.angle(seen)), guess, assumed=True)
        found = identify_response(given, Asked())
        assert found.order == 2
        assert not found.distrust
        assert any("the error is" in remark for remark in found.remarks)
        off = 20.0 * np.log10(np.abs(found.model.response(HERTZ) / value))
        assert np.mean(np.abs(off) <= found.model.band_db(HERTZ)) > 0.8


@pytest.mark.parametrize(("assumed", "with_phase"), [(True, True), (False, True), (True, False)])
def test_identify_response__bad_readings__are_left_out_and_named_and_the_band_reaches_them(
    assumed: bool, with_phase: bool
) -> None:
    rng = np.random.default_rng(9)
    value = PLANT.response(HERTZ) * (1.0 + 0.007 * (rng.standard_normal(60) + 1j * rng.standard_normal(60)))
    bad, off_db = [12, 33, 48], np.array([6.0, -10.0, -6.0])
    value[bad] *= 10.0 ** (off_db / 20.0)
    phase = np.unwrap(np.angle(value)) if with_phase else None
    given = FrequencyResponse(HERTZ, np.abs(value), phase, np.full(60, 0.007), assumed=assumed)
    found = identify_response(given, Asked())
    assert (found.order, found.distrust) == (2, ())
    (remark,) = (remark for remark in found.remarks if "left out" in remark)
    assert all(f"{HERTZ[k]:.5g}" in remark for k in bad)
    off = 20.0 * np.log10(np.abs(found.model.response(HERTZ) / PLANT.response(HERTZ)))
    assert np.max(np.abs(off)) < 0.1
    assert np.all(found.model.band_db(HERTZ[bad]) >= np.abs(off_db) - 0.3)
    assert np.all(np.delete(found.model.band_db(HERTZ), bad) < 0.1)


def test_identify_response__bad_first_of_few__is_a_bad_reading_or_a_pole_and_the_band_holds_both() -> None:
    rng, hertz = np.random.default_rng(0), np.linspace(3.0, 400.0, 21)
    s, w, low = 2j * np.pi * hertz, 2.0 * np.pi * 143.0, np.geomspace(3.0, 20.0, 40)
    value = (
        w**2 / (s**2 + w / 8.6 * s + w**2) * (1.0 + 0.014 * (rng.standard_normal(21) + 1j * rng.standard_normal(21)))
    )
    value[0] *= 5.0
    phase = np.unwrap(np.angle(value))
    found = identify_response(FrequencyResponse(hertz, np.abs(value), phase, np.full(21, 0.01), assumed=True), Asked())
    assert not found.distrust
    off_db = 20.0 * np.log10(np.abs(found.model.response(low)))  # of one
    assert np.all(np.abs(off_db) < found.model.band_db(low) + 0.3)


@pytest.mark.parametrize(
    ("magnitude", "assumed", "order", "reason"),
    [
        (np.abs(PLANT.response(HERTZ)), True, 1, RESPONSE_ALIKE),
        (np.exp(np.random.default_rng(6).standard_normal(HERTZ.size)), False, 2, RESPONSE_OFF),
    ],
)
def test_identify_response__that_the_form_does_not_have__is_not_trusted(magnitude, assumed, order, reason) -> None:
    given = FrequencyResponse(HERTZ, magnitude, np.angle(PLANT.response(HERTZ)), np.full(60, 0.01), assumed=assumed)
    found = identify_response(given, Asked(order=order, zeros=0))
    assert any(reason.name in one for one in found.distrust)


@pytest.mark.parametrize(
    ("frequency", "magnitude", "match"),
    [
        ([1.0, 2.0, 3.0], [1.0, 1.0, 1.0], "4 or more"),
        ([1.0, 3.0, 2.0, 4.0], [1.0] * 4, "ascend"),
        ([1.0, 2.0, 3.0, 4.0], [1.0, -1.0, 1.0, 1.0], "above zero"),
    ],
)
def test_frequency_response__not_one__is_refused(frequency, magnitude, match) -> None:
    with pytest.raises(BadInput, match=match):
        FrequencyResponse(np.array(frequency), np.array(magnitude), None, np.ones(len(magnitude)))
