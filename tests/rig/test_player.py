"""Playing: progress, pause, a stop that ramps, and rest whatever happens."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, open_reference, write_reference
from tactuator.rig.board.link import Mode
from tactuator.rig.player import play_reference
from tactuator.rig.rig import Trace
from tests.rig.every_rig import free_rig

CHANNELS = ("a", "b")


class Recorder:
    """A rig that keeps what it was given."""

    rate_hz = 4000.0
    channels = CHANNELS

    def __init__(self, fails_after=None):
        self.blocks, self.rests, self.fails_after = [], 0, fails_after

    def load(self, controller):
        pass

    def play(self, reference):
        if self.fails_after is not None and len(self.blocks) == self.fails_after:
            raise OSError("the cable is out")
        self.blocks.append(np.array(reference))
        flat = np.zeros(reference.shape)
        return Trace(self.rate_hz, self.channels, flat, flat, flat, flat > 1)

    def stream(self, blocks):
        return (self.play(block) for block in blocks)

    def drive(self, command_v):
        raise NotImplementedError

    def rest(self):
        self.rests += 1

    @property
    def played(self):
        return np.concatenate(self.blocks)


@pytest.fixture
def reference(tmp_path):
    def write(samples, channels=CHANNELS, rate_hz=4000.0):
        with write_reference(tmp_path / "r.wav", ReferenceHead(rate_hz, channels)) as writer:
            writer.write(samples)
        return open_reference(tmp_path / "r.wav")

    return write


def test_play__to_the_end__every_sample_then_rest(reference):
    samples = np.random.default_rng(0).standard_normal((9001, 2)).astype(np.float32)
    rig, seen = Recorder(), []
    played = play_reference(rig, reference(samples), progress=seen.append)
    np.testing.assert_allclose(rig.played, samples, rtol=1e-5)
    assert rig.rests == 1
    assert (played.stopped, played.paused_s) == (False, 0.0)
    assert played.played_s == pytest.approx(9001 / 4000)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(9001 / 4000)


def test_play__channels_in_another_order__each_to_its_own(reference):
    rig = Recorder()
    play_reference(rig, reference(np.tile([[1.0, 2.0]], (400, 1)), channels=("b", "a")))
    np.testing.assert_allclose(rig.played, np.tile([[2.0, 1.0]], (400, 1)), rtol=1e-6)


@pytest.mark.parametrize("fails_after", [0, 3])
def test_play__fault__rests_and_tells(reference, fails_after):
    rig = Recorder(fails_after)
    with pytest.raises(OSError, match="cable"):
        play_reference(rig, reference(np.ones((4000, 2))))
    assert rig.rests == 1


@pytest.mark.parametrize(
    ("samples", "options", "words"),
    [
        (np.ones((400, 2)), {"rate_hz": 8000.0}, "8000 Hz; allowed: 4000 Hz on this rig"),
        (np.ones((400, 2)), {"channels": ("a", "c")}, "channels a, c"),
        (np.full((400, 2), 600.0), {}, "peak at 55.6 dB SL"),
    ],
)
def test_play__reference_not_for_this_rig__refused_before_anything_moves(reference, samples, options, words):
    rig = Recorder()
    with pytest.raises(BadInput, match=words):
        play_reference(rig, reference(samples, **options))
    assert rig.blocks == []


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


def test_play__free_board__pause_and_stop_ramp_within_100_ms_and_the_board_rests(reference):
    rig, wishes = free_rig(), ["run"] * 10 + ["pause"] * 10 + ["run"] * 10 + ["stop"]
    played, samples = played_of(rig, reference(np.full((12000, 3), 20.0), rig.channels), wishes)
    assert played.stopped
    assert played.paused_s == pytest.approx(8 * 0.05)
    assert played.played_s == pytest.approx((10 + 2 + 10 + 2) * 0.05)
    assert len(samples) == round((played.played_s + played.paused_s) * rig.rate_hz)
    assert np.max(np.abs(np.diff(samples, axis=0))) < 20.0 * np.pi / 2 / 400 * 1.01
    assert np.count_nonzero(~np.any(samples, axis=1)) >= 8 * 200  # while it is held
    assert samples[30 * 200 - 1] == pytest.approx(20.0)  # it goes on where it was
    assert samples[-1] == pytest.approx(0.0, abs=1e-6)
    assert rig.status().mode is Mode.ARMED
    assert rig.status().at_rest
