"""A page at the rig, as its connection sees it."""

from __future__ import annotations

import json
import time
from contextlib import ExitStack

import numpy as np
from websockets.sync.client import connect

from tactuator.console.scope.frames import HEADER
from tests.console.pages import TOKEN


class Page:
    """A page at the rig: it answers frames as a page does, or, told so, does not."""

    def __init__(self, client, draws=True):
        self.open = ExitStack()
        self.socket = self.open.enter_context(connect(f"ws://127.0.0.1:{client.port}/ws/rig"))
        self.socket.send(TOKEN)
        self.draws, self.count, self.frames, self.standing, self.others = draws, 0, [], None, []
        self.until(lambda: self.standing)

    def take(self):
        told = self.socket.recv(timeout=20.0)
        if isinstance(told, bytes):
            self.frames.append((HEADER.unpack_from(told), np.frombuffer(told[HEADER.size :], "<f4")))
            if self.draws:
                self.socket.send(json.dumps({"id": 0, "do": "drawn", "frame": self.frames[-1][0][0]}))
            return None
        message = json.loads(told)
        if "standing" in message:
            self.standing = message["standing"]
        elif "levels" not in message:
            self.others.append(message)
        return message

    def until(self, reached):
        end = time.monotonic() + 20.0
        while not reached():
            assert time.monotonic() < end, self.standing
            self.take()

    def ask(self, do, **more):
        self.count += 1
        self.socket.send(json.dumps({"id": self.count, "do": do, **more}))
        while True:
            message = self.take()
            if message and message.get("id") == self.count:
                return message
