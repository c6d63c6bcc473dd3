"""The simulated rig: the protocol, its blindness, and its finger ports."""

from dataclasses import fields

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.model.description import Display
from tactuator.rig.rig import Trace, join_traces
from tactuator.rig.simulated import PacedRig, SimulatedRig
from tests.runtime.paper_display import channel, controller, display

THREE = display()


def loaded_rig(seed: int = 0, of: Display = THREE) -> SimulatedRig:
    rig = SimulatedRig(of, seed)
    rig.load(controller(of))
    return rig


def test_trace__holds_what_the_processor_knows_and_no_truth() -> None:
    names = "rate_hz channels reference command_v position_v saturated"
    assert [field.name for field in fields(Trace)] == names.split()
    port = {name for name in dir(SimulatedRig(display()).finger("index")) if not name.startswith("_")}
    assert port == {"touch", "load", "press", "attach", "detach"}


def test_finger__press_twice__adds_up() -> None:
    twice, once = SimulatedRig(display()), SimulatedRig(display())
    results = []
    for rig, presses in ((twice, ([0.25] * 300, [0.25] * 500)), (once, ([0.5] * 300 + [0.25] * 200,))):
        felt: list[np.ndarray] = []
        rig.finger("index").attach(felt.append)
        for press in presses:
            rig.finger("index").press(press)
        rig.drive(np.zeros((600, 3)))
        results.append(felt[0])
    assert np.array_equal(*results)


def test_play__one_channel_as_a_vector__is_taken() -> None:
    assert loaded_rig(of=display(channel())).play(np.zeros(10)).reference.shape == (10, 1)


def test_trace__unequal_shapes__are_refused() -> None:
    column = np.zeros((4, 1))
    with pytest.raises(BadInput, match=r"trace: position_v has shape \(3, 1\); allowed: \(4, 1\)"):
        Trace(4000.0, ("index",), column, column, column[:3], column.astype(bool))


def test_paced_rig__stream__is_the_stream_of_the_rig_below():
    blocks = np.array_split(20.0 * np.random.default_rng(1).standard_normal((1000, 3)), 4)
    positions = []
    for pace in (lambda rig: rig, lambda rig: PacedRig(rig, speed=1e6)):
        rig = loaded_rig(1)
        positions.append(join_traces(pace(rig).stream(iter(blocks)), rig.rate_hz, rig.channels).position_v)
    assert np.array_equal(*positions)
    assert len(positions[0]) == 1000


def test_paced_rig__rest_in_a_tone__is_silent_soon_and_lets_go_of_a_motor_that_stands_still():
    rig, felt = loaded_rig(1), []
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
