"""Playing on a board whose time goes on: pause and stop ramp, without a gap, and a fault leaves the board at rest."""

import numpy as np
import pytest

from tactuator.io.reference import ReferenceHead, open_reference, write_reference
from tactuator.rig.board.link import LinkClient, Mode, RigFault
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.player import play_reference
from tactuator.rig.transport import InProcess

RATE_HZ = 4000.0


@pytest.fixture
def rig(controller):
    """Its time goes on by 32 ticks with every request."""
    made = BoardRig(LinkClient(InProcess()), controller.display, waits=False, sleep=lambda seconds: None)
    made.simulate(1)
    made.load(controller)
    return made


@pytest.fixture
def reference(controller, tmp_path):
    names = tuple(channel.name for channel in controller.display.channels)
    with write_reference(tmp_path / "r.h5", ReferenceHead(RATE_HZ, names)) as writer:
        writer.write(np.full((12000, len(names)), 20.0))
    return open_reference(tmp_path / "r.h5")


def played_of(rig, reference, wishes):
    """What was played, and what the rig's trace says of the reference."""
    traces = []
    stream = rig.stream

    def kept(blocks):
        for trace in stream(blocks):
            traces.append(trace.reference)
            yield trace

    rig.stream = kept
    asked = iter(wishes)
    played = play_reference(rig, reference, lambda: next(asked, wishes[-1]))
    return played, np.concatenate(traces)


def test_play__free_board__pause_and_stop_ramp_within_100_ms_and_the_board_rests(rig, reference):
    wishes = ["run"] * 10 + ["pause"] * 10 + ["run"] * 10 + ["stop"]
    played, samples = played_of(rig, reference, wishes)
    assert played.stopped
    assert played.paused_s == pytest.approx(8 * 0.05)
    assert played.played_s == pytest.approx((10 + 2 + 10 + 2) * 0.05)
    assert len(samples) == round((played.played_s + played.paused_s) * RATE_HZ)
    assert np.max(np.abs(np.diff(samples, axis=0))) < 20.0 * np.pi / 2 / 400 * 1.01
    assert samples[-1] == pytest.approx(0.0, abs=1e-6)
    assert rig.status().mode is Mode.ARMED
    assert rig.status().at_rest


def test_play__free_board__sensor_fails__is_told_and_the_board_rests(rig, reference):
    rig.break_sensor(rig.channels[0], "open")
    with pytest.raises(RigFault, match="sensor open"):
        play_reference(rig, reference)
    assert rig.status().at_rest
