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
