"""The rig's connection: who has the controls, frames, refusals; and a study at it, begun, stopped, resumed."""

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tactuator.console.page_server import build_console
from tactuator.console.state import ConsoleState
from tactuator.experiment.store.records import Answer
from tactuator.experiment.store.store import Store, sessions_of
from tactuator.io.controller import write_controller
from tactuator.web.sockets import CLOSE_ABSENT, CLOSE_FORBIDDEN
from tests.console.pages import TOKEN, dropped
from tests.console.rig_page import Page, Studies, answered, at_subject, loaded, operator, rows
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, begin, nobody
from tests.web.labs import until
from tests.web.server import served

LOOK = {"span_s": 0.1, "columns": 100}


@pytest.fixture
def live(console, controller):
    page = Page(console)
    if page.standing["controls"] != "you":
        page.ask("take")
    if page.standing["mode"] != "live":
        console.host.call("load", controller)
        page.ask("live")
    page.until(lambda: page.standing["mode"] == "live")
    yield page
    page.open.close()


def test_frames__come_as_the_page_draws_them_and_hold_every_sample(live):
    live.ask("wave", wave={"kind": "tone", "level_db_sl": 20.0, "channels": ["index"], "frequency_hz": 50.0})
    live.until(lambda: live.standing["wave"])
    live.ask("look", look={"span_s": 0.5, "columns": 2000})
    del live.frames[:]
    live.until(lambda: len(live.frames) >= 12)
    held = {}
    for (_, columns, series, values, first, step, *_), data in live.frames:
        assert (series, values, step) == (9, 1, 1.0)
        for place, value in enumerate(data.reshape(series, columns)[6]):
            assert held.setdefault(int(first) + place, value) == value
    assert sorted(held) == list(range(min(held), max(held) + 1))
    assert live.frames[-1][0][9] == 0


def test_page__that_draws_nothing__gets_two_frames_and_the_rig_goes_on(console, live):
    slow = Page(console, draws=False)
    slow.ask("look", look=LOOK)
    before = console.host.samples.end
    live.ask("look", look=LOOK)
    live.until(lambda: console.host.samples.end > before + 2000)
    slow.ask("save", channel="index", span_s=0.01, end=before)
    assert len(slow.frames) == 2
    slow.socket.send(json.dumps({"id": 0, "do": "drawn", "frame": 2}))
    slow.until(lambda: len(slow.frames) == 3)
    assert slow.frames[2][0][8] > 3
    assert console.host.samples.lost == 0
    slow.open.close()


def test_controls__are_one_pages_and_can_be_taken_and_given(console, live):
    other = Page(console)
    assert other.standing["controls"] == "another"
    assert (
        "this page watches"
        in other.ask("wave", wave={"kind": "tone", "level_db_sl": 1.0, "channels": ["index"]})["error"]
    )
    assert "error" not in other.ask("stop")
    other.ask("take")
    other.until(lambda: other.standing["controls"] == "you")
    live.until(lambda: live.standing["controls"] == "another")
    assert "this page watches" in live.ask("touch", channel="index", load="finger")["error"]
    other.ask("give")
    live.until(lambda: live.standing["controls"] == "nobody")
    live.ask("take")
    live.ask("wave", wave={"kind": "tone", "level_db_sl": 20.0, "channels": ["index"]})
    other.until(lambda: other.standing["wave"])
    live.open.close()  # whoever had the controls has gone: the generator goes silent
    other.until(lambda: other.standing["wave"] is None and other.standing["controls"] == "nobody")
    other.open.close()


def test_single_shot__waits_for_the_trigger_and_then_stands(live):
    live.ask("look", look={**LOOK, "mode": "single", "channel": "index", "signal": "reference", "level": 5.0})
    live.ask("wave", wave={"kind": "tone", "level_db_sl": 20.0, "channels": ["index"], "frequency_hz": 50.0})
    del live.frames[:]
    live.until(lambda: live.frames)
    head, data = live.frames[0]
    assert head[11] == 1
    _number, columns, series, values, first, step, _, crossing = head[:8]
    reference = data.reshape(series, columns, values)[0]
    place = int((crossing - first) // step)
    assert reference[place, -1] >= 5.0 > reference[place - 1, 0]
    live.ask("save", channel="index", span_s=0.2, end=int(crossing))
    assert len(live.frames) == 1


def test_request__that_cannot_be_met__is_refused_in_words(live):
    loud = {"kind": "tone", "level_db_sl": 99.0, "channels": ["index"]}
    for asked, words in (
        ("no json", "a request of the console's page"),
        ({"do": "look", "look": {"span_s": 0.0, "columns": 10}}, "span_s"),
        ({"do": "look", "look": {"span_s": 1.0, "columns": 10**6}}, "columns"),
        ({"do": "wave", "wave": loud}, "-60 to 55 dB SL"),  # by the rig itself
        ({"do": "touch", "channel": "index", "load": "elbow"}, "no load 'elbow'"),
        ({"do": "press", "channel": "index", "force_v": 1e9}, "force_v"),
        ({"do": "save", "channel": "index", "span_s": 1.0, "end": 10**12}, "not kept any more"),
        ({"do": "controller", "source": "file", "file": "../../etc"}, "drop it again"),
        ({"do": "controller", "source": "loops"}, "file"),
    ):
        live.others.clear()
        live.socket.send(asked if isinstance(asked, str) else json.dumps({"id": 7, **asked}))
        live.until(lambda: any({"error", "refused"} & each.keys() for each in live.others))
        assert words in str(live.others[-1])


def test_controller__with_a_curve_of_its_own__levels_are_over_that_curve(console, live, controller, tmp_path):
    first, before, rows = controller.display.channels[0], console.host.levels, np.eye(4000, 9, dtype=np.float32)
    curve = replace(first.threshold.curve, name="mine", level_db_re_1um=first.threshold.curve.level_db_re_1um + 6.0)
    mine = replace(first, threshold=replace(first.threshold, curve=curve))
    display = replace(controller.display, channels=(mine, *controller.display.channels[1:]))
    write_controller(tmp_path / "mine.json", replace(controller, display=display))
    live.ask("controller", source="file", file=dropped(console.state, tmp_path / "mine.json"))
    live.until(lambda: live.standing["controller"]["curve"].startswith("mine, "))
    both = [levels.of_rows(rows)[0].level_db_sl for levels in (before, console.host.levels)]
    assert both[0] - both[1] == pytest.approx(6.0)


def closed_with(client, path, token, **more):
    with connect(f"ws://127.0.0.1:{client.port}{path}", **more) as socket, pytest.raises(ConnectionClosed) as closed:
        socket.send(token)
        socket.recv(timeout=10.0)
    return closed.value.rcvd.code


def test_connection__without_token_or_rig__is_closed_and_told_why(console, run):
    for path in ("/ws", "/ws/rig", "/ws/study"):
        assert closed_with(console, path, "another") == CLOSE_FORBIDDEN
        assert closed_with(console, path, TOKEN, origin="http://elsewhere.example") == CLOSE_FORBIDDEN
    with served(build_console(ConsoleState(), TOKEN)) as client:
        assert [closed_with(client, path, TOKEN) for path in ("/ws/rig", "/ws/study")] == [CLOSE_ABSENT] * 2
        assert client.get("/s/token-S1").status == 404
    run.refused("console", "--rig", "simulated", said="tactuator console DISPLAY.toml --rig simulated")


STORE = "lab.db"


@pytest.fixture
def protocol(console, tmp_path):
    (tmp_path / "short.toml").write_text(PROTOCOL)
    return dropped(console.state, tmp_path / "short.toml")


@pytest.fixture
def studies(console):
    with console.websocket_connect("/ws/study") as socket:
        made = Studies(socket)
        yield made
        made.ask("end")


def test_study__at_the_consoles_rig__stores_what_one_at_its_own_rig_does(console, studies, protocol, tmp_path):
    with loaded(console) as page:
        assert "error" not in studies.ask("begin", protocol=protocol, store=STORE, auto_start=True)
        assert studies.study["open"]["study"] == "short"
        assert "experiment serve short.toml --store lab.db" in studies.study["open"]["commands"][0][1]
        page.until(lambda: page.standing["controls"] == "experiment")
        for request in ({"do": "take"}, {"do": "live"}, {"do": "reopen"}):
            assert "an experiment has" in page.ask(**request)["error"]
        assert "is open" in studies.ask("begin", protocol=protocol, store="other.db")["error"]
        before = console.host.samples.end
        with at_subject(console) as socket:
            answered(socket, 1)
            assert console.host.samples.end > before  # the scope sees what is played
            studies.ask("end")
            with pytest.raises(ConnectionClosed) as closed:
                until(socket, "never")
        assert closed.value.rcvd.code == 4004
        page.until(lambda: page.standing["controls"] == "nobody")
        assert console.get("/operator").status == 404
        assert "error" not in studies.ask("begin", protocol=protocol, store=STORE, auto_start=True)
        with at_subject(console) as socket:
            until(socket, "stage")
            socket.send_json({"type": "ready", "stage": "introduction"})
            socket.send_json({"type": "ready", "stage": "trial"})
            asked = until(socket, "answer-now")
            assert asked["number"] == 1
    alone = Store(tmp_path / "alone.db")
    clock = ObedientClock()
    presented = begin(alone, clock)
    presented.present(nobody)
    presented.answer(Answer("2", clock.utc()))
    alone.close()
    assert rows(console.folder / STORE) == rows(tmp_path / "alone.db") != []


def test_stop__of_a_page_that_watches__ends_what_the_study_plays(console, studies, protocol):
    with loaded(console):
        studies.ask("begin", protocol=protocol, store="stopped.db")
        with console.websocket_connect("/ws/operator") as socket:
            session = operator(socket)["sessions"][0]["id"]
            socket.send_json({"type": "start", "session": session})
            while until(socket, "snapshot")["active"] != session:
                pass
            for token, status in (("another", 403), (TOKEN, 200)):
                assert console.request("POST", "/rest", {"x-token": token}).status == status
            while until(socket, "snapshot")["active"] is not None:
                pass


def test_export__of_a_store__is_what_the_command_writes(console, studies, protocol, tmp_path, run):
    with loaded(console):
        studies.ask("begin", protocol=protocol, store="exported.db", auto_start=True)
        assert "; " in studies.ask("export", store="exported.db", form="tidy")["error"]  # nothing is answered yet
        with at_subject(console) as socket:
            answered(socket, 1)
        made = studies.ask("export", store="exported.db", form="tidy")
    assert made["trials"] == 1
    with zipfile.ZipFile(console.state.uploads.path(made["key"])) as packed:
        ours = {name.removeprefix("tidy/"): packed.read(name) for name in packed.namelist() if not name.endswith("/")}
    out = tmp_path / "tidy"
    assert run("experiment", "export", "--store", console.folder / "exported.db", "--out", out).status == 0
    theirs = {str(one.relative_to(out)): one.read_bytes() for one in out.rglob("*") if one.is_file()}
    assert ours == theirs


def test_study__that_cannot_begin__is_refused_and_leaves_rig_and_folder(console, studies, protocol, tmp_path):
    def written(text):
        (tmp_path / "bad.toml").write_text(text)
        return {"protocol": dropped(console.state, tmp_path / "bad.toml")}

    strange = PROTOCOL.replace("seed = 7", 'seed = 7\nlanguage = "xx"\nlanguage_file = "own.toml"')
    with loaded(console) as page:
        for change, words in (
            ({"store": "../up.db"}, "store"),
            ({"store": None}, "a request of the console's page"),
            ({"protocol": "nothing"}, "drop it again"),
            ({"protocol": "example:../../display.toml"}, "drop it again"),
            ({"files": ["gone"]}, "drop it again"),
            ({"amend": "x" * 500}, "amend"),
            (written("[study]\nname = 3"), "; "),
            (written(PROTOCOL.replace('["index"]', '["toe"]')), "finger 'toe' is not on the display"),
            (written(strange), "own.toml"),
        ):
            said = studies.ask("begin", **{"protocol": protocol, "store": "refused.db", **change})["error"]
            assert (words in said, "\n" in said, str(console.state.uploads.folder()) in said) == (True, False, False)
            page.until(lambda: page.standing["controls"] == "nobody")
        assert studies.study == {"open": None}
        assert not [each for each in console.folder.iterdir() if each.name.startswith("refused")]
        with sessions_of(console.folder / "busy.db"):
            said = studies.ask("begin", protocol=protocol, store="busy.db")["error"]
            assert "its sessions are run by process" in said
        page.ask("take")
        assert "another page has the controls" in studies.ask("begin", protocol=protocol, store=STORE)["error"]
        page.ask("give")
