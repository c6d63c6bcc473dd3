"""Coupled channels of the simulated display: nothing without a coupling, the frame's own response with one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from tactuator.errors import BadInput
from tactuator.model.coupling import Coupling
from tactuator.model.description import Converter, Display
from tactuator.runtime.simulation import Simulation
from tests.runtime.paper_display import QUIET, RATE_HZ, channel, controller, display

FINE = Converter(bits=24, range_v=100.0)


def three(coupling: Coupling | None = None) -> Display:
    one = replace(channel(), environment=QUIET, converter=FINE)
    channels = tuple(replace(one, name=name, finger=name) for name in ("index", "thumb", "middle"))
    of = replace(display(one), channels=channels)
    return of if coupling is None else replace(of, coupling=coupling)


def test_coupling__of_a_frame__moves_the_neighbours_as_scipy_computes_it() -> None:
    coupling = Coupling(level_db=-20.0, resonance_hz=90.0, damping=0.2)
    command = np.zeros((2000, 3))
    command[:, 1] = np.random.default_rng(1).normal(0.0, 2.0, 2000)
    moved = Simulation(three(coupling)).drive(command).displacement_mm * 0.19898
    omega = 2.0 * np.pi * 90.0
    held = signal.cont2discrete(([omega**2], [1.0, 0.4 * omega, omega**2]), 1.0 / RATE_HZ)
    plant = signal.cont2discrete(([2875.0], [1.0, 94.0, 290.0]), 1.0 / RATE_HZ)
    arrived = 0.1 * signal.lfilter(held[0].ravel(), held[1], command[:, 1])
    for source, at in ((command[:, 1], 1), (arrived, 0), (arrived, 2)):
        told = signal.lfilter(plant[0].ravel(), plant[1], source)
        assert moved[:, at] == pytest.approx(told, abs=2e-5 * np.max(np.abs(told)) + 1e-5)


def test_coupling__none__leaves_every_bit_and_a_frame_changes_them() -> None:
    reference = np.random.default_rng(2).normal(0.0, 3.0, (1000, 3))
    played = []
    for of in (three(), three(Coupling()), three(Coupling(level_db=-40.0))):
        simulation = Simulation(of)
        simulation.load(controller(of, command_v=90.0))
        played.append(simulation.play(reference).displacement_mm)
    assert np.array_equal(played[0], played[1])
    assert not np.array_equal(played[0], played[2])


@pytest.mark.parametrize("level_db", [0.0, 3.0])
def test_coupling__as_strong_as_the_motor_itself__is_refused(level_db: float) -> None:
    with pytest.raises(BadInput, match="level_db"):
        Coupling(level_db=level_db)
