"""What is told of records that friction shapes, against the truth of a generator that is not the tool's."""

import numpy as np
import pytest

from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.signals.record import Record
from tests.identification.rubbing_motor import DAMPING, GAIN, RATE_HZ, rubbing_motor, true_response


def found_in(coulomb: float, presliding: float, seed: int, method: str = "refined", late: int = 0) -> Identification:
    command, position = rubbing_motor(coulomb, presliding, seed)
    return identify(Record(RATE_HZ, command[late:], position[: position.size - late]), method=method)


def share_inside(found: Identification) -> float:
    assert found.model.valid_hz is not None
    frequency = np.geomspace(*found.model.valid_hz, 200)
    error = np.abs(20.0 * np.log10(np.abs(found.model.response(frequency) / true_response(frequency))))
    return float(np.mean(error <= found.model.band_db(frequency)))


@pytest.mark.parametrize(("coulomb", "seed", "late"), [(0.02, 1, 0), (0.1, 2, 0), (0.05, 7, 20)])
def test_identify__friction_that_builds_up_between_samples__level_inside_and_distance_cannot_be_told(
    coulomb: float, seed: int, late: int
) -> None:
    found = found_in(coulomb, 5e-3, seed, late=late)
    assert found.friction is not None
    assert abs(found.friction.coulomb - coulomb) <= found.friction.confidence
    assert found.friction.presliding is None
    assert "presliding" not in found.model.friction


def test_identify__friction_that_builds_up_slowly__level_inside_its_interval_and_distance_is_told() -> None:
    found = found_in(0.1, 0.1, 3)
    assert found.friction is not None
    assert abs(found.friction.coulomb - 0.1) <= found.friction.confidence < 0.01
    assert found.friction.presliding == pytest.approx(0.1, rel=0.2)
    # without a needless pole: it was three poles and a zero beside one of them
    assert found.mass_and_viscous is not None
    for (value, half_width), truth in zip(found.mass_and_viscous, (1.0 / GAIN, DAMPING / GAIN), strict=True):
        assert abs(value - truth) <= half_width < 0.01 * truth


def test_identify__friction_of_a_third_of_the_command__is_not_trusted() -> None:
    found = found_in(0.4, 5e-3, 4)
    assert bool(found.distrust) or share_inside(found) > 0.9


@pytest.mark.parametrize(("coulomb", "seed"), [(0.02, 5), (0.1, 6)])
def test_identify__recursion_under_friction__truth_inside_its_band_or_not_trusted(coulomb: float, seed: int) -> None:
    found = found_in(coulomb, 5e-3, seed, method="rls")
    assert abs(found.model.den[1] - DAMPING) > 0.5
    assert found.distrust or share_inside(found) > 0.9
