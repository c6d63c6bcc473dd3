"""Streams to boards whose time goes on: no gap, no silent underrun, rest on what goes wrong."""

import time
from contextlib import closing

import numpy as np
import pytest

from tactuator.errors import DeviceFault
from tactuator.rig.board.commissioning import soft_ticks
from tactuator.rig.board.link import STREAM, LinkClient, Mode, Request, RigFault
from tactuator.rig.board.rig import STREAM_LEAD_S, BoardRig
from tactuator.rig.board.stream import BoardStream, StreamDry
from tactuator.rig.open import in_process_rig, open_rig
from tactuator.rig.rig import join_traces
from tactuator.rig.transport import InProcess, LinkDown, connect
from tactuator.runtime.safety_table import Fault
from tests.firmware.emulated_ports import serial_board, socket_board
from tests.rig.every_rig import free_rig
from tests.rig.guard.guarded import designed

RATE_HZ = 4000.0
SOFT = soft_ticks(4000.0)


def noise(count, seed=1):
    return (20.0 * np.random.default_rng(seed).standard_normal((count, 3))).astype(np.float32)


def joined(traces):
    return join_traces(traces, RATE_HZ, tuple(c.name for c in designed().display.channels))


def test_free_board__stream__plays_every_row_at_its_tick_without_a_gap():
    rows = noise(9000)
    rig = free_rig()
    found = joined(rig.stream(np.array_split(rows, 45)))
    with in_process_rig(designed().display, 1) as waiting:
        waiting.load(designed())
        waiting.play(np.zeros((rig.fed_to - len(rows) - SOFT, 3)))
        wanted = waiting.play(rows)
    assert np.array_equal(found.reference, rows)
    for name in ("command_v", "position_v"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name))


def test_free_board__block__is_asked_for_no_earlier_than_the_lead():
    asked, played = [0], 0

    def blocks():
        for _ in range(40):
            asked[0] += 200
            yield noise(200)

    for trace in free_rig().stream(blocks()):
        # what is told of lags behind what is played by the pieces of the trace
        assert asked[0] - played <= STREAM_LEAD_S * RATE_HZ + 200 + 2 * 200
        played += len(trace)
    assert played == asked[0] == 8000


def test_free_board__host_falls_behind__is_told_and_the_output_rests():
    rig = free_rig()

    def blocks():
        yield noise(400)
        for _ in range(60):
            rig.status()  # 32 ticks each
        yield noise(400)

    with pytest.raises(StreamDry, match="ran dry 400 samples after its beginning") as told:
        list(rig.stream(blocks()))
    assert told.value.ticks > 0
    assert rig.status().at_rest
    assert len(joined(rig.stream([noise(300)]))) == 300


def test_free_board__sensor_fails_in_mid_stream__rests_and_is_told():
    rig = free_rig()
    with pytest.raises(RigFault, match="sensor open"):
        for count, _ in enumerate(rig.stream(noise(200) for _ in range(400))):
            if count == 5:
                rig.break_sensor("thumb", "open")
    assert rig.status().mode is Mode.FAULT
    assert rig.status().at_rest


def test_free_board__pressed_in_mid_stream__is_felt_as_on_a_board_that_waits():
    rig, felt = free_rig(), ([], [])
    rig.finger("index").attach(felt[0].append)
    rig.finger("index").press(np.full(500, 0.02))
    joined(rig.stream(np.zeros((200, 3)) for _ in range(4)))
    with in_process_rig(designed().display, 1) as waiting:
        waiting.load(designed())
        waiting.play(np.zeros((rig.fed_to - 800 - SOFT, 3)))
        waiting.finger("index").attach(felt[1].append)
        waiting.finger("index").press(np.full(500, 0.02))
        waiting.play(np.zeros((800, 3)))
    pressed, wanted = (np.concatenate(each) for each in felt)
    assert np.array_equal(pressed, wanted)
    assert np.ptp(pressed[100:500]) > 0.0


def test_free_board__rows_of_which_the_first_are_too_late__are_all_refused():
    """Found on the emulated STM32F405: rows are taken sixteen at a time, and the second sixteen began a new stretch."""
    rig = free_rig()
    rig.client.must(Request.ARM)
    rig.client.start(1, STREAM, False, False)
    for late in range(1, 64):
        before = rig.status()
        first = before.tick + 32 - late  # in-process, 32 ticks pass before a request is heard
        end, tick = rig.client.stream(1, first, noise(64), None)
        assert tick == first + late
        assert end == before.stream_end


class Standing(InProcess):
    """A board that answers, and whose timer has stopped once it `stands`."""

    stands = False

    def _let_run(self):
        if not self.stands:
            super()._let_run()


def test_board_that_waits__given_rows_and_stands_still__is_told():
    transport = Standing()
    client = (rig := free_rig(transport)).client
    rig.play(noise(100))
    transport.stands, at = True, client.status().tick
    stream = BoardStream(client, client.status().run, 3, 2000, 2000, True)
    with pytest.raises(DeviceFault, match=f"stopped at tick {at} of its run, although it has rows up to {at + 300}"):
        list(stream.play([noise(300)], at))


def test_serial_port__board_behind_it__plays_bit_for_bit():
    with in_process_rig(designed().display, 1) as ours:
        ours.load(designed())
        wanted = ours.play(noise(100))
    with serial_board() as (name, _), open_rig(f"board:{name}@921600", designed().display, 1) as rig:
        rig.load(designed())
        assert np.array_equal(rig.play(noise(100)).command_v, wanted.command_v)


@pytest.mark.slow
def test_host__vanishes_from_a_board_in_free_run__it_rests_by_itself():
    with socket_board() as (url, process):
        first = BoardRig(open_rig(f"board:{url}", designed().display, 1).client, designed().display, waits=False)
        with closing(first.client):
            first.load(designed())
            for count, _ in enumerate(first.stream(noise(100) for _ in range(100))):
                if count == 2:
                    break
        client = LinkClient(connect(url))
        for pause_s in 0.5 * 2.0 ** np.arange(8):  # a quarter of a second of its time; each question begins it anew
            time.sleep(pause_s)
            status = client.status()
            if status.mode is Mode.FAULT:
                break
        assert status.fault is Fault.SILENCE
        process.kill()
        with pytest.raises(LinkDown, match="the port has vanished"):
            for _ in range(100):
                client.status()
        client.close()
