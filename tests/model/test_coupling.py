"""What neighbouring lines tell of a coupling: less noise where the shares are smooth, nothing where they are not."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.model.coupling import CoupledResponse, smooth_shares

LINES = np.geomspace(1.0, 300.0, 120)


def measured(share: np.ndarray, deviation: np.ndarray, seed: int) -> CoupledResponse:
    noise = np.random.default_rng(seed).normal(size=(2, LINES.size, 2, 2)) / np.sqrt(2.0)
    unsure = np.repeat(deviation, 4).reshape(-1, 2, 2)
    value = (
        np.eye(2) + share[:, None, None] * (1.0 - np.eye(2)) + (noise[0] + 1j * noise[1]) * unsure * (1.0 - np.eye(2))
    )
    return CoupledResponse(("a", "b"), LINES, value.real, value.imag, unsure)


def frame(resonance_hz: float, damping: float) -> np.ndarray:
    ratio = LINES / resonance_hz
    return np.asarray(0.03 * np.exp(-2j * np.pi * LINES * 0.001) / (1.0 - ratio**2 + 2j * damping * ratio))


@pytest.mark.parametrize("damping", [0.5, 0.2, 0.05])
def test_smooth_shares__of_a_frame__are_nearer_the_truth_and_inside_their_disks(damping: float) -> None:
    share, deviation = frame(45.0, damping), 0.02 * (1.0 + (5.0 / LINES) ** 2)
    inside, gain = [], []
    for seed in range(10):
        given = measured(share, deviation, seed)
        smooth, unsure = (each[:, 0, 1] for each in smooth_shares(given))
        inside.append(np.mean(np.abs(smooth - share) < 1.731 * unsure))
        quiet = LINES > 15.0  # below, the noise is beyond the share, and a line stays as it is
        rough = given.shares()[0][:, 0, 1]
        gain.append(np.sum(np.abs(smooth - share)[quiet] ** 2) / np.sum(np.abs(rough - share)[quiet] ** 2))
    assert np.mean(inside) > 0.9
    assert np.mean(gain) < (0.9 if damping < 0.1 else 0.5)


def test_smooth_shares__of_lines_without_neighbours_that_help__stay_as_measured() -> None:
    rng = np.random.default_rng(2)
    rough = 0.03 * np.exp(2j * np.pi * rng.uniform(size=LINES.size))  # another phase at every line
    given = measured(rough, np.full(LINES.size, 1e-3), 3)
    smooth, unsure = (each[:, 0, 1] for each in smooth_shares(given))
    assert np.mean(np.abs(smooth - rough) < 1.731 * unsure) > 0.9


@pytest.mark.parametrize("key", ["real", "imag", "deviation"])
def test_coupled_response__with_a_matrix_of_another_shape__is_refused(key: str) -> None:
    parts = {name: np.tile(np.eye(2), (9, 1, 1)) for name in ("real", "imag", "deviation")}
    with pytest.raises(BadInput, match=key):
        CoupledResponse(("a", "b"), np.geomspace(1.0, 9.0, 9), **(parts | {key: np.ones((8, 2, 2))}))
