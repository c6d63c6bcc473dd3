"""What a subject's page may say, and what it may not: refused, the session goes on, and nobody else notices."""

import json
import time

import pytest

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_protocol
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, opened_study
from tests.web.labs import TOKEN, agreed, answer, begun, client, make_lab, response_count, until  # noqa: F401


class Running(ObedientClock):
    """A clock whose seconds pass."""

    def monotonic_s(self) -> float:
        return time.monotonic()


@pytest.fixture
def lab(make_lab):
    return make_lab(lambda store: opened_study(store, Running()))


BAD = [
    {"run": 2**63},
    {"number": 2**63},
    {"number": -1},
    {"number": 7},
    {"number": 0.5},
    {"number": "0"},
    {"run": True},
    {"shown_ms": -1.0},
    {"pressed_ms": 1e13},
    {"shown_ms": 500.0, "pressed_ms": 100.0},
    {"response": "x" * 201},
    {"response": "9"},
    {"response": ""},
    {"lit_ms": [1.0] * 10},
    {"lit_ms": [-1.0]},
    {"type": "answers"},
    {"more": 1},
]
RAW = ["", "[]", "{}", '{"type":"answer"', '{"type":"answer"}', '{"type":"start"}', "1" * 5000, "[" * 5000]


def test_answer__that_cannot_be__is_refused_the_session_goes_on_and_nobody_else_notices(client, lab) -> None:
    """The other subject waits for the rig. All that its page is told meanwhile is read, up to a reply of its own."""
    with (
        client.websocket_connect("/ws/subject/token-S1") as socket,
        client.websocket_connect("/ws/subject/token-S2") as other,
        client.websocket_connect("/ws/operator") as operator,
    ):
        stands = begun(socket)
        agreed(other)
        waits = until(other, "stage")
        assert waits["waiting"]
        operator.send_text(TOKEN)
        until(operator, "snapshot")
        times = {"shown_ms": 10.0, "pressed_ms": 400.0}
        good = {"type": "answer", "run": stands["run"], "number": 0, "response": "1", **times}
        texts = [json.dumps(good | change) for change in BAD] + RAW
        texts += [json.dumps(good).replace("400.0", amiss) for amiss in ("Infinity", "1e999", "NaN", "-Infinity")]
        for text in texts:
            socket.send_text(text)
            until(socket, "refused")
        socket._connection.send(b"\x00\xff\x00")
        assert "binary" in until(socket, "refused")["message"]
        heard: list[dict] = []
        other.send_json({"type": "nothing"})
        until(other, "refused", heard)
        assert all(message == waits for message in heard)  # the page is told every few seconds that it still waits
        assert (response_count(lab), lab.active, lab.calls, lab.fault) == (0, 1, {}, None)
        socket.send_json(good)
        assert until(socket, "ack")["number"] == 0
        assert (response_count(lab), lab.fault, lab.paused) == (1, None, False)
        other.send_json({"type": "nothing"})
        until(other, "refused", heard)
        assert {message["type"] for message in heard} <= {"stage"}
        while (snapshot := until(operator, "snapshot"))["sessions"][0]["trials"] != 1:
            pass
        assert snapshot["fault"] is None


def test_answer__before_its_last_interval_has_ended__is_refused_and_asked_for_again(client, lab, monkeypatch) -> None:
    """The answer waits in the queue while the trial plays; what counts is when it arrived."""
    stream = lab.apparatus.rig.stream

    def slowly(blocks):
        for trace in stream(blocks):
            time.sleep(0.01)
            yield trace

    monkeypatch.setattr(lab.apparatus.rig, "stream", slowly)
    with client.websocket_connect("/ws/subject/token-S1") as socket:
        agreed(socket)
        until(socket, "interval")
        early = {"type": "answer", "run": 1, "number": 0, "response": "1"}
        socket.send_json(early)
        assert "before its last interval had ended" in until(socket, "refused")["message"]
        assert response_count(lab) == 0
        socket.send_json(early)
        assert until(socket, "ack")["number"] == 0


def test_defect__in_saving_an_answer__leaves_the_rig_and_other_sessions_alone(client, lab, monkeypatch) -> None:
    with client.websocket_connect("/ws/subject/token-S1") as socket:
        stands = begun(socket)
        presented = lab.opened(1)
        rested = []
        monkeypatch.setattr(lab.apparatus.rig, "rest", lambda: rested.append(1))
        with monkeypatch.context() as patched:
            patched.setattr(presented.session, "answer", lambda *these: 1 / 0)
            socket.send_json({"type": "answer", "run": stands["run"], "number": 0, "response": "1"})
            until(socket, "fault")
        assert (rested, lab.paused) == ([], False)
        answer(socket, stands)
        monkeypatch.undo()


def test_protocol__break_that_never_ends__is_refused() -> None:
    text = PROTOCOL.replace("resume_within_s = 600", "")
    for key in ("break_s", "resume_within_s"):
        for amiss in ("inf", "nan", "-1", "86401"):
            with pytest.raises(BadInput, match=f"session.{key}"):
                parse_protocol(text.replace("[session]", f"[session]\n{key} = {amiss}"))
