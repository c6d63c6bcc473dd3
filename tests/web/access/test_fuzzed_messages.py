"""Messages that nobody means: whatever a connection says, the server stays, and other sessions notice nothing.

The messages come from a mutator that knows the message kinds but not the server's checks.
"""

from __future__ import annotations

import json

import pytest

from tests.experiment.session.apparatuses import ObedientClock, opened_study
from tests.web.access import requesting
from tests.web.access.mutating import Asking, fuzz
from tests.web.labs import TOKEN, client, make_lab, response_count, until  # noqa: F401

FEW, MANY = 300, 100_000
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
PAGES = [("/ws/subject/token-S1", None, SUBJECT), ("/ws/operator", TOKEN, OPERATOR)]


@pytest.fixture
def lab(make_lab):
    return make_lab(lambda store: opened_study(store, ObedientClock()))


@pytest.fixture
def goes_on(client):
    """A call that finds a page given and another subject's session answered."""
    with client.websocket_connect("/ws/subject/token-S2") as other:
        until(other, "stage")

        def answered():
            assert client.get("/").status == 200
            other.send_json({"type": "nothing"})
            until(other, "refused")

        yield answered


def sent(client, page, count, told, goes_on):
    path, first, messages = page
    last = "the-last-of-these"
    return fuzz(lambda: Asking(client.port, path, first, {"type": last}, last), messages, count, told, goes_on)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize("page", PAGES, ids=["subject", "operator"])
def test_page__messages_nobody_means__keep_server_rig_and_other_sessions_going(
    client, lab, caplog, monkeypatch, goes_on, page, count
) -> None:
    heard = [json.loads(text) for text in sent(client, page, count, (caplog, monkeypatch), goes_on)]
    acknowledged = {(each["run"], each["number"]) for each in heard if each["type"] == "ack"}
    assert len(heard) > count // 4
    assert (lab.fault, response_count(lab) >= len(acknowledged)) == (None, True)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
def test_study__requests_nobody_makes__keep_the_open_session_going(
    client, lab, caplog, monkeypatch, goes_on, count
) -> None:
    paths = ["/", "/static/common.css", "/s/token-S1", "/s/nobody", "/operator", "/ws/subject/token-S1", "/ws/operator"]
    answered = requesting.fuzz(client.port, requesting.heads(paths, TOKEN), count, caplog, monkeypatch, goes_on)
    assert answered > count // 4
    assert lab.fault is None
