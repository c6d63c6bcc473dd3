"""A page at the rig and one at its study, as their connections see them, and what a store holds."""

from __future__ import annotations

import json
import sqlite3
import threading
import time
from contextlib import ExitStack, contextmanager

import numpy as np
from websockets.sync.client import connect

from tactuator.console.rig_calls import RigStatus
from tactuator.console.rig_worker import RigWorker
from tactuator.console.scope import HEADER
from tests.console.pages import TOKEN, dropped
from tests.web.labs import begun, until


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


class Studies:
    def __init__(self, socket):
        self.socket, self.study = socket, None
        socket.send_text(TOKEN)
        self.study = socket.receive_json()["study"]

    def ask(self, do, **more):
        self.socket.send_json({"id": 1, "do": do, **more})
        while "id" not in (message := self.socket.receive_json()):
            self.study = message["study"]
        return message


@contextmanager
def loaded(console):
    page = Page(console)
    if page.standing["controls"] != "you":
        page.ask("take")
    page.ask("controller", source="file", file=dropped(console.state, console.file))
    page.until(lambda: page.standing["loaded"])
    page.ask("give")
    try:
        yield page
    finally:
        page.open.close()


def operator(socket):
    socket.send_text(TOKEN)
    return until(socket, "snapshot")


@contextmanager
def at_subject(console, code="S1"):
    with console.websocket_connect("/ws/operator") as socket:
        link = next(one["link"] for one in operator(socket)["sessions"] if one["subject"] == code)
    with console.websocket_connect(f"/ws/subject/{link.removeprefix('/s/')}") as socket:
        yield socket


def answered(socket, trials):
    for count in range(trials):
        asked = until(socket, "answer-now") if count else begun(socket)
        socket.send_json({"type": "answer", "run": asked["run"], "number": asked["number"], "response": "2"})
        until(socket, "ack")


def rows(path):
    query = "SELECT trial.number, level_db_sl, response FROM trial JOIN response ON response.trial_id = trial.id"
    connection = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
    try:
        return connection.execute(query).fetchall()
    finally:
        connection.close()


class Host:
    """A worker of the rig on a thread of this process, and all that it has sent: the server's side of its process."""

    def __init__(self, display, spec="simulated"):
        self.display, self.status, self.sent, self.news = display, RigStatus(), [], threading.Condition()
        self.presented = lambda piece: None
        self.worker = RigWorker(spec, display, 5, self._take)
        self.call = self.worker.call
        self.thread = threading.Thread(target=self.worker.run, daemon=True)
        self.thread.start()
        self.until(lambda: self.of("take_status"))

    def _take(self, name, *arguments):
        with self.news:
            self.sent.append((name, arguments))
            if name == "take_status":
                (self.status,) = arguments
            elif name == "take_presented":
                self.presented(*arguments)
            self.news.notify_all()

    def until(self, reached):
        with self.news:
            assert self.news.wait_for(reached, timeout=20.0), self.status

    def of(self, name):
        return [arguments for of, arguments in self.sent if of == name]

    @property
    def refusals(self):
        return [text for (text,) in self.of("take_refusal")]

    @property
    def points(self):
        return [points for (points,) in self.of("take_points")]

    @property
    def rows(self):
        width = 3 * len(self.display.channels)
        pieces = self.of("take_samples")
        rows = [np.frombuffer(content, np.float32).reshape(-1, width) for _, content, _ in pieces]
        assert [first for first, _, _ in pieces] == np.cumsum([0, *map(len, rows)])[:-1].tolist()
        return np.concatenate(rows) if rows else np.zeros((0, width), np.float32)

    def quit(self):
        self.call("quit")
        self.thread.join(timeout=20.0)
        assert not self.thread.is_alive()
