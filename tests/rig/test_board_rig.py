"""One suite for every board that can run: in this process, in the emulator, at a port, behind a lossy line."""

from contextlib import contextmanager

import numpy as np
import pytest

from tactuator.digital.wired_display import wired_display_bytes
from tactuator.errors import BadInput
from tactuator.rig.board import BoardRig
from tactuator.rig.emulated import emulated_rig, in_process_rig, wired_rig
from tactuator.rig.link import LinkClient, Mode, RigFault
from tactuator.rig.open import open_rig
from tactuator.rig.protocol import Rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.trace import join_traces
from tactuator.rig.transport import InProcess
from tests.rig.emulated_ports import socket_board
from tests.rig.guarded import designed


class Lossy(InProcess):
    """Frames lost, spoilt, doubled, cut and kept back, by a seed."""

    def __init__(self, seed=1):
        super().__init__()
        self.rng = np.random.default_rng(seed)
        self.kept = b""

    def send(self, content):
        chance = self.rng.random()
        if chance < 0.04:
            return
        if chance < 0.08:
            content = content[: len(content) // 2] + b"\x00"
        elif chance < 0.12:
            spoilt = bytearray(content)
            spoilt[self.rng.integers(len(spoilt))] ^= 1 << int(self.rng.integers(8))
            content = bytes(spoilt)
        elif chance < 0.2:
            content = content + content
        elif chance < 0.25:
            content, self.kept = self.kept + content, content
        elif chance < 0.3:
            content = bytes(self.rng.integers(0, 256, 40, dtype=np.uint8)) + b"\0" + content
        super().send(content)

    def receive(self, timeout_s):
        content = super().receive(timeout_s)
        return b"" if self.rng.random() < 0.03 else content


def lossy_rig(display):
    transport = Lossy()
    client = LinkClient(transport, 0.01)
    rig = BoardRig(client, display)
    content, loads = wired_display_bytes(display, 1)
    rig.wire(content, loads)
    return rig


@contextmanager
def socket_rig(display):
    with socket_board() as (url, _), open_rig(f"board:{url}", display, 1) as rig:
        yield rig


RIGS = {
    "in-process": lambda display: in_process_rig(display, 1),
    "lossy": lossy_rig,
    "emulated:mps2-an500": lambda display: emulated_rig("mps2-an500", display, 1),
    "board:socket": socket_rig,
}


@pytest.fixture(scope="module", params=list(RIGS))
def rig(request):
    with RIGS[request.param](designed().display) as made:
        yield made


def begin(rig):
    """The display as it was in the beginning, and the controller: no test leans on the one before."""
    rig.off()
    rig.wire(*wired_display_bytes(designed().display, 1))
    rig.load(designed())


def tones(count=1200):
    time_s = np.arange(count) / 4000.0
    return np.stack([100.0 * np.sin(2.0 * np.pi * f * time_s) for f in (7.0, 53.0, 201.0)], axis=1)


@pytest.fixture(scope="module")
def expected():
    with in_process_rig(designed().display, 1) as rig:
        rig.load(designed())
        return [rig.play(tones()), rig.play(tones(500))]


def test_rig__two_blocks__are_bit_for_bit_those_of_this_machine(rig, expected):
    assert isinstance(rig, Rig)
    begin(rig)
    for block, wanted in zip((tones(), tones(500)), expected, strict=True):
        trace = rig.play(block)
        assert np.array_equal(trace.position_v, wanted.position_v)
        assert np.array_equal(trace.command_v, wanted.command_v)


def test_rig__stream__is_bit_for_bit_what_the_blocks_are(rig, expected):
    begin(rig)
    blocks = np.array_split(np.concatenate([tones(), tones(500)]), 9)
    found = join_traces(rig.stream(iter(blocks)), rig.rate_hz, rig.channels)
    wanted = join_traces(expected, rig.rate_hz, rig.channels)
    for name in ("position_v", "command_v", "saturated"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name))
    assert np.array_equal(found.reference, wanted.reference)


def test_rig__stream_left_early__goes_on_in_the_next(rig):
    begin(rig)
    next(rig.stream(tones(400) for _ in range(20)))
    assert len(rig.play(tones(300))) == 300
    assert rig.status().mode is Mode.RUNNING


def test_rig__touched_and_pressed__is_felt(rig):
    begin(rig)
    finger, felt = rig.finger("index"), []
    finger.attach(felt.append)
    finger.touch("finger")
    finger.press(np.full(200, 0.5))
    rig.play(np.zeros((400, 3)))
    finger.touch(None)
    finger.detach(felt.append)
    assert np.concatenate(felt).size == 400
    assert np.max(np.abs(np.concatenate(felt))) > 0.05


def test_rig__driven__moves_without_a_controller(rig):
    trace = rig.drive(np.full((400, 3), 0.1))
    assert np.all(np.abs(trace.command_v[-1] - 0.1) < 1e-3)
    assert np.all(trace.position_v[-1] > 0.05)


@pytest.mark.parametrize("value", [np.nan, 1e10])
def test_rig__reference_that_is_none__is_told_and_the_output_rests(rig, value):
    begin(rig)
    rows = tones(50)
    rows[3, 1] = value
    with pytest.raises(BadInput, match="not finite or beyond 60 dB SL"):
        rig.play(rows)
    assert rig.status().at_rest


def test_rig__sensor_fails__raises_and_is_cleared_by_the_next_load(rig):
    begin(rig)
    rig.play(tones(200))
    rig.finger("thumb").break_sensor("open")
    with pytest.raises(RigFault, match="sensor open"):
        rig.play(tones(800))
    assert rig.status().mode is Mode.FAULT
    rig.finger("thumb").break_sensor("sound")
    rig.load(designed())
    assert np.max(np.abs(rig.play(tones(400)).position_v)) > 0.05


def test_rig__another_display_wired_after_a_motion__is_no_fault(rig):
    rig.drive(np.tile(0.4 * np.sin(2.0 * np.pi * np.arange(1000) / 4000.0)[:, None], (1, 3)))
    begin(rig)
    assert len(rig.play(np.zeros((300, 3)))) == 300


def test_rig__image_flipped__is_refused_and_the_loaded_one_stays(rig):
    begin(rig)
    before = rig.status().image_crc
    with pytest.raises(BadInput, match="image"):
        rig.load_image(b"TACI" + bytes(60))
    assert rig.status().image_crc == before


def test_rig__safety_table__outlives_other_images(rig):
    before = rig.status().safety_crc
    rig.load(designed())
    assert rig.status().safety_crc == before != 0


def test_open__names__give_rigs_or_say_what_is_allowed():
    display = designed().display
    assert isinstance(open_rig("simulated", display), SimulatedRig)
    with pytest.raises(BadInput, match="allowed: simulated, in-process, emulated:mps2-an386"):
        open_rig("toaster", display)
    with pytest.raises(BadInput, match="cannot be opened"):
        open_rig("board:no-such-port", display)
    with pytest.raises(BadInput, match="board 'x' is not known"):
        open_rig("emulated:x", display)


def test_emulator__missing__is_told_with_what_to_install(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(BadInput, match="make install-boards"):
        emulated_rig("mps2-an500", designed().display)


def test_emulator__ends_on_its_own__is_told():
    from tactuator.rig.emulator import Emulator
    from tactuator.rig.transport import LinkDown

    transport = Emulator("mps2-an500")
    rig = wired_rig(transport, designed().display, 1, "float32")
    transport._process.kill()
    transport._process.wait()
    with pytest.raises(LinkDown, match="has ended"):
        rig.status()
    rig.close()
