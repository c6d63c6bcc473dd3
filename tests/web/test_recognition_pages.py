"""Recognition over the server's connections: what is said before an answer, what after, and what is refused."""

import json

import pytest

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import RecognitionProtocol, parse_protocol
from tactuator.experiment.protocol.recognition import block_trials
from tactuator.web.study_pages import build_app
from tests.experiment.session.apparatuses import ObedientClock
from tests.experiment.session.recognising import THREE, Opened, controller, items, opened_apparatus, protocol_text  # noqa: F401
from tests.web.labs import TOKEN, answer, at_page, at_pages, go_on, joined, make_lab, response_count, stage, until  # noqa: F401
from tests.web.server import served


@pytest.fixture
def make(make_lab, items, controller):

    def lab(text, auto_start=True):
        rest = (parse_protocol(text, RecognitionProtocol), text, items, opened_apparatus(controller))
        return make_lab(lambda store: Opened(*rest, store, ObedientClock()).study, auto_start)

    return lab


def begun(socket, heard=None):
    go_on(socket, "introduction")
    go_on(socket, "trial")
    return until(socket, "answer-now", heard)


def respond(socket, asked, response):
    socket.send_json({"type": "answer", "run": asked["run"], "number": asked["number"], "response": response})


def block_answered(socket, asked, responses):
    told = []
    for response in responses:
        told.append(answer(socket, asked if not told else until(socket, "answer-now"), response)["right"])
    return told


def planned(text, block):
    return block_trials(parse_protocol(text, RecognitionProtocol), 0, block)


@pytest.mark.parametrize("paradigm", ["recognition", "middle-of-three", "abx"])
def test_subject__before_the_answer__every_trial_is_told_in_the_same_words(make, paradigm) -> None:
    text = protocol_text(paradigm, training=0, test=4, labels=THREE)
    trials = planned(text, 0)
    with at_page(make(text)) as socket:
        told, asked = set(), begun(socket, first := [])
        for trial in trials[:9]:
            told.add(json.dumps(first))
            assert asked == {"type": "answer-now", "run": 1, "number": trial.number}
            acknowledged = answer(socket, asked, trial.responses[0])
            assert acknowledged["right"] is None  # no feedback in this block: not even afterwards
            asked = until(socket, "answer-now", first := [])
        assert len({trial.correct for trial in trials[:9]}) > 1
        assert len(told) == 1
        shown = [message["interval"] for message in json.loads(told.pop()) if message["type"] == "interval"]
        assert shown == ([0, 0, 1, 1, 2, 2] if paradigm == "abx" else [])


def test_subject__ready_for_what_cannot_be__is_refused_or_skips_no_break(make) -> None:
    with at_page(make(protocol_text(test=1))) as socket:
        for name in ("done", "consent", None):
            socket.send_json({"type": "ready", "stage": name})
            until(socket, "refused")
        socket.send_json({"type": "ready", "stage": "introduction"})
        go_on(socket, "trial")
        asked = until(socket, "answer-now")
        for name in ("introduction", "trial", "trial"):
            socket.send_json({"type": "ready", "stage": name})
        block_answered(socket, asked, ["M-index"] * 3)
        assert until(socket, "stage")["stage"] == "break"
        socket.send_json({"type": "ready", "stage": "break"})
        socket.send_json({"type": "ready", "stage": "break"})
        assert until(socket, "stage")["stage"] == "introduction"
        socket.send_json({"type": "ready", "stage": "trial"})
        socket.send_json({"type": "ready", "stage": "introduction"})
        assert until(socket, "stage")["stage"] == "trial"


def test_subject__second_tab__plays_the_same_trial_and_it_counts_once(make) -> None:
    text = protocol_text()
    with (
        served(build_app(lab := make(text), TOKEN)) as client,
        client.websocket_connect("/ws/subject/token-S1") as first,
    ):
        asked = begun(first)
        with client.websocket_connect("/ws/subject/token-S1") as second:
            until(first, "elsewhere")
            go_on(second, "trial")
            assert until(second, "answer-now") == asked
            answer(second, asked, "M-index")
            respond(second, asked, "C-index")  # the first tab's, say, come late
            assert until(second, "ack")["number"] == asked["number"]
        assert response_count(lab) == 1


@pytest.mark.parametrize("error", [OSError("the board is gone"), BadInput("the board's guard ended the run: travel")])
def test_rig__fails__is_told_and_stays_at_rest_until_the_operator_resumes(make, error, monkeypatch) -> None:
    lab = make(protocol_text(), auto_start=False)
    rig, rested = lab.apparatus.rig, []
    rest = rig.rest
    monkeypatch.setattr(rig, "rest", lambda: rested.append(rest()))
    lab.start(lab.sessions[0].id)

    def fails(*given):
        raise error

    with at_pages(lab, "S1", "operator") as (socket, operator):
        go_on(socket, "introduction")
        until(socket, "stage")
        with monkeypatch.context() as patched:
            patched.setattr(rig, "play", fails)
            socket.send_json({"type": "ready", "stage": "trial"})
            told = until(socket, "fault")
        assert str(error) in told["detail"]
        assert told["message"] == "The display has stopped. Please call the experimenter."
        assert rested
        while (shot := until(operator, "snapshot"))["fault"] is None:
            pass
        assert str(error) in shot["fault"]
        assert shot["paused"] is True
        go_on(socket, "trial")
        assert until(socket, "stage")["waiting"] is True
        operator.send_json({"type": "resume"})
        assert until(socket, "answer-now")["number"] == 0
        assert response_count(lab) == 0


def test_operator__snapshot__has_progress_and_percent_by_subject_and_block(make) -> None:
    text = protocol_text(test=1, subjects=("S1", "S2"))
    with at_pages(make(text), "S1", "operator") as (socket, operator):
        asked = begun(socket)
        block_answered(socket, asked, [trial.correct for trial in planned(text, 0)])
        go_on(socket, "break")
        asked = begun(socket)
        first, second, _ = planned(text, 1)
        answer(socket, asked, first.correct)
        wrong = next(one for one in second.responses if one != second.correct)
        answer(socket, until(socket, "answer-now"), wrong)
        while (shot := until(operator, "snapshot"))["sessions"][0]["trials"] < 5:
            pass
    assert [one["share_correct"] for one in shot["sessions"]] == [0.5, None]
    assert shot["sessions"][0]["progress"] == pytest.approx(5 / 6)
    assert [(one["state"], one["answered"], one["of"], one["share_correct"]) for one in shot["runs"]] == [
        ("done", 3, 3, 1.0),
        ("running", 2, 3, 0.5),
    ]
    picture = shot["picture"]
    assert picture["title"] == "Block 2 of 2: test, 2 of 3 trials"
    at = picture["labels"].index
    assert picture["counts"][at(first.correct)][at(first.correct)] == 1
    assert picture["counts"][at(second.correct)][at(wrong)] == 1
