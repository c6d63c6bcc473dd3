"""The server without a browser: who gets which page, what each connection may say, and what is acknowledged."""

import pytest
from sqlalchemy import select
from websockets.exceptions import ConnectionClosed

from tactuator.errors import StoreFault
from tactuator.experiment.store import records, schema
from tactuator.web.sockets import CLOSE_ABSENT, CLOSE_FORBIDDEN
from tests.experiment.session.apparatuses import ObedientClock, opened_study
from tests.web.access.mutating import defects, hear_all
from tests.web.labs import TOKEN, agreed, begun, client, joined, make_lab, response_count, until  # noqa: F401


@pytest.fixture
def lab(make_lab):
    return make_lab(lambda store: opened_study(store, ObedientClock()))


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/", 200),
        ("/s/token-S1", 200),
        ("/s/token-S9", 404),
        ("/operator", 200),
        ("/static/subject.js", 200),
        ("/static/app.py", 404),
        ("/static/..%2Fapp.py", 404),
        ("/static/%2e%2e%2fapp.css", 404),
        ("/static/%00.css", 404),
        (f"/static/{'9' * 5000}.css", 404),
        ("/docs", 404),
        ("/openapi.json", 404),
    ],
)
def test_page__asked_for__is_given_or_not(client, caplog, monkeypatch, path, status) -> None:
    hear_all(monkeypatch)
    answer = client.get(path)
    assert answer.status == status
    assert defects(caplog) == []
    if not path.startswith(("/docs", "/open")) and "%" not in path:
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]


@pytest.mark.parametrize("path", ["/s/token-S1", "/operator"])
def test_page__every_part__comes_from_this_server(client, path) -> None:
    text = client.get(path).text
    assert "http" not in text
    assert "style=" not in text


def test_subject__trial_answered__is_acknowledged_after_it_is_stored(client, lab) -> None:
    with client.websocket_connect("/ws/subject/token-S1") as socket:
        asked = begun(socket)
        assert response_count(lab) == 0
        socket.send_json({"type": "answer", "run": asked["run"], "number": asked["number"], "response": "2"})
        acknowledged = until(socket, "ack")
        assert response_count(lab) == 1
        assert (acknowledged["run"], acknowledged["number"]) == (asked["run"], asked["number"])
        assert acknowledged["right"] in ("1", "2", "3")
        assert until(socket, "answer-now")["number"] == asked["number"] + 1


def test_subject__intervals__are_told_in_order(client) -> None:
    with client.websocket_connect("/ws/subject/token-S1") as socket:
        agreed(socket)
        seen = []
        while (message := socket.receive_json())["type"] != "answer-now":
            if message["type"] == "interval":
                seen.append((message["interval"], message["on"]))
        assert seen == [(0, True), (0, False), (1, True), (1, False), (2, True), (2, False)]


def test_subject__lost_acknowledgement__answer_sent_again_counts_once(client, lab) -> None:
    with client.websocket_connect("/ws/subject/token-S1") as socket:
        asked = begun(socket)
        message = {"type": "answer", "run": asked["run"], "number": asked["number"], "response": "1"}
        socket.send_json(message)
        first = until(socket, "ack")
    with client.websocket_connect("/ws/subject/token-S1") as socket:
        until(socket, "stage")
        socket.send_json(message)
        assert until(socket, "ack")["right"] == first["right"]
        assert response_count(lab) == 1
        socket.send_json({"type": "ready", "stage": "trial"})
        assert until(socket, "answer-now")["number"] == 1


def test_subject__store_fails__is_told_and_the_answer_may_come_again(client, lab, monkeypatch) -> None:
    with client.websocket_connect("/ws/subject/token-S1") as socket:
        asked = begun(socket)
        message = {"type": "answer", "run": asked["run"], "number": 0, "response": "1"}

        def full(*args: object) -> None:
            raise StoreFault("lab.db: database or disk is full")

        with monkeypatch.context() as broken:
            broken.setattr(records, "save_answer", full)
            socket.send_json(message)
            assert "full" in until(socket, "fault")["detail"]
            assert response_count(lab) == 0
        assert lab.fault == "lab.db: database or disk is full"
        socket.send_json(message)
        until(socket, "ack")
        assert response_count(lab) == 1
        assert lab.fault is None


def test_connection__unknown_link__is_closed(client) -> None:
    with client.websocket_connect("/ws/subject/token-S9") as socket, pytest.raises(ConnectionClosed) as closed:
        socket.receive_json()
    assert closed.value.rcvd.code == CLOSE_ABSENT


@pytest.mark.parametrize("said", ["", "wrong", "token-S1", "ü"])
def test_operator__wrong_token__is_closed(client, said) -> None:
    with client.websocket_connect("/ws/operator") as socket, pytest.raises(ConnectionClosed) as closed:
        socket.send_text(said)
        socket.receive_json()
    assert closed.value.rcvd.code == CLOSE_FORBIDDEN


@pytest.mark.parametrize(("path", "code"), [("/ws/operator", CLOSE_FORBIDDEN), ("/ws/subject/token-S1", CLOSE_ABSENT)])
def test_connection__from_another_sites_page__is_closed(client, path, code) -> None:
    with (
        client.websocket_connect(path, origin="http://elsewhere.example") as socket,
        pytest.raises(ConnectionClosed) as closed,
    ):
        socket.send_text(TOKEN)
        socket.receive_json()
    assert closed.value.rcvd.code == code


def test_operator__start_pause_stop__are_obeyed_and_shown(client, lab) -> None:
    lab.auto_start = False
    with joined(client, "operator") as socket:
        first = until(socket, "snapshot")
        assert (first["control"], first["active"]) == (True, None)
        assert [one["subject"] for one in first["sessions"]] == ["S1", "S2"]
        session = first["sessions"][0]["id"]
        socket.send_json({"type": "start", "session": session})
        assert _until(socket, lambda shot: shot["active"] == session)
        socket.send_json({"type": "pause"})
        assert _until(socket, lambda shot: shot["paused"])
        socket.send_json({"type": "stop"})
        assert _until(socket, lambda shot: shot["active"] is None)


def _until(socket, wanted) -> bool:
    for _ in range(50):
        if wanted(until(socket, "snapshot")):
            return True
    return False


def test_operator__second__looks_on_until_control_is_taken(client) -> None:
    with client.websocket_connect("/ws/operator") as first, client.websocket_connect("/ws/operator") as second:
        first.send_text(TOKEN)
        assert until(first, "snapshot")["control"] is True
        second.send_text(TOKEN)
        assert until(second, "snapshot")["control"] is False
        second.send_json({"type": "pause"})
        assert "another operator has control" in until(second, "refused")["message"]
        second.send_json({"type": "take-control"})
        assert _until(second, lambda shot: shot["control"])
        assert _until(first, lambda shot: not shot["control"])


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ({"type": "start"}, "without a session"),
        ({"type": "start", "session": 99}, "not of this study"),
        ({"type": "give-up-run"}, "no session is at the rig"),
        ({"type": "explode"}, "command"),
    ],
)
def test_operator__nonsense__is_refused(client, command, message) -> None:
    with joined(client, "operator") as socket:
        socket.send_json(command)
        assert message in until(socket, "refused")["message"]


def test_operator__clock_jumps__is_noted(client, lab) -> None:
    with joined(client, "operator") as socket:
        until(socket, "snapshot")
        lab.clock.jump(3600.0)
        until(socket, "snapshot")
        until(socket, "snapshot")
    with lab.store.read() as connection:
        notes = [row.detail for row in connection.execute(select(schema.event))]
    assert notes == ["the wall clock moved by 3600.0 s"]
