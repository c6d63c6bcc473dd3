"""The simulated display shows what the paper saw on the real one (design.md, "The simulated display")."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactuator.runtime.simulation import SimulatedBlock, Simulation
from tests.runtime.paper_display import RATE_HZ, channel, controller, display, lock_in, tone


def proportional(gain: float) -> SimulatedBlock:
    """Ten seconds of no reference under a proportional controller."""
    of = display(channel())
    simulation = Simulation(of, seed=6)
    paper = controller(of)
    constant = np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    sections = constant * np.array([gain, 1.0, 1.0, 1.0, 1.0, 1.0])
    simulation.load(
        replace(paper, channels=(replace(paper.channels[0], prefilter_sos=constant, feedback_sos=sections),))
    )
    return simulation.play(np.zeros((44_000, 1)))


def felt_mm(block: SimulatedBlock) -> NDArray[np.float64]:
    return block.displacement_mm[4000:, 0]


def resonance_hz(felt: NDArray[np.float64]) -> float:
    """Where the felt noise peaks, away from mains."""
    frequency, density = signal.welch(felt, RATE_HZ, nperseg=8000)
    away = np.min(np.abs(frequency[:, None] - np.array([60.0, 120.0, 180.0])), axis=1) > 2.0
    band = away & (frequency > 5.0) & (frequency < 400.0)
    return float(frequency[band][np.argmax(density[band])])


def test_proportional_control__rising_gain__hum_and_resonance_rise_above_threshold() -> None:
    gains = (5.0, 40.0, 120.0)
    felt = [felt_mm(proportional(gain)) for gain in gains]
    hum_mm = [abs(lock_in(each, 60.0)) for each in felt]
    assert hum_mm[0] < hum_mm[1] < hum_mm[2]
    threshold_mm = channel().threshold.curve.displacement_mm(np.array([60.0]))[0]
    assert hum_mm[0] < threshold_mm < hum_mm[2]
    peaks = [resonance_hz(each) for each in felt[1:]]
    assert 30.0 < peaks[0] < peaks[1] < 150.0


def test_friction__small_low_reference__is_eaten_and_a_larger_one_is_not() -> None:
    of = display(channel())
    levels_db = []
    for level_db_sl in (0.0, 30.0):
        simulation = Simulation(of, seed=1)
        simulation.load(controller(of))
        felt = simulation.play(tone(8.0, 24.0, level_db_sl)[:, None]).displacement_mm[16000:, 0]
        levels_db.append(20.0 * np.log10(abs(lock_in(felt, 8.0))) - level_db_sl)
    assert levels_db[0] < levels_db[1] - 0.5


def test_position__threshold_at_300_hz__is_below_a_converter_step_and_found_by_averaging() -> None:
    of = display(channel())
    simulation = Simulation(of, seed=1)
    simulation.load(controller(of))
    block = simulation.play(tone(300.0, 42.0)[:, None])
    position, felt = block.position_v[8000:, 0], block.displacement_mm[8000:, 0]
    true_v = 0.19898 * lock_in(felt, 300.0)
    assert abs(true_v) < 0.1 * 20.0 / 65536
    assert abs(lock_in(position, 300.0) - true_v) < 0.2 * abs(true_v)
