"""What is told of records that friction shapes, against the truth of a generator that is not the tool's."""

import numpy as np
import pytest

from tactuator.identification.friction import ruled_by_friction
from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.identification.trust import RULED
from tactuator.signals.record import Record
from witnesses.identification.motors import drawn, recorded
from witnesses.identification.rubbing import judged

RATE_HZ = 2500.0
GAIN, DAMPING, STIFFNESS = 5200.0, 60.0, 900.0


def rubbing_motor(coulomb: float, presliding: float, seed: int, seconds: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    """Return command and position of GAIN/(s² + DAMPING s + STIFFNESS) with Dahl's friction, four steps a sample."""
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    command = 0.6 * np.sign(np.sin(2 * np.pi * 0.45 * time + random.uniform(0, 6)))
    for frequency in np.geomspace(0.3, 300.0, 26):
        command += random.uniform(0.13, 0.26) * np.cos(2 * np.pi * frequency * time + random.uniform(0, 6))
    position, h, slope = np.empty(time.size), 1.0 / RATE_HZ / 4, coulomb / presliding
    x = v = z = 0.0

    def rates(x: float, v: float, z: float) -> tuple[float, float, float]:
        return v, GAIN * (asked - z) - DAMPING * v - STIFFNESS * x, slope * (v - abs(v) * z / coulomb)

    for index in range(command.size):
        position[index], asked = x, float(command[index])
        for _ in range(4):
            a1, a2, a3 = rates(x, v, z)
            b1, b2, b3 = rates(x + h / 2 * a1, v + h / 2 * a2, z + h / 2 * a3)
            c1, c2, c3 = rates(x + h / 2 * b1, v + h / 2 * b2, z + h / 2 * b3)
            d1, d2, d3 = rates(x + h * c1, v + h * c2, z + h * c3)
            x += h / 6 * (a1 + 2 * b1 + 2 * c1 + d1)
            v += h / 6 * (a2 + 2 * b2 + 2 * c2 + d2)
            z += h / 6 * (a3 + 2 * b3 + 2 * c3 + d3)
    return command, position + 3e-4 * random.standard_normal(time.size)


def true_response(frequency_hz: np.ndarray) -> np.ndarray:
    s = 2j * np.pi * np.asarray(frequency_hz)
    return GAIN / (s * s + DAMPING * s + STIFFNESS)


def found_in(
    coulomb: float, presliding: float, seed: int, method: str = "refined", late: int = 0, seconds: float = 5.0
) -> Identification:
    command, position = rubbing_motor(coulomb, presliding, seed, seconds)
    return identify(Record(RATE_HZ, command[late:], position[: position.size - late]), method=method)


def share_inside(found: Identification) -> float:
    frequency = np.geomspace(*found.model.valid_hz, 200)
    error = np.abs(20.0 * np.log10(np.abs(found.model.response(frequency) / true_response(frequency))))
    return float(np.mean(error <= found.model.band_db(frequency)))


@pytest.mark.parametrize(("coulomb", "seed", "late"), [(0.1, 2, 0), pytest.param(0.05, 7, 20, marks=pytest.mark.slow)])
def test_identify__friction_within_a_sample__distance_cannot_be_told(coulomb: float, seed: int, late: int) -> None:
    found = found_in(coulomb, 5e-3, seed, late=late)
    assert abs(found.friction.coulomb - coulomb) <= found.friction.confidence
    assert found.friction.presliding is None
    assert "presliding" not in found.model.friction


def test_identify__friction_that_builds_up_slowly__level_and_distance_are_found() -> None:
    command, position = rubbing_motor(0.1, 0.1, 3)
    hum = 1e-3 * np.sin(2.0 * np.pi * 60.0 * np.arange(command.size) / RATE_HZ)
    found = identify(Record(RATE_HZ, command, position + hum))
    assert abs(found.friction.coulomb - 0.1) <= found.friction.confidence < 0.01
    assert found.friction.presliding == pytest.approx(0.1, rel=0.2)
    # without a needless pole: it was three poles and a zero beside one of them
    for (value, half_width), truth in zip(found.mass_and_viscous, (1.0 / GAIN, DAMPING / GAIN), strict=True):
        assert abs(value - truth) <= half_width < 0.01 * truth
    hertz = np.geomspace(0.4, 300.0, 100)
    assert np.max(np.abs(np.log(np.abs(found.model.response(hertz) / true_response(hertz))))) < 0.01


@pytest.mark.parametrize("seed", [pytest.param(28, marks=pytest.mark.slow), 34])  # the other way round
def test_identify__resonance_that_rubs__truth_inside_its_band(seed: int) -> None:
    assert judged(seed)[0] == "ok"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [92, 39, 67])
def test_identify__friction_that_no_band_knew_of__is_in_the_band_or_not_trusted(seed: int) -> None:
    # 92 was 13.6 dB off and trusted: sticking, it reverses at other times than the fit's own path
    assert judged(seed)[0] != "WRONG"


@pytest.mark.slow
def test_identify__friction_of_a_third_of_the_command__is_not_trusted() -> None:
    found = found_in(0.4, 5e-3, 4, seconds=5.0)
    assert bool(found.distrust) or share_inside(found) > 0.9


def test_identify__recursion_under_friction__truth_inside_its_band_or_not_trusted() -> None:
    found = found_in(0.1, 5e-3, 6, method="rls", seconds=8.0)
    assert abs(found.model.den[1] - DAMPING) > 0.5
    assert found.distrust or share_inside(found) > 0.9
    assert judged(19, "rls")[0] == "refused"


@pytest.mark.parametrize("sprung", [False, True])
def test_ruled_by_friction__motors__free_ones_in_a_position_loop_alone(sprung: bool) -> None:
    rng = np.random.default_rng(5)
    forces, positions = recorded(drawn(rng, 4, sprung=sprung), rng, seconds=6.0, steps=3)
    records = [Record(1000.0, force, place) for force, place in zip(forces.T, positions.T, strict=True)]
    ruled = [100.0 * ruled_by_friction(record) > RULED.limit for record in records]
    assert ruled == [not sprung] * 4
