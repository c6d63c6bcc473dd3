"""The subject's side: declining, pausing, stopping, leaving, breaks that the server keeps, practice to a criterion."""

import json
import time
from dataclasses import replace
from itertools import pairwise

import pytest
from sqlalchemy import select

from tactuator.experiment.session.session import Pace, Session
from tactuator.experiment.store import records, schema
from tactuator.experiment.store.records import Answer
from tactuator.experiment.words import shipped_words
from tactuator.web import lab as web_lab
from tactuator.web.study_pages import build_app
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, opened_study, response_of, rows_of
from tests.web.labs import (  # noqa: F401  # noqa: F401
    TOKEN,
    agreed,
    answer,
    at_page,
    at_pages,
    begun,
    client,
    go_on,
    joined,
    make,
    make_lab,
    response_count,
    stage,
    until,
)
from tests.web.server import served

RESTS = PROTOCOL.replace("break_after_trials = 20", "break_after_trials = 2\nbreak_s = 30")


def session(lab, number=0):
    with lab.store.read() as connection:
        return records.sessions(connection, lab.study.id)[number]


def events(lab):
    return [row.kind for row in rows_of(lab.store, select(schema.event).order_by(schema.event.c.id))]


@pytest.mark.parametrize("name", ["", " ", "Ada\x07"])
def test_consent__name_that_is_not_allowed__is_refused_in_the_pages_words(make, name) -> None:
    named = make(PROTOCOL.replace("[study]", '[study]\nlanguage = "de"\nconsent_by = "name"'))
    with at_pages(named, "S1") as (socket,):
        stage(socket, "consent")
        socket.send_json({"type": "consent", "name": name})
        assert until(socket, "refused")["said"] == shipped_words("de")("page.refused_name")
        assert rows_of(named.store, select(schema.session.c.consented_utc)) == [(None,), (None,)]


def test_consent__given_or_declined__is_stored_or_ends_the_session(make) -> None:
    lab = make(PROTOCOL.replace('consent = "', 'consent_version = "2026-03"\nconsent = "'))
    with at_pages(lab, "S1", "S2") as (socket, other):
        begun(socket)
        stage(other, "consent")
        other.send_json({"type": "decline"})
        assert stage(other, "ended")["ended"] == "declined"
        row, refused = session(lab), session(lab, 1)
    assert (row.consent_version, len(row.consent_sha256), row.protocol_version_id) == ("2026-03", 64, lab.study.version)
    assert (refused.ended, refused.consented_utc, events(lab)) == ("declined", None, ["declined"])
    assert {run.session_id for run in rows_of(lab.store, select(schema.run))} == {row.id}


def test_stop_for_today_and_pause__while_a_trial_waits__play_it_again_after(make) -> None:
    lab = make()
    with at_page(lab) as socket:
        stands = begun(socket)
        socket.send_json({"type": "stop"})
        stage(socket, "stopped")
        assert lab.active is None
    with at_page(lab) as socket:  # on another time
        go_on(socket, "trial")
        assert until(socket, "answer-now") == stands
        socket.send_json({"type": "pause"})
        stage(socket, "paused")
        assert list(lab.calls.values()) == ["S1 has paused."]
        socket.send_json({"type": "answer", "run": stands["run"], "number": 0, "response": "1"})
        until(socket, "refused")
        socket.send_json({"type": "ready", "stage": "paused"})
        go_on(socket, "trial")
        assert until(socket, "answer-now") == stands
        answer(socket, stands)
        assert lab.calls == {}
    assert events(lab) == ["stop", "pause", "resume"]
    assert rows_of(lab.store, select(schema.trial.c.presentations)) == [(3,)]


def test_pause__while_a_trial_plays__ends_it_at_once_and_rests_the_rig(make, monkeypatch) -> None:
    lab = make(PROTOCOL.replace("lead_s = 0.01", "lead_s = 30"))
    rig, rested, pieces, asks = lab.apparatus.rig, [], [], []
    stream, rest, present = rig.stream, rig.rest, Session.present

    def presented(session, watch, halted):
        asks.append(halted)
        return present(session, watch, halted)

    def slowly(blocks):
        for trace in stream(blocks):
            pieces.append(len(trace))
            while not asks[-1]():  # however long the pause takes to arrive
                time.sleep(0.01)
            yield trace

    monkeypatch.setattr(Session, "present", presented)
    monkeypatch.setattr(rig, "stream", slowly)
    monkeypatch.setattr(rig, "rest", lambda: (rested.append(sum(pieces)), rest()))
    with at_page(lab) as socket:
        agreed(socket)
        until(socket, "playing")
        socket.send_json({"type": "pause"})
        stage(socket, "paused")
        assert len(rested) == 1
        assert rested[0] < 30 * rig.rate_hz


@pytest.mark.parametrize(("keep", "how"), [(True, "withdrawn"), (False, "withdrawn-discard")])
def test_withdrawal__at_a_trial_or_while_paused__ends_the_session_for_good(make, keep, how) -> None:
    lab = make()
    with served(build_app(lab, TOKEN)) as client:
        with client.websocket_connect("/ws/subject/token-S1") as socket:
            answer(socket, begun(socket))
            for message, reached in (("pause", "paused"), ("stop", "stopped"), ("pause", "paused")) if keep else ():
                socket.send_json({"type": message})
                stage(socket, reached)
            socket.send_json({"type": "withdraw", "keep": keep})
            assert stage(socket, "ended")["ended"] == how
            assert lab.active is None
        with client.websocket_connect("/ws/subject/token-S1") as socket:
            assert stage(socket, "ended")["ended"] == how
            socket.send_json({"type": "withdraw", "keep": not keep})
        with client.websocket_connect("/ws/subject/token-S2") as socket:  # the rig is free
            begun(socket)
    assert session(lab).ended == how
    assert rows_of(lab.store, select(schema.run.c.state))[0] == ("stopped",)


def test_break__is_kept_by_the_server_whatever_the_page_says(make) -> None:
    lab = make(RESTS)
    clock = lab.clock
    with at_page(lab) as socket:
        answer(socket, begun(socket))
        answer(socket, until(socket, "answer-now"))
        assert stage(socket, "break")["break_left_s"] == 30.0
        socket.send_json({"type": "ready", "stage": "break"})
        assert "30 s are left" in until(socket, "refused")["message"]
        clock.wait(29.0)
        socket.send_json({"type": "ready", "stage": "break"})
        until(socket, "refused")
        again = lab.study.session(lab.sessions[0])  # as of a server that was begun anew: from the last answer
        assert (again.stage, again.break_left_s) == ("break", 1.0)
        clock.wait(1.0)
        socket.send_json({"type": "ready", "stage": "break"})
        stage(socket, "trial")


def test_time_left__whatever_the_rests__falls_with_every_run(make) -> None:
    lab = make()
    presented = lab.study.session(lab.sessions[0])
    presented.give_consent()
    at, left = presented, []
    while presented.stage != "done":
        if presented.stage == "break":
            presented.end_break()
        position = presented.upcoming.position
        following = at.present(lambda interval, begins: None)
        lab.clock.wait(2.0)
        at.answer(Answer(response_of(following.trial), lab.clock.utc(), received_s=lab.clock.monotonic_s()))
        lab.clock.wait(50.0)
        if presented.upcoming is None or presented.upcoming.position != position:
            left.append(presented.time_left_s)
    assert left[-1] == 0.0
    assert all(before > after for before, after in pairwise(left))
    assert left[1] < 300.0  # with the rests it would be an hour
    pace = Pace()
    for _ in range(5):
        pace.answered(0.35, played_s=2.0)
    assert [pace.trial_s(played_s) for played_s in (2.0, 5.5)] == pytest.approx([0.35, 0.7])


def test_demonstration__on_a_simulated_display__shows_each_interval(make) -> None:
    lab, heard = make(shown="seen or heard"), []
    with at_page(lab) as socket:
        hello = until(socket, "hello")
        assert (hello["simulated"], hello["shown"]) == (True, "seen or heard")
        agreed(socket)
        until(socket, "answer-now", heard)
        right = int(lab.opened(1).pending[0].trial.correct) - 1
    shapes = [max(one["envelope_db_sl"]) for one in heard if one["type"] == "shape"]
    assert len(shapes) == 3
    assert shapes.index(max(shapes)) == right
    assert sorted(shapes)[:2] == [-60.0, -60.0]
    assert max(shapes) == pytest.approx(30.0, abs=1.0)
    (run,) = rows_of(lab.store, select(schema.run))
    assert (run.rig_simulated, run.shown, run.respondent) == (True, "seen or heard", "person")


def test_link__with_what_others_call_the_subject__keeps_it_and_refuses_another(make) -> None:
    lab = make()
    with served(build_app(lab, TOKEN)) as client:
        assert [client.request("POST", "/s/token-S1?participant=abc-1", {}).status for _ in range(2)] == [204, 204]
        for path in ("/s/token-S1?participant=other", "/s/token-S2?participant=abc-1", "/s/token-S2?participant=a%20b"):
            answer = client.request("POST", path, {})
            assert (answer.status, answer.text) == (
                403,
                "This link cannot be opened with this participant id. Please ask the experimenter.\n",
            )
        assert client.request("POST", "/s/token-S2?participant=" + "x" * 65, {}).status == 422
    assert [row.participant_id for row in lab.study.sessions()] == ["abc-1", None]


def test_link__opened_by_a_scanner_or_from_another_page__claims_nothing(make) -> None:
    lab = make()
    with served(build_app(lab, TOKEN)) as client:
        for method in ("GET", "HEAD", "OPTIONS", "PUT"):
            assert client.request(method, "/s/token-S1?participant=abc-1", {}).status in (200, 405)
        elsewhere = {"Origin": "https://other.example"}
        assert client.request("POST", "/s/token-S1?participant=abc-1", elsewhere).status == 404
        assert client.request("POST", "/s/none?participant=abc-1", {}).status == 404
    assert [row.participant_id for row in lab.study.sessions()] == [None, None]


def test_page__texts_of_the_protocol__have_the_direction_of_their_letters_in_any_language(make) -> None:
    with served(build_app(make(PROTOCOL.replace("seed = 7", 'seed = 7\nlanguage = "he"')), TOKEN)) as client:
        page = client.request("GET", "/s/token-S1", {}).text
    assert 'dir="rtl"' in page
    for name in ("study", "who", "text"):
        assert f'id="{name}" dir="auto"' in page, name


def test_claims__without_an_end__are_kept_up_to_a_bound(make, monkeypatch) -> None:
    monkeypatch.setattr(web_lab, "NOTES_MAX", 3)
    lab = make()
    with served(build_app(lab, TOKEN)) as client:
        statuses = [client.request("POST", f"/s/token-S1?participant=a{k}", {}).status for k in range(6)]
    assert statuses == [204, *[403] * 5]
    assert len(events(lab)) == 3


def test_pauses__without_an_end__are_kept_up_to_a_bound_and_still_silence(make, monkeypatch) -> None:
    monkeypatch.setattr(web_lab, "NOTES_MAX", 6)
    lab = make()
    with at_page(lab) as socket:
        begun(socket)
        for _ in range(10):
            socket.send_json({"type": "pause"})
            stage(socket, "paused")
            socket.send_json({"type": "ready", "stage": "paused"})
            go_on(socket, "trial")
            until(socket, "answer-now")
    assert events(lab) == ["pause", "resume"] * 3
    details = rows_of(lab.store, select(schema.event.c.detail).order_by(schema.event.c.id))
    assert details[-1] == ("by the subject; the last of 6 that are kept",)


def test_operator__corrects_what_was_noted__and_the_page_shows_it(make) -> None:
    age = '[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\nhigh = 120\n\n'
    lab = make(PROTOCOL.replace("[[subject]]", age + "[[subject]]", 1))
    with at_pages(lab, "operator") as (socket,):
        assert until(socket, "snapshot")["sessions"][0]["demographics"] == {}
        message = {"type": "correct", "subject": "S1", "reason": "asked again", "demographics": {"age": "34"}}
        socket.send_json({**message, "group": "unknown", "participant_id": "q7"})
        while (found := until(socket, "snapshot")["sessions"][0])["demographics"] == {}:
            pass
        assert (found["group"], found["participant_id"], found["demographics"]) == ("unknown", "q7", {"age": "34"})
        for amiss, words in (({"demographics": {}}, "nothing was changed"), ({"reason": ""}, "Reason")):
            socket.send_json({**message, **amiss})
            assert words in until(socket, "refused")["message"]
    assert events(lab) == ["correction"] * 3


def test_operator__enrols_plans_a_visit_and_writes_the_day(make) -> None:
    lab = make()
    with served(build_app(lab, TOKEN)) as client, client.websocket_connect("/ws/operator") as socket:
        socket.send_text(TOKEN)
        until(socket, "snapshot")
        for message in (
            {"type": "enrol", "code": "S9", "group": "hearing", "participant_id": "q1"},
            {"type": "new-visit", "subject": "S1"},
            {"type": "day", "session": 1, "skin_temperature_c": 30.5, "preload_n": 0.4},
        ):
            socket.send_json(message)
        while len((found := until(socket, "snapshot"))["sessions"]) < 4 or found["sessions"][0]["preload_n"] is None:
            pass
        who = [(one["subject"], one["visit"]) for one in found["sessions"]]
        assert who == [("S1", 1), ("S1", 2), ("S2", 1), ("S9", 1)]
        assert client.get("/s/token-S9").status == 200


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
        session = lab.opened(1)
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
        session = lab.opened(1)
    assert (now["stage"], now["introduction"]) == ("trial", "Practice is over. From now on your answers count.")
    assert (session.failed_practice, session.upcoming.position) == (None, 1)


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


def test_answer__that_cannot_be__is_refused_and_nobody_else_notices(client, lab) -> None:
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
        assert "before the interval ended" in until(socket, "refused")["message"]
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
            patched.setattr(presented, "answer", lambda *these: 1 / 0)
            socket.send_json({"type": "answer", "run": stands["run"], "number": 0, "response": "1"})
            until(socket, "fault")
        assert (rested, lab.paused) == ([], False)
        answer(socket, stands)
        monkeypatch.undo()


def test_operator__field_that_cannot_be_taken__is_named_in_the_language_of_the_page(make) -> None:
    lab = make()
    lab.study.task = replace(lab.study.task, words=shipped_words("de"))
    for message, field in (
        ({"type": "enrol", "code": "S 9"}, "code"),
        ({"type": "enrol", "code": "S9", "participant_id": "a b"}, "participant_id"),
        ({"type": "correct", "subject": "S1", "reason": ""}, "reason"),
        ({"type": "day", "session": 1, "skin_temperature_c": "warm"}, "skin_temperature_c"),
    ):
        with at_pages(lab, "operator") as (socket,):
            socket.send_json(message)
            refused = until(socket, "refused")
        label = {
            "code": "Kürzel",
            "participant_id": "Externe",
            "reason": "Grund",
            "skin_temperature_c": "Hauttemperatur",
        }
        assert refused["field"] == field
        assert label[field][:4] in refused["message"]


def test_first_run_after_practice__is_announced_and_waits_for_the_subject(make) -> None:
    lab = make()
    announced = "Practice is over. From now on your answers count."
    with at_page(lab) as socket:
        stands = begun(socket)
        answer(socket, stands)
        answer(socket, until(socket, "answer-now"))
        assert until(socket, "stage")["introduction"] == announced
        with pytest.raises(TimeoutError):
            socket._connection.recv(timeout=0.3)
        socket.send_json({"type": "ready", "stage": "trial"})
        until(socket, "answer-now")
