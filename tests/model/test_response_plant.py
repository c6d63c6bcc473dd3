"""A plant of magnitudes alone, held against actuators with no rational model behind them, at frequencies left out."""

from functools import cache

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.model.response_plant import ResponsePlant, plant_of_response
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.record import FrequencyResponse
from tests.model.beams import Beam, drawn

BAND = np.geomspace(8.0, 300.0, 3000)


def measured(beam: Beam, points: int, noise_db: float = 0.0) -> FrequencyResponse:
    frequency = np.geomspace(7.9, 305.0, points)
    noise = 10.0 ** (noise_db * np.random.default_rng(points).standard_normal(points) / 20.0)
    deviation = np.full(points, max(noise_db / 8.686, 1e-3))
    return FrequencyResponse(frequency, np.abs(beam.response(frequency)) * noise, None, deviation)


@cache
def followed(beam: Beam, points: int, noise_db: float = 0.0) -> ResponsePlant:
    return plant_of_response(measured(beam, points, noise_db))


def off_db(beam: Beam, found: ResponsePlant) -> float:
    return float(np.max(np.abs(db(np.abs(found.system.response(BAND)) / np.abs(beam.response(BAND))))))


@pytest.mark.parametrize("beam", [Beam(25.0, 0.1), Beam(90.0, 0.06, 400.0, 0.2)], ids=["three", "eddy"])
def test_plant_of_response__beam__followed_between_the_points(beam: Beam) -> None:
    found = followed(beam, 90)
    assert found.system.is_stable
    assert off_db(beam, found) < 0.2
    assert found.valid_hz == pytest.approx((7.9, 305.0))


def test_plant_of_response__notch_at_the_end__not_filled_by_images() -> None:
    """What lies beyond the points is a guess, and must not fold back into a deep notch through the sampling."""
    beam = Beam(67.0, 0.147, 519.0, 0.2)
    plant = plant_of_response(measured(beam, 80, 0.1)).system
    held = np.abs(plant.response(BAND) * np.sinc(BAND / 8000.0))
    assert np.max(np.abs(db(np.abs(discretise(plant, 8000.0, "zoh", 1).response(BAND)) / held))) < 0.1


def test_plant_of_response__noise_of_a_tenth_db__no_more_poles_than_it_bears() -> None:
    found = followed(Beam(), 90, 0.1)
    assert off_db(Beam(), found) < 0.6
    assert found.system.poles.size <= followed(Beam(), 90).system.poles.size
    assert found.error_db < 0.8 < followed(Beam(), 25, 0.1).error_db


def test_plant_of_response__too_few_points_for_its_notches__says_so() -> None:
    """Twelve points over two modes: what lies between is missed by decibels, and the figure says it."""
    assert off_db(Beam(), followed(Beam(), 12)) > 3.0
    assert followed(Beam(), 12).error_db > 3.0


@pytest.mark.parametrize(("points", "which"), [(40, 30), (40, 53), (80, 7)])
def test_plant_of_response__beam_between_its_points__no_farther_off_than_it_says(points: int, which: int) -> None:
    """Those of 60 beams that are the farthest off at 40 points, by 1.4 to 3.0 dB: one of them used to be called met."""
    rng = np.random.default_rng(0)
    for _ in range(which + 1):
        beam, frequency = drawn(rng), np.geomspace(7.9, 305.0, points)
        noise = 10.0 ** (0.1 * rng.standard_normal(points) / 20.0)
    given = FrequencyResponse(
        frequency, np.abs(beam.response(frequency)) * noise, None, np.full(points, 0.1 * np.log(10.0) / 20.0)
    )
    found = plant_of_response(given)
    assert off_db(beam, found) <= found.error_db
    assert found.unsure_hz[0] in frequency
    assert found.unsure_hz[1] in frequency


def test_plant_of_response__nothing_follows__refused() -> None:
    with pytest.raises(BadInput, match="more points where it turns sharply"):
        plant_of_response(measured(Beam(25.0, 0.02), 12))


def test_plant_of_response__a_phase__changes_nothing() -> None:
    bare = measured(Beam(), 40)
    turned = FrequencyResponse(bare.frequency_hz, bare.magnitude, np.linspace(0.0, -9.0, 40), bare.deviation)
    assert np.array_equal(plant_of_response(turned).system.poles, plant_of_response(bare).system.poles)
