"""A study at the console's rig: begun, refused, watched, stopped, exported, ended and resumed."""

import zipfile

import pytest
from websockets.exceptions import ConnectionClosed

from tactuator.cli.main import main
from tactuator.experiment.store.records import Answer
from tactuator.experiment.store.store import Store, sessions_of
from tests.console.pages import dropped
from tests.console.rig_page import Studies, answered, at_subject, loaded, operator, rows
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, begin, nobody
from tests.web.labs import until

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


def test_study__at_the_consoles_rig__stores_what_one_at_its_own_rig_does_and_goes_on_after_its_end(
    console, studies, protocol, tmp_path
):
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
    with loaded(console) as page:
        studies.ask("begin", protocol=protocol, store="stopped.db")
        with console.websocket_connect("/ws/operator") as socket:
            session = operator(socket)["sessions"][0]["id"]
            socket.send_json({"type": "start", "session": session})
            while until(socket, "snapshot")["active"] != session:
                pass
            assert "error" not in page.ask("stop")
            while until(socket, "snapshot")["active"] is not None:
                pass


def test_export__of_a_store__is_what_the_command_writes(console, studies, protocol, tmp_path):
    with loaded(console):
        studies.ask("begin", protocol=protocol, store="exported.db", auto_start=True)
        assert "allowed" in studies.ask("export", store="exported.db", form="tidy")["error"]  # nothing is answered yet
        with at_subject(console) as socket:
            answered(socket, 1)
        made = studies.ask("export", store="exported.db", form="tidy")
    assert made["trials"] == 1
    with zipfile.ZipFile(console.state.uploads.path(made["key"])) as packed:
        ours = {name.removeprefix("tidy/"): packed.read(name) for name in packed.namelist() if not name.endswith("/")}
    out = tmp_path / "tidy"
    assert main(["experiment", "export", "--store", str(console.folder / "exported.db"), "--out", str(out)]) == 0
    theirs = {str(one.relative_to(out)): one.read_bytes() for one in out.rglob("*") if one.is_file()}
    assert ours == theirs


def test_study__that_cannot_begin__is_refused_in_words_and_leaves_rig_and_folder_as_they_were(
    console, studies, protocol, tmp_path
):
    def written(text):
        (tmp_path / "bad.toml").write_text(text)
        return {"protocol": dropped(console.state, tmp_path / "bad.toml")}

    strange = PROTOCOL.replace("seed = 7", 'seed = 7\nlanguage = "xx"\nlanguage_file = "own.toml"')
    with loaded(console) as page:
        for change, words in (
            ({"store": "../up.db"}, "store"),
            ({"store": "/etc/passwd"}, "store"),
            ({"store": None}, "allowed: a request of the console's page"),
            ({"protocol": "nothing"}, "drop it again"),
            ({"protocol": "example:../../display.toml"}, "drop it again"),
            ({"protocol": "example:display.toml"}, "drop it again"),
            ({"files": ["gone"]}, "drop it again"),
            ({"amend": "x" * 500}, "amend"),
            (written("[study]\nname = 3"), "allowed"),
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
