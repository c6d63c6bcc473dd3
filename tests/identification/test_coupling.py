"""The matrix of responses of a joint record, against a coupled display of second order that SciPy computes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from tactuator.errors import BadInput
from tactuator.identification.coupling import coupled_pairs, coupled_response, own_record
from tactuator.io.model import read_coupling, write_coupling
from tactuator.io.record import read_measured, write_record
from tactuator.signals.multisine import Periods, odd_lines, orthogonal_multisines
from tactuator.signals.record import JointRecord

RATE_HZ, PERIOD, REPEATS = 2000.0, 6000, 3
PLANTS = (([2875.0], [1.0, 94.0, 290.0]), ([2650.0], [1.0, 101.0, 310.0]), ([3020.0], [1.0, 88.0, 275.0]))


def held(system: tuple[list[float], list[float]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    num, den, _ = signal.cont2discrete(system, 1.0 / RATE_HZ)
    return num.ravel(), den


def joint(
    share: float, noise_v: float = 1e-5, experiments: int = 6, waves: NDArray[np.float64] | None = None
) -> JointRecord:
    """A record of three motors; `share` of each one's command acts on its neighbours 3 ms late."""
    rng = np.random.default_rng(4)
    lines = odd_lines((1.0, 300.0), RATE_HZ, PERIOD, 60, rng)
    if waves is None:
        waves = orthogonal_multisines(PERIOD, lines, np.full((3, lines.size), 0.1), experiments, rng)
    command = np.concatenate([np.tile(wave, REPEATS).T for wave in waves])
    late = np.vstack([np.zeros((6, 3)), command[:-6]])
    acting = command + share * (late.sum(axis=1, keepdims=True) - late)
    moved = np.stack([signal.lfilter(*held(plant), acting[:, c]) for c, plant in enumerate(PLANTS)], axis=1)
    moved += rng.normal(0.0, noise_v, moved.shape)
    about = Periods(PERIOD, REPEATS, len(waves), lines).attributes() | {"hold": "zero-order"}
    return JointRecord(RATE_HZ, ("a", "b", "c"), command, moved, about=about)


@pytest.mark.parametrize("level_db", [-20.0, -40.0])
def test_matrix__of_motors_on_one_frame__is_that_of_the_transfer_functions(level_db: float) -> None:
    found = coupled_response(joint(10.0 ** (level_db / 20.0)))
    late = 10.0 ** (level_db / 20.0) * np.exp(-2j * np.pi * found.frequency_hz * 0.003)
    for out, plant in enumerate(PLANTS):
        own = signal.freqz(*held(plant), found.frequency_hz, fs=RATE_HZ)[1]
        for of in range(3):
            error = np.abs(found.value[:, out, of] - own * (1.0 if out == of else late))
            assert np.mean(error < 1.73 * found.deviation[:, out, of]) > 0.85
    for pair in coupled_pairs(found):
        assert pair.is_seen
        assert pair.share_db == pytest.approx(level_db, abs=1.0)


def test_motors_apart__with_noise__say_above_what_there_is_no_coupling() -> None:
    pairs = coupled_pairs(coupled_response(joint(0.0, noise_v=2e-4)))
    assert not any(pair.is_seen for pair in pairs)
    assert max(pair.share_db for pair in pairs) < -20.0
    quieter = coupled_pairs(coupled_response(joint(0.0, noise_v=2e-5)))
    assert max(pair.share_db for pair in quieter) == pytest.approx(max(pair.share_db for pair in pairs) - 20.0, abs=1.0)


def test_own_record__of_a_channel__is_what_it_would_have_been_alone() -> None:
    coupled, alone = joint(0.1, noise_v=0.0), joint(0.0, noise_v=0.0)
    apart = own_record(coupled, coupled_response(coupled), 1)
    plan = Periods(PERIOD, REPEATS, 6, np.array([1]))
    settled, wanted = plan.blocks(apart.position), plan.blocks(alone.position[:, 1])
    assert np.max(np.abs(settled - wanted)) < 1e-3 * np.max(np.abs(wanted))
    assert np.max(np.abs(plan.blocks(coupled.position[:, 1]) - wanted)) > 2e-2 * np.max(np.abs(wanted))


def test_channels__driven_one_after_the_other__are_told_apart_and_all_alike_are_refused() -> None:
    rng = np.random.default_rng(4)
    lines = odd_lines((1.0, 300.0), RATE_HZ, PERIOD, 60, rng)
    wave = orthogonal_multisines(PERIOD, lines, np.full((1, lines.size), 0.1), 1, rng)[0, 0]
    one_by_one = np.stack([np.outer(row, wave) for row in np.eye(3)])
    assert coupled_pairs(coupled_response(joint(0.1, waves=one_by_one)))[0].share_db == pytest.approx(-20.0, abs=0.5)
    with pytest.raises(BadInput, match="driven alike"):
        coupled_response(joint(0.1, waves=np.tile(wave, (3, 3, 1))))


def test_joint_record__without_periods_or_with_too_few_experiments__is_refused() -> None:
    whole = joint(0.1)
    with pytest.raises(BadInput, match="without periods"):
        coupled_response(replace(whole, about={}))
    with pytest.raises(BadInput, match="experiments"):
        coupled_response(replace(whole, about=whole.about | {"realisations": "2"}))
    with pytest.raises(BadInput, match="multiple of 3"):
        joint(0.1, experiments=4)


def test_files__of_joint_record_and_coupling__come_back_as_they_were(tmp_path: Path) -> None:
    taken = joint(0.1)
    write_record(tmp_path / "r.h5", taken)
    back = read_measured(tmp_path / "r.h5")
    assert back.channels == taken.channels
    assert np.array_equal(back.position, taken.position)
    assert np.array_equal(back.command, taken.command)
    write_record(tmp_path / "single.h5", taken.of(0))
    assert np.array_equal(read_measured(tmp_path / "single.h5").command, taken.of(0).command)
    found = coupled_response(back)
    write_coupling(tmp_path / "c.json", found)
    assert read_coupling(tmp_path / "c.json") == found
    (tmp_path / "c.json").write_text((tmp_path / "c.json").read_text().replace('"deviation": [[[', '"deviation": [[[-'))
    with pytest.raises(BadInput, match="coupling"):
        read_coupling(tmp_path / "c.json")
