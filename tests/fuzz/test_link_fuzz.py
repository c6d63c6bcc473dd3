"""The link's decoder and everything behind it under libFuzzer, address and undefined-behaviour sanitisers.

It starts from whole conversations, with tables, images and displays whose checksums link.c puts right.
"""

import re
import struct

import numpy as np
import pytest

from tactuator.rig.board import link
from tactuator.rig.board.commissioning import safety_table
from tactuator.rig.board.link import IMAGE, SAFETY, STREAM, Request
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import safety_bytes
from tactuator.runtime.tables import simulated_board_bytes
from tests.fuzz.conftest import fuzz
from tests.runtime.paper_display import channel, controller, display


@pytest.mark.parametrize(
    "until",
    [pytest.param("-runs=1500", marks=pytest.mark.slow), pytest.param("-max_total_time=3600", marks=pytest.mark.soak)],
)
def test_link__fuzzed_so_often_or_so_long__nothing_breaks(tmp_path, objects, until):
    said = fuzz(tmp_path, "link", objects, conversations(), 4096, until)
    assert int(re.findall(r"number_of_executed_units: *(\d+)", said)[0]) > 1000


_PIECE = 240
_ROWS = 16


def frame(request: int, payload: bytes = b"") -> bytes:
    """Length, type, payload; link.c seals it."""
    assert len(payload) < 255
    return bytes([len(payload), request]) + payload


def upload(kind: int, content: bytes) -> bytes:
    """A table in pieces and its commit; a checksum of zero asks link.c to put the right ones in."""
    pieces = [
        frame(Request.UPLOAD, struct.pack("<BI", kind, at) + content[at : at + _PIECE])
        for at in range(0, len(content), _PIECE)
    ]
    return b"".join(pieces) + frame(Request.COMMIT, struct.pack("<BII", kind, len(content), 0))


def stream(run: int, first: int, channels: int, forces: bool = False) -> bytes:
    width = channels * (2 if forces else 1)
    count = min(_ROWS, (_PIECE - 11) // (4 * width))
    rows = 30.0 * np.sin(0.1 * np.arange(first, first + count)[:, None] * np.ones(width))
    return frame(Request.STREAM, struct.pack("<IIHB", run, first, count, forces) + rows.astype("<f4").tobytes())


def stimulus(index: int) -> bytes:
    turn, ramp = np.exp(0.1j), np.exp(1j * np.pi / 10.0)
    tone = struct.pack("<III5f", 2, 40, 10, 20.0, turn.real, turn.imag, ramp.real, ramp.imag)
    return frame(Request.STIMULUS, bytes([index, 1]) + tone)


def conversations() -> dict[str, bytes]:
    """What a board may hear, by name: set up, run from each source, watched, ended."""
    start = struct.Struct("<IBBB")
    status, arm, stop, off, clear = (
        frame(request) for request in (Request.STATUS, Request.ARM, Request.STOP, Request.OFF, Request.CLEAR)
    )
    seeds = {}
    for names in (("index",), ("index", "thumb", "middle")):
        of = display(*(channel(name) for name in names))
        count = len(names)
        safety = upload(SAFETY, safety_bytes(safety_table(of)))
        simulated = upload(link.SIMULATED_DISPLAY, simulated_board_bytes(of, 1))
        trace = frame(Request.TRACE, struct.pack("<IIHB", 1, 0, 64, 1)) + frame(Request.WEIGHTS)
        image = upload(IMAGE, build_image(controller(of)))
        whole = simulated_board_bytes(of, 1)
        for range_v in (1e-310, 1e-40, 1e300):  # of the converter, whose steps per volt are no finite number then
            odd = whole[:24] + struct.pack("<d", range_v) + whole[32:]
            seeds[f"range-{range_v}-{count}"] = safety + upload(link.SIMULATED_DISPLAY, odd) + arm
        ready = safety + image + simulated + arm
        rows = b"".join(stream(1, at, count) for at in range(0, 64, min(_ROWS, (_PIECE - 11) // (4 * count))))
        seeds[f"stream-{count}"] = ready + frame(Request.START, start.pack(1, STREAM, 0, 1)) + rows + trace + stop * 30
        if count == 1:
            seeds[f"tones-{count}"] = (
                safety + image + simulated + stimulus(0) + arm
                + frame(Request.START, start.pack(1, link.STIMULUS, 0, 0))
                + status * 20 + trace + stop + status * 40 + off
            )  # fmt: skip
            seeds[f"broken-{count}"] = (
                ready + frame(Request.START, start.pack(1, link.SILENT, 0, 0)) + frame(Request.TOUCH, bytes([0, 1]))
                + frame(Request.BREAK, struct.pack("<BBf", 0, 1, 0.0)) + status * 30 + clear + off
            )  # fmt: skip
        seeds[f"driven-{count}"] = (
            safety + simulated + arm + frame(Request.START, start.pack(1, STREAM, 1, 1))
            + stream(1, 0, count, True) + stop * 30 + status
        )  # fmt: skip
    hello, armed = (link.frame_bytes(link.Frame(*each, b"")) for each in ((Request.STATUS, 7), (Request.ARM, 8)))
    garbage = b"\xff\x00" + link.cobs_encode(b"\0" * 300) + hello + b"\xff" * 300
    return {**seeds, "raw": garbage + b"\0" + armed}
