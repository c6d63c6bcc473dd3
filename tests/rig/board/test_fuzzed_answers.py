"""A board whose answers are spoilt, or are another board's: the host says so in one line, and comes to an end."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import TactuatorError
from tactuator.model.controller import Controller
from tactuator.rig.board.link import Frame, FrameReader, LinkClient, LinkGarbled, Request, Status, frame_bytes
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.transport import InProcess

FEW, MANY = 200, 100_000
PATIENCE = 20_000
"""Answers to one errand after which it is taken for one without end."""


class NoEnd(Exception):
    """An errand that asked and asked."""


class SpoiltAnswers(InProcess):
    """A board in this process of whose answers a share is altered: within a sound frame, or as bytes."""

    def __init__(self, rng: np.random.Generator, share: float) -> None:
        super().__init__()
        self._rng, self._share = rng, share
        self._own = FrameReader()
        self.altered = self.asked = 0

    def receive(self, timeout_s: float) -> bytes:
        self.asked += 1
        if self.asked > PATIENCE:
            raise NoEnd
        content = b""
        for frame in self._own.feed(super().receive(timeout_s)):
            spoilt = self._rng.random() < self._share
            self.altered += spoilt
            content += self._altered(frame) if spoilt else frame_bytes(frame)
        return content

    def _altered(self, frame: Frame) -> bytes:
        rng, payload, kind = self._rng, bytearray(frame.payload), int(self._rng.integers(8))
        if kind < 3 and payload:
            for _ in range(int(rng.integers(1, 4))):
                payload[int(rng.integers(len(payload)))] = int(rng.choice([0, 1, 4, 9, 127, 128, 255]))
        elif kind == 3:
            del payload[int(rng.integers(len(payload) + 1)) :]
        elif kind == 4:
            payload += bytes(rng.integers(0, 256, int(rng.integers(1, 40)), dtype=np.uint8))
        elif kind == 5:
            payload[1:] = bytes(rng.integers(0, 256, max(len(payload) - 1, 0), dtype=np.uint8))
        elif kind == 6:
            sent = bytearray(frame_bytes(frame))
            sent[int(rng.integers(len(sent)))] ^= 1 << int(rng.integers(8))
            return bytes(sent)
        else:
            return bytes(rng.integers(0, 256, int(rng.integers(200)), dtype=np.uint8))
        return frame_bytes(Frame(frame.type, frame.sequence, bytes(payload)))


def errand(rng: np.random.Generator, controller: Controller, found: Counter[str]) -> int:
    """Open a board, load it, play, stream and rest, whatever it answers; the answers that were altered."""
    board = SpoiltAnswers(rng, float(rng.choice([0.01, 0.05, 0.3])))
    client = LinkClient(board, answer_s=0.0, tries=2)
    try:
        rig = BoardRig(client, controller.display, sleep=lambda seconds: None)
        rig.load(controller)
        rows = np.zeros((200, len(controller.channels)))
        rig.play(rows)
        for _ in rig.stream([rows, rows]):
            pass
        rig.client.acknowledge()
        rig.rest()
        client.ask(Request.STATUS)
        rig.close()
        found["done"] += 1
    except TactuatorError as error:
        told = str(error)
        found["too long" if "\n" in told or len(told) > 400 else type(error).__name__] += 1
    return board.altered


def fuzz(controller: Controller, count: int, seed: int) -> Counter[str]:
    rng, found, altered = np.random.default_rng(seed), Counter[str](), 0
    while altered < count:
        altered += errand(rng, controller, found)
    return found


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
def test_board__whose_answers_are_altered__is_told_of_in_one_line(controller, count: int) -> None:
    found = fuzz(controller, count, 21)
    assert found.total() > count // 100
    assert len(found) >= 3
    assert found["too long"] == 0


class LastTick(LinkClient):
    """The link of a board that says it is at the last tick that it can count."""

    at_last = False

    def status(self) -> Status:
        return replace(super().status(), tick=0xFFFFFFFF) if self.at_last else super().status()


def test_board__whose_time_goes_on_and_is_at_the_last_tick__is_told_of_and_comes_to_rest(controller) -> None:
    client = LastTick(InProcess())
    rig = BoardRig(client, controller.display, sleep=lambda seconds: None, waits=False)
    rig.simulate()
    rig.load(controller)
    client.at_last = True
    with pytest.raises(LinkGarbled):
        rig.play(np.zeros((200, len(controller.channels))))
    assert client.status().at_rest
