"""Measuring on a board whose time goes on: a tone is one stream, and what is between blocks is no response."""

import numpy as np
import pytest

from tactuator.measure.options import MeasurementOptions
from tactuator.measure.response import multisine_response, stepped_sine
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import InProcess
from tests.rig.guard.guarded import designed


def stepped(rig):
    return stepped_sine(rig, [20.0, 200.0], MeasurementOptions(35.0, longest_s=4.0, confidence_db=0.05))


def multisine(rig):
    return multisine_response(
        rig, [20.0, 55.0], MeasurementOptions(35.0, longest_s=2.0, confidence_db=0.05), np.random.default_rng(2)
    )


@pytest.mark.parametrize("measure", [stepped, multisine])
def test_measure__free_board__agrees_with_the_simulated_display(measure):
    made = designed()
    free = BoardRig(LinkClient(InProcess()), made.display, waits=False, sleep=lambda seconds: None)
    free.simulate(1)
    free.load(made)
    simulated = SimulatedRig(made.display, 2)
    simulated.load(made)
    for found, wanted in zip(measure(free), measure(simulated), strict=True):
        bound = found.confidence_db + wanted.confidence_db + 0.03  # float32 on the board
        assert np.all(np.abs(found.magnitude_db - wanted.magnitude_db) < bound)
        assert np.all(np.abs(found.phase_rad - wanted.phase_rad) < 0.02)
