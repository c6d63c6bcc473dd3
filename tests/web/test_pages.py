"""The server without a browser: who gets which page, what a connection may say, what is acknowledged, and kills."""

import pytest
from sqlalchemy import select
from websockets.exceptions import ConnectionClosed

from tactuator.errors import StoreFault
from tactuator.experiment.store import records, schema
from tactuator.experiment.words import shipped_words
from tactuator.web.sockets import CLOSE_ABSENT, CLOSE_FORBIDDEN
from tests.experiment.session.apparatuses import PROTOCOL, answer_one, rows_of
from tests.web.access.mutating import defects, hear_all
from tests.web.labs import TOKEN, at_pages, begun, client, joined, lab, make, make_lab, response_count, until  # noqa: F401


def test_page__asked_for__is_given_or_not_and_every_part_comes_from_this_server(client, caplog, monkeypatch) -> None:
    hear_all(monkeypatch)
    for path in ("/", "/s/token-S1", "/operator", "/static/subject.js"):
        answer = client.get(path)
        assert (answer.status, "style=" in answer.text, "http" in answer.text) == (200, False, False), path
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
    foreign = ("app.py", "..%2Fapp.py", "%2e%2e%2fapp.css", "%00.css", f"{'9' * 5000}.css")
    for path in ("/s/token-S9", "/docs", "/openapi.json", *(f"/static/{name}" for name in foreign)):
        assert client.get(path).status == 404, path
    assert defects(caplog) == []


def test_subject__trial_answered__is_acknowledged_once_it_is_stored(client, lab, monkeypatch) -> None:
    def full(*args: object) -> None:
        raise StoreFault("lab.db: database or disk is full")

    with client.websocket_connect("/ws/subject/token-S1") as socket:
        asked = begun(socket)
        message = {"type": "answer", "run": asked["run"], "number": asked["number"], "response": "1"}
        with monkeypatch.context() as broken:
            broken.setattr(records, "save_answer", full)
            socket.send_json(message)
            assert "full" in until(socket, "fault")["detail"]
        assert (response_count(lab), lab.fault) == (0, "lab.db: database or disk is full")
        socket.send_json(message)
        acknowledged = until(socket, "ack")
        assert (response_count(lab), lab.fault) == (1, None)
        assert (acknowledged["run"], acknowledged["number"]) == (asked["run"], asked["number"])
        assert acknowledged["right"] in ("1", "2", "3")
        assert until(socket, "answer-now")["number"] == asked["number"] + 1


def test_connection__of_no_link_a_wrong_token_or_another_sites_page__is_closed(client) -> None:
    elsewhere = "http://elsewhere.example"
    for path, said, origin, code in (
        ("subject/token-S9", None, None, CLOSE_ABSENT),
        ("subject/token-S1", TOKEN, elsewhere, CLOSE_ABSENT),
        ("operator", TOKEN, elsewhere, CLOSE_FORBIDDEN),
        *(("operator", wrong, None, CLOSE_FORBIDDEN) for wrong in ("", "wrong", "token-S1", "ü")),
    ):
        with client.websocket_connect(f"/ws/{path}", origin) as socket, pytest.raises(ConnectionClosed) as closed:
            if said is not None:
                socket.send_text(said)
            socket.receive_json()
        assert closed.value.rcvd.code == code, (path, said)


def test_operator__second__looks_on_until_control_is_taken(client) -> None:
    with client.websocket_connect("/ws/operator") as first, client.websocket_connect("/ws/operator") as second:
        first.send_text(TOKEN)
        assert until(first, "snapshot")["control"] is True
        second.send_text(TOKEN)
        assert until(second, "snapshot")["control"] is False
        second.send_json({"type": "pause"})
        assert "another operator has control" in until(second, "refused")["message"]
        second.send_json({"type": "take-control"})
        while not until(second, "snapshot")["control"] or until(first, "snapshot")["control"]:
            pass


@pytest.mark.parametrize("typed", ["0,5", "0.5", "\u0660\u066b\u0665", "\uff10.\uff15", " .5 "])
def test_operator__number_of_a_form_or_a_code__is_stored_as_it_was_meant_and_doubts_are_said(
    client, lab, typed
) -> None:
    with joined(client, "operator") as socket:
        socket.send_json({"type": "day", "session": 1, "preload_n": typed})
        assert until(socket, "done")["message"] == ""
        assert rows_of(lab.store, select(schema.session.c.preload_n).where(schema.session.c.id == 1)) == [(0.5,)]
        socket.send_json({"type": "enrol", "code": "s1"})
        assert until(socket, "done")["message"] == "s1 is enrolled. s1 is mixed with S1 by other programs"
        socket.send_json({"type": "enrol", "code": "1E5"})
        assert "1E5 is the number 100000 to spreadsheets" in until(socket, "done")["message"]


def test_operator__nonsense_or_a_clock_that_jumps__is_refused_or_noted(client, lab) -> None:
    with joined(client, "operator") as socket:
        for command, message in (
            ({"type": "start"}, "without a session"),
            ({"type": "start", "session": 99}, "not of this study"),
            ({"type": "start", "session": 2**63}, "command"),
            ({"type": "day", "session": 99}, "not of this study"),
            ({"type": "day", "session": 1, "skin_temperature_c": 99.0}, "Skin temperature, °C"),
            ({"type": "day", "session": 1, "preload_n": "1,234"}, "thousands"),
            ({"type": "day", "session": 1, "preload_n": "0,5 N"}, "a number"),
            ({"type": "enrol", "code": "S 9"}, "Code"),
            ({"type": "new-visit", "subject": "S8"}, "'S8' is not in the study"),
            ({"type": "give-up-run"}, "no session is at the rig"),
            ({"type": "explode"}, "command"),
        ):
            socket.send_json(command)
            assert message in until(socket, "refused")["message"]
    with joined(client, "operator") as socket:
        until(socket, "snapshot")
        lab.clock.jump(3600.0)
        until(socket, "snapshot")
        until(socket, "snapshot")
    assert rows_of(lab.store, select(schema.event.c.detail)) == [("the wall clock moved by 3600.0 s",)]


FACTS = """
[[demographic]]
name = "age"
label = "AGE"
kind = "number"
low = 18
high = 99
required = true
[[demographic]]
name = "hand"
label = "HAND"
kind = "choice"
choices = ["R", "L"]
[[demographic]]
name = "note"
label = "NOTE"
"""


@pytest.mark.parametrize("language", ["de", "en", "fr", "he"])
def test_operator__field_that_is_not_allowed__is_named_with_what_is_in_the_language_of_the_page(make, language) -> None:
    words = shipped_words(language)
    text = PROTOCOL.replace("seed = 7", f'seed = 7\nlanguage = "{language}"')
    lab = make(text.replace("[[subject]]", "[[subject]]\ndemographics = {age = 30}") + FACTS)
    enrol, correct = {"type": "enrol", "code": "N1"}, {"type": "correct", "subject": "S1", "reason": "heard wrongly"}
    void = {"type": "void", "session": 1, "void": True}
    day, skin = {"type": "day", "session": 1}, {"low": 0, "high": 50}
    number, force, trial = {"low": 18, "high": 99}, {"low": 0, "high": 1000}, {"low": 0, "high": 2**31 - 1}
    wrong = [
        (enrol, "AGE", "number", number),
        (enrol | {"demographics": {"age": "17"}}, "AGE", "number", number),
        (enrol | {"demographics": {"age": "1,234"}}, "AGE", "number", number),
        (correct | {"demographics": {"age": "old"}}, "AGE", "number", number),
        (correct | {"demographics": {"age": " "}}, "AGE", "number", number),
        (correct | {"demographics": {"hand": "both"}}, "HAND", "choice", {"choices": "R, L"}),
        (correct | {"demographics": {"note": "n" * 201}}, "NOTE", "text", {"most": 200}),
        (correct | {"demographics": {"note": "a\x07b"}}, "NOTE", "text", {"most": 200}),
        (correct | {"reason": "a\x07b"}, words("operator.reason"), "text", {"most": 200}),
        (void | {"reason": "a\x07b"}, words("operator.reason"), "text", {"most": 200}),
        (void | {"reason": "why", "trial": str(2**31)}, words("operator.trial"), "number", trial),
        (day | {"skin_temperature_c": "50,1"}, words("operator.skin_temperature"), "number", skin),
        (enrol | {"code": "N 1"}, words("operator.code"), "code", {}),
        (enrol | {"group": "?"}, words("operator.group"), "group", {}),
        (enrol | {"participant_id": "a b"}, words("operator.participant_id"), "participant_id", {}),
        (correct | {"reason": ""}, words("operator.reason"), "text", {"most": 200}),
        (void | {"reason": " "}, words("operator.reason"), "text", {"most": 200}),
        (void | {"reason": "why", "run": 1, "trial": "x"}, words("operator.trial"), "number", trial),
        (day | {"preload_n": "0,5 N"}, words("operator.contact_force"), "number", force),
    ]  # fmt: skip
    with at_pages(lab, "operator") as (socket,):
        for message, field, key, values in wrong:
            socket.send_json(message)
            allowed = words(f"operator.allowed_{key}", **values)
            reason = words("operator.refused_field", field=field, allowed=allowed)
            assert until(socket, "refused")["message"] == words("operator.refused", reason=reason), message
        socket.send_json(enrol | {"demographics": {"age": "44", "note": "007"}})
        said = words("codes.number", code="007", value="7")
        assert until(socket, "done")["message"] == words("operator.enrolled", code="N1", doubts=said)
        socket.send_json(correct | {"group": "1E5", "demographics": {"note": "NA"}})
        said = words("codes.number", code="1E5", value="100000"), words("codes.missing", code="NA")
        assert until(socket, "done")["message"] == "; ".join(said)


@pytest.mark.parametrize("language", ["de", "en", "fr", "he"])
def test_operator__code_or_id_that_is_taken__is_refused_at_its_field(make, language) -> None:
    words = shipped_words(language)
    text = PROTOCOL.replace("seed = 7", f'seed = 7\nlanguage = "{language}"')
    lab = make(text.replace("[[subject]]", '[[subject]]\nparticipant_id = "p1"', 1))
    with at_pages(lab, "operator") as (socket,):
        for field, key, given in (("code", "taken", "S1"), ("participant_id", "id_taken", "p1")):
            socket.send_json({"type": "enrol", "code": "N1", field: given})
            said = words("operator.refused", reason=words(f"operator.refused_{key}", code=given))
            assert until(socket, "refused") == {"type": "refused", "message": said, "field": field}
    assert words("operator.code").casefold() in words("operator.refused_taken", code="S1").casefold()
    assert "--" not in words("operator.allowed_number", low=-20, high=120)


@pytest.mark.parametrize("edge", ["0", "50"])
def test_operator__skin_temperature_at_the_end_of_its_range__is_taken(make, edge) -> None:
    with at_pages(make(), "operator") as (socket,):
        socket.send_json({"type": "day", "session": 1, "skin_temperature_c": edge})
        assert until(socket, "done")["message"] == ""


def test_operator__part_made_void_and_restored__is_that_of_the_command_and_closes_the_page_of_the_visit(make) -> None:
    lab = make(auto_start=False)
    session = lab.study.session(lab.sessions[0])
    session.give_consent("")
    run, _ = answer_one(session, lab.clock), session.stop_run()
    with at_pages(lab, "operator", "S1") as (socket, subject):
        until(subject, "stage")
        for part in ({"run": 1, "trial": 0}, {"run": 1}, {}):
            for void in (True, False):
                socket.send_json({"type": "void", "session": 1, "void": void, "reason": "fell asleep", **part})
                heard = []
                while not heard or heard[-1]["type"] == "snapshot":
                    heard.append(socket.receive_json())
                assert heard[-1] == {"type": "done", "message": ""}
                key = {"run": None, "trial": None, **part}
                parts = until(socket, "snapshot")["sessions"][0]["parts"]
                given = {(each["run"], each["trial"]): each["void"] for each in parts}
                assert given.get(tuple(key.values())) == ("fell asleep" if void else None), (part, void)
        until(subject, "changed")
        events = rows_of(lab.store, select(schema.event.c.kind).where(schema.event.c.kind.in_(("void", "restored"))))
        assert [kind for (kind,) in events] == ["void", "restored"] * 3
        for part in ({"run": 1, "trial": 99}, {"void": False}, {"run": 7}):
            socket.send_json({"type": "void", "session": 1, "void": True, "reason": "again", **part})
            assert "nothing was changed" in until(socket, "refused")["message"]
        socket.send_json({"type": "start", "session": 1})
        socket.send_json({"type": "void", "session": 1, "void": True, "reason": "again"})
        assert "S1 is at the rig" in until(socket, "refused")["message"]
    assert run is not None
