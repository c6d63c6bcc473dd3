"""Messages that nobody means: whatever a connection says, the server stays, and other sessions notice nothing.

The messages come from a mutator that knows the message kinds but not the server's checks.
"""

from __future__ import annotations

import json
import threading
from contextlib import ExitStack, suppress

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.experiment.session.apparatuses import ObedientClock, opened_study
from tests.web.access import requesting
from tests.web.access.mutating import defects, fails_once, hear_all, mutated
from tests.web.labs import TOKEN, client, make_lab, response_count, until  # noqa: F401

FEW, MANY = 1500, 100_000
LAST = "the-last-of-these"
SUBJECT = [
    {"type": "consent"},
    {"type": "ready", "stage": "trial"},
    {"type": "ready", "stage": "introduction"},
    {"type": "ready", "stage": "paused"},
    {"type": "ready", "stage": "break"},
    {"type": "pause"},
    {"type": "answer", "run": 1, "number": 0, "response": "1", "shown_ms": 10.0, "pressed_ms": 400.0, "lit_ms": [1, 2]},
]
OPERATOR = [
    {"type": "start", "session": 1},
    {"type": "pause"},
    {"type": "resume"},
    {"type": "give-up-run"},
    {"type": "clear-fault"},
    {"type": "take-control"},
    {"type": "results", "session": 1},
    {"type": "enrol", "code": "S1", "group": "hearing", "participant_id": "p", "demographics": {"age": "30"}},
    {"type": "new-visit", "subject": "S9"},
    {"type": "day", "session": 1, "skin_temperature_c": 31.0, "preload_n": 0.5},
    {"type": "correct", "subject": "S1", "reason": "slip", "group": "hearing", "demographics": {}},
]


class Drained:
    """A connection whose messages somebody reads and counts."""

    def __init__(self, port: int, path: str, first: str | None) -> None:
        self._open = ExitStack()
        self.connection: ClientConnection = self._open.enter_context(connect(f"ws://127.0.0.1:{port}{path}"))
        if first is not None:
            self.connection.send(first)
        self.acknowledged: set[tuple[int, int]] = set()
        self.heard = 0
        self._handled = threading.Event()
        self.thread = threading.Thread(target=self._drain, daemon=True)
        self.thread.start()

    def _drain(self) -> None:
        try:
            for text in self.connection:
                self.heard += 1
                message = json.loads(text)
                if LAST in message.get("message", ""):
                    self._handled.set()
                if message["type"] == "ack":
                    self.acknowledged.add((message["run"], message["number"]))
        except ConnectionClosed:
            return
        finally:
            self._handled.set()

    def settle(self) -> None:
        """Wait until all that was sent has been handled. Raises ConnectionClosed where the server closed it."""
        self._handled.clear()
        self.connection.send(json.dumps({"type": LAST}))
        assert self._handled.wait(20.0), "the server answers no more"

    def close(self) -> None:
        self._open.close()
        self.thread.join(timeout=10.0)


def fuzz(client, lab, caplog, monkeypatch, path: str, first: str | None, messages: list[dict], count: int) -> None:
    hear_all(monkeypatch)
    rng = np.random.default_rng(20)
    heard, acknowledged, all_of_them = 0, set(), []
    with client.websocket_connect("/ws/subject/token-S2") as other:
        until(other, "stage")
        all_of_them.append(Drained(client.port, path, first))
        for index in range(count):
            try:
                all_of_them[-1].connection.send(mutated(rng, messages[int(rng.integers(len(messages)))]))
            except ConnectionClosed:
                all_of_them.append(Drained(client.port, path, first))
            if index % 50 == 49:
                with suppress(ConnectionClosed):
                    all_of_them[-1].settle()
            if index % 500 == 499:
                assert client.get("/").status == 200
                other.send_json({"type": "nothing"})
                until(other, "refused")
        for one in all_of_them:
            one.close()
            heard, acknowledged = heard + one.heard, acknowledged | one.acknowledged
    assert heard > count // 4
    assert defects(caplog) == []
    assert lab.fault is None
    assert response_count(lab) >= len(acknowledged)


@pytest.mark.parametrize("parser", ["tactuator.web.subject.message_of", "tactuator.web.operator.message_of"])
def test_fuzz__defect_in_one_message_of_many__is_noticed(client, lab, caplog, monkeypatch, parser) -> None:
    fails_once(monkeypatch, parser, 700)
    with pytest.raises(AssertionError, match="Exception in ASGI application"):
        fuzz(client, lab, caplog, monkeypatch, *PAGES["operator" in parser], FEW)


@pytest.fixture
def lab(make_lab):
    return make_lab(lambda store: opened_study(store, ObedientClock()))


PAGES = [("/ws/subject/token-S1", None, SUBJECT), ("/ws/operator", TOKEN, OPERATOR)]


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize(("path", "first", "messages"), PAGES)
def test_page__messages_nobody_means__keep_server_rig_and_other_sessions_going(
    client, lab, caplog, monkeypatch, path, first, messages, count
) -> None:
    fuzz(client, lab, caplog, monkeypatch, path, first, messages, count)


@pytest.mark.parametrize("count", [FEW // 5, pytest.param(MANY, marks=pytest.mark.soak)])
def test_study__requests_nobody_makes__keep_the_open_session_going(client, lab, caplog, monkeypatch, count) -> None:
    paths = ["/", "/static/common.css", "/s/token-S1", "/s/nobody", "/operator", "/ws/subject/token-S1", "/ws/operator"]
    with client.websocket_connect("/ws/subject/token-S2") as other:
        until(other, "stage")

        def goes_on() -> None:
            other.send_json({"type": "nothing"})
            until(other, "refused")

        answered = requesting.fuzz(client.port, requesting.heads(paths, TOKEN), count, caplog, monkeypatch, goes_on)
    assert answered > count // 4
    assert lab.fault is None
