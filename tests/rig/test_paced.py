"""The rig that takes its time: what it plays is what the rig below plays."""

import numpy as np

from tactuator.rig.paced import PacedRig
from tactuator.rig.rig import join_traces
from tactuator.rig.simulated import SimulatedRig
from tests.runtime.paper_display import controller, display


def test_paced_rig__stream__is_the_stream_of_the_rig_below():
    blocks = np.array_split(20.0 * np.random.default_rng(1).standard_normal((1000, 3)), 4)
    positions = []
    for pace in (lambda rig: rig, lambda rig: PacedRig(rig, speed=1e6)):
        of = display()
        rig = SimulatedRig(of, 1)
        rig.load(controller(of))
        positions.append(join_traces(pace(rig).stream(iter(blocks)), rig.rate_hz, rig.channels).position_v)
    assert np.array_equal(*positions)
    assert len(positions[0]) == 1000


def test_paced_rig__rest_in_a_tone__is_silent_soon_and_lets_go_of_a_motor_that_stands_still():
    of, felt = display(), []
    rig = SimulatedRig(of, 1)
    rig.load(controller(of))
    rig.finger("index").attach(felt.append)
    paced = PacedRig(rig, speed=10.0)
    wave = np.zeros((4000, 3))
    wave[:, 0] = 31.6 * np.sin(2.0 * np.pi * 100.0 * np.arange(4000) / rig.rate_hz)
    stream = paced.stream([wave])
    played = 0
    while played < 1000:
        played += len(next(stream))
    loud = np.abs(np.diff(np.concatenate(felt)[-200:])).max()
    felt.clear()
    paced.rest()
    moved = np.abs(np.diff(np.concatenate(felt)))
    assert loud > 20.0 * moved[60:260].max()  # 15 ms later
    assert loud > 20.0 * moved[260:].max()  # nor when the motor is let go
