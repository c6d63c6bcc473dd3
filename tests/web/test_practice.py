"""Practice as the subject goes through it: to a criterion, not passed, given up by the operator."""

from sqlalchemy import select

from tactuator.experiment.store import schema
from tactuator.web.study_pages import build_app
from tests.experiment.session.apparatuses import PROTOCOL, rows_of
from tests.web.labs import TOKEN, answer, at_page, go_on, joined, make, make_lab, stage, until  # noqa: F401
from tests.web.server import served

PRACTISES = PROTOCOL.replace("practice_trials = 2", "practice_trials = 2\npractice_correct = 2\npractice_limit = 3")


def failed(lab, socket):
    """Go through the practice of a subject who has read its introduction, with a wrong answer each time."""
    socket.send_json({"type": "ready", "stage": "introduction"})
    go_on(socket, "trial")
    for _ in range(3):
        stands = until(socket, "answer-now")
        right = lab.opened(1).pending[0].trial.correct
        answer(socket, stands, next(one for one in "123" if one != right))


def test_practice__not_passed__calls_the_experimenter_and_begins_again(make) -> None:
    lab = make(PRACTISES, auto_start=False)
    lab.start(1)
    with at_page(lab) as socket:
        stage(socket, "consent")
        socket.send_json({"type": "consent"})
        assert "2 of 2 right" in stage(socket, "introduction")["introduction"]
        failed(lab, socket)
        assert lab.paused
        assert "has not passed" in lab.calls[1]
        stage(socket, "introduction")
        lab.pause(False)
        assert lab.calls == {}
        socket.send_json({"type": "ready", "stage": "introduction"})
        go_on(socket, "trial")
        for _ in range(2):
            stands = until(socket, "answer-now")
            answer(socket, stands, lab.opened(1).pending[0].trial.correct)
        session = lab.opened(1).session
    assert [one.state for one in session.tally][:1] == ["done"]
    query = select(schema.run.c.attempt, schema.run.c.state).where(schema.run.c.position == 0)
    assert rows_of(lab.store, query) == [(0, "restarted"), (1, "done")]


def test_practice__given_up_while_the_page_waits__the_page_shows_what_comes_instead(make) -> None:
    lab = make(PRACTISES, auto_start=False)
    lab.start(1)
    with served(build_app(lab, TOKEN)) as client, client.websocket_connect("/ws/subject/token-S1") as socket:
        stage(socket, "consent")
        socket.send_json({"type": "consent"})
        stage(socket, "introduction")
        failed(lab, socket)
        assert "ractice" in stage(socket, "introduction")["introduction"]
        with joined(client, "operator") as operator:
            operator.send_json({"type": "give-up-run"})
            now = until(socket, "stage")
        session = lab.opened(1).session
    assert (now["stage"], now["introduction"]) == ("trial", "")
    assert (session.held, session.upcoming.position) == (None, 1)
