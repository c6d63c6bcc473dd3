"""What rigs and the link refuse or survive; playing: progress, pause, a stop that ramps, and rest whatever happens."""

import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, open_reference, write_reference
from tactuator.rig.board.link import ANSWER, STREAM, Frame, LinkClient, Mode, Request, RequestOutcome, frame_bytes
from tactuator.rig.open import in_process_rig
from tactuator.rig.player import play_reference
from tactuator.rig.rig import Trace, usual_load
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import LinkDown, SerialPort
from tactuator.runtime._core import lib
from tactuator.runtime.simulation import REFERENCE_MAX, take_reference
from tests.rig.every_rig import free_rig
from tests.rig.guard.guarded import designed


@pytest.mark.parametrize(("bits", "polarity"), [(12, 1), (24, 1), (24, -1)])
def test_drive__command_at_its_limit__keeps_its_sign(bits: int, polarity: int) -> None:
    """24 bits: a code one beyond the last came out as the first."""
    made = designed().display
    channels = []
    for channel in made.channels:
        converter = replace(channel.converter, bits=bits, polarity=polarity, offset_v=0.0)
        channels.append(replace(channel, converter=converter))
    of = replace(made, channels=tuple(channels))
    for volts in (9.99, 50.0, -9.99, -50.0):
        with in_process_rig(of, 1) as rig:
            ours = rig.drive(np.full((6, 3), volts)).command_v[-1]
        wanted = SimulatedRig(of, 1).drive(np.full((6, 3), volts)).command_v[-1]
        np.testing.assert_allclose(ours, wanted, atol=max(2e-4, 40.0 / 2**bits))


def test_start__number_far_ahead__is_refused_and_uses_up_none() -> None:
    with in_process_rig(designed().display, 1) as rig:
        rig.load(designed())
        rig.rest()
        board = rig.client._transport.board
        assert lib.tact_board_arm(board)
        for run in (0, 0xFFFFFFFF, 0x80000000, 70000):
            assert not lib.tact_board_start(board, run, STREAM, 0, 1)
        board.run = 0xFFFFFFFE
        assert len(rig.play(np.zeros((20, 3)))) == 20
        rig.rest()
        assert len(rig.play(np.zeros((20, 3)))) == 20
        assert rig.status().run == 0


class Chatter:
    """A port that speaks all the time and never answers."""

    def __init__(self) -> None:
        self.now_s, self.sent = 0.0, 0

    def send(self, content: bytes) -> None:
        self.sent += 1

    def receive(self, timeout_s: float) -> bytes:
        self.now_s += min(0.1, max(timeout_s, 1e-3))
        return b"T=21.3 C\r\n"

    def close(self) -> None:
        """Nothing is held."""


class Zeros(Chatter):
    def receive(self, timeout_s: float) -> bytes:
        return b"\0" * len(super().receive(timeout_s))


@pytest.mark.parametrize(("port", "given_up_s"), [(Chatter(), 6.0), (Zeros(), 4.1)])
def test_ask__port_that_chatters_or_sends_zeros__is_given_up_after_its_time(port: Chatter, given_up_s: float) -> None:
    client = LinkClient(port, answer_s=2.0, tries=3, clock=lambda: port.now_s)
    with pytest.raises(LinkDown, match="the board does not answer"):
        client.status()
    assert port.sent == 3
    assert port.now_s == pytest.approx(given_up_s, abs=0.5)


class Restarted(Chatter):
    """A board that loses the first request, since it begins anew, and answers the second."""

    def receive(self, timeout_s: float) -> bytes:
        if self.sent == 1:
            self.now_s += 0.01
            return b"\0"
        self.now_s += min(0.1, max(timeout_s, 1e-3))
        return frame_bytes(Frame(Request.ARM | ANSWER, 1, bytes([RequestOutcome.NOT_IN_THIS_MODE])))


def test_ask__board_that_begins_anew__is_asked_again_at_once() -> None:
    port = Restarted()
    client = LinkClient(port, answer_s=100.0, clock=lambda: port.now_s)
    assert client.ask(Request.ARM) == (RequestOutcome.NOT_IN_THIS_MODE, b"")
    assert port.sent == 2
    assert port.now_s < 1.0


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_stream__blocks_that_fail__leave_the_output_at_rest(error: type[BaseException]) -> None:
    def blocks():
        yield np.full((2000, 3), 100.0)
        raise error

    with in_process_rig(designed().display, 1) as rig:
        rig.load(designed())
        with pytest.raises(error):
            list(rig.stream(blocks()))
        assert rig.status().mode is Mode.ARMED
        assert rig.status().at_rest


def test_serial__port_that_another_program_has__is_refused_until_it_is_free() -> None:
    ours, theirs = os.openpty()
    name = os.ttyname(theirs)
    first = SerialPort(name)
    with pytest.raises(LinkDown, match=r"in use by another program.*free"):
        SerialPort(name)
    first.close()
    SerialPort(name).close()
    os.close(ours)
    os.close(theirs)


def channels(*names):
    return [SimpleNamespace(loads=[SimpleNamespace(name=name) for name in own]) for own in names]


@pytest.mark.parametrize(
    ("described", "load"),
    [
        ([["fingertip"]], "fingertip"),
        ([["palm", "finger"]], "finger"),
        ([["palm", "tip"], ["tip", "palm"]], "palm"),
        ([["finger", "tip"], ["tip"]], "tip"),
        ([[], []], "none"),
    ],
)
def test_usual_load__nobody_names_one__finger_or_the_first_that_all_have(described, load):
    assert usual_load(channels(*described)) == load


def test_usual_load__none_in_common__is_refused():
    with pytest.raises(BadInput, match="`load`"):
        usual_load(channels(["palm"], ["tip"]))


SIXTY_DB_SL = 10.0 ** (60.0 / 20.0)


@pytest.mark.parametrize("value", [SIXTY_DB_SL, -SIXTY_DB_SL, np.nextafter(REFERENCE_MAX, 2.0 * REFERENCE_MAX), 5e-324])
def test_take_reference__what_single_precision_takes_for_the_largest__is_taken(value: float) -> None:
    assert take_reference(np.array([[value]]))[0, 0] == value


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
        (np.ones((400, 2)), {"rate_hz": 8000.0}, "8000 Hz; expected 4000 Hz on this rig"),
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
