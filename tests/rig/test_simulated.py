"""The simulated rig: the protocol, its blindness, and its finger ports."""

from dataclasses import fields

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.rig import Trace
from tactuator.rig.simulated import SimulatedRig
from tests.runtime.paper_display import channel, controller, display, lock_in, tone


def loaded_rig(seed: int = 0) -> SimulatedRig:
    of = display()
    rig = SimulatedRig(of, seed)
    rig.load(controller(of))
    return rig


def test_trace__command__is_what_the_motor_gets_delayed_by_the_computation() -> None:
    rig = loaded_rig()
    reference = np.zeros((10, 3))
    reference[0] = 1e3
    trace = rig.play(reference)
    assert np.all(np.abs(trace.command_v[0]) < 1e-3)
    assert np.all(trace.command_v[1] > 1.0)


def test_trace__holds_what_the_processor_knows_and_no_truth() -> None:
    assert [field.name for field in fields(Trace)] == [
        "rate_hz",
        "channels",
        "reference",
        "command_v",
        "position_v",
        "saturated",
    ]
    public = {name for name in dir(SimulatedRig(display())) if not name.startswith("_")}
    does = {"load", "play", "stream", "drive", "rest", "finger", "close"}
    learnt = {"weights"}  # the processor's own: it found them from command and position
    tells = {"display", "rate_hz", "channels", "has_finger_ports", "began_at", "rows_played", "waits", "speed"}
    tells |= {"without_sensor"}
    assert public == tells | learnt | does
    port = {name for name in dir(SimulatedRig(display()).finger("index")) if not name.startswith("_")}
    assert port == {"touch", "press", "attach", "detach"}


def test_finger__attached_feeler__gets_the_displacement_of_each_block() -> None:
    rig, felt = loaded_rig(), []
    rig.finger("thumb").attach(felt.append)
    reference = np.stack([tone(10.0, 2.0, 40.0)] * 3, axis=1)
    traces = [rig.play(reference), rig.play(reference[:4000])]
    assert [block.size for block in felt] == [8000, 4000]
    sensor_mm = abs(lock_in(traces[0].position_v[4000:, 1], 10.0)) / 0.2012
    assert abs(lock_in(felt[0][4000:], 10.0)) == pytest.approx(sensor_mm, rel=1e-2)


def test_finger__touch__takes_level_at_high_frequencies_and_gives_it_back() -> None:
    rig, felt = loaded_rig(), []
    rig.finger("index").attach(felt.append)
    reference = np.stack([tone(32.0, 2.0, 30.0)] * 3, axis=1)
    for load in (None, "finger", None):
        rig.finger("index").touch(load)
        rig.play(reference)
    free, touched, again = (20.0 * np.log10(abs(lock_in(block[4000:], 32.0))) for block in felt)
    assert touched - free == pytest.approx(-1.6, abs=0.4)
    assert again == pytest.approx(free, abs=0.05)


def test_finger__press__moves_that_channel_for_as_long_as_it_lasts() -> None:
    rig, felt = SimulatedRig(display()), []
    rig.finger("middle").attach(felt.append)
    other: list[np.ndarray] = []
    rig.finger("index").attach(other.append)
    rig.finger("middle").press(np.full(6000, 0.5))
    for _ in range(4):
        rig.drive(np.zeros((2500, 3)))
    assert felt[1][-1] > 10.0  # 0.5 V: 27 mm in the end
    assert felt[3][-1] < 0.5 * felt[1][-1]
    assert np.max(np.abs(np.concatenate(other))) == 0.0


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


def test_rest__after_a_loud_tone__display_and_controller_come_to_rest() -> None:
    rig, felt = loaded_rig(), []
    rig.play(np.stack([tone(5.0, 1.13, 45.0)] * 3, axis=1))
    rig.finger("index").attach(felt.append)
    rig.rest()
    assert felt[0].size == 4000
    held_mm = 4e-3 * 2875.0 / 290.0 / 0.19898  # where friction alone holds the motor against its spring
    assert abs(felt[0][-1]) < 1.3 * held_mm < 0.25 * np.max(np.abs(felt[0]))
    silence = rig.play(np.zeros((100, 3)))
    assert np.max(np.abs(silence.command_v)) < 2.0


def test_play__one_channel_as_a_vector__is_taken() -> None:
    of = display(channel())
    rig = SimulatedRig(of)
    rig.load(controller(of))
    assert rig.play(np.zeros(10)).reference.shape == (10, 1)


def test_play__wrong_number_of_channels__is_refused_and_nothing_moves() -> None:
    rig, felt = loaded_rig(), []
    rig.finger("index").attach(felt.append)
    rig.finger("index").press([1.0] * 5)
    with pytest.raises(BadInput, match=r"reference has shape \(10, 2\); allowed: \(samples, 3\)"):
        rig.play(np.zeros((10, 2)))
    assert felt == []
    rig.drive(np.zeros((10, 3)))
    assert felt[0].size == 10
    assert np.max(np.abs(felt[0])) > 0.0  # the press was still to come


def test_trace__unequal_shapes__are_refused() -> None:
    column = np.zeros((4, 1))
    with pytest.raises(BadInput, match=r"trace: position_v has shape \(3, 1\); allowed: \(4, 1\)"):
        Trace(4000.0, ("index",), column, column, column[:3], column.astype(bool))


def test_trace__unknown_channel__is_refused() -> None:
    with pytest.raises(BadInput, match="channel 'ring' is not there"):
        loaded_rig().play(np.zeros((4, 3))).channel("ring")
