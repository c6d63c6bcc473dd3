"""The verb `experiment`: one JSON object, or one line and status 2."""

import io
import json

import pytest

from tactuator.cli.main import main
from tactuator.experiment.protocol.file import parse_recognition
from tactuator.experiment.protocol.recognition import block_trials
from tactuator.experiment.store.store import Store, sessions_of
from tactuator.io.controller import write_controller
from tests.experiment.session.apparatuses import PROTOCOL
from tests.experiment.session.recognising import controller, items, protocol_text  # noqa: F401

SHORT = PROTOCOL.replace("reversals = 6", "reversals = 4").replace("averaged = 4", "averaged = 2")


@pytest.mark.parametrize(
    ("arguments", "keys"),
    [
        (["--procedure", "imece2004", "--runs", "50", "--lapse", "0.01", "--start-db", "16"], {"sd_db", "trials_p05"}),
        (["--procedure", "quest-plus", "--runs", "20", "--trials", "20", "--slope", "1.5:3.5"], {"sd_db", "refit"}),
        (["--procedure", "curve", "--runs", "2", "--trials", "20"], {"rms_error_db", "coverage95"}),
    ],
)
def test_simulate__json__is_one_object_and_the_same_again(capsys, arguments, keys) -> None:
    told = []
    for _ in range(2):
        assert main(["experiment", "simulate", *arguments, "--seed", "3", "--json"]) == 0
        told.append(capsys.readouterr().out)
    assert told[0] == told[1]
    assert keys | {"simulated"} <= set(json.loads(told[0]))


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate", "--procedure", "levitt"],
        ["simulate", "--runs", "0"],
        ["simulate", "--slope", "steep"],
        ["simulate", "--slope", "nan"],
        ["simulate", "--lapse", "0.5"],
        ["simulate", "--procedure", "imece2004", "--trials", "40"],
        ["simulate", "--procedure", "curve", "--trials", "0"],
        ["thresholds", "--store", "missing.db"],
        ["export", "--store", "missing.db", "--out", "out"],
        ["observe", "missing.toml", "--store", "lab.db"],
        ["observe", "protocol.toml", "--store", "nowhere/lab.db"],
        ["observe", "words.toml", "--store", "lab.db"],
        ["recognise", "protocol.toml", "--store", "lab.db"],
        ["recognise", "words.toml", "--store", "lab.db"],
        ["recognise", "words.toml", "--store", "lab.db", "--rig", "piano"],
        ["recognise", "words.toml", "--store", "lab.db", "--scripted-error", "2"],
        ["serve", "words.toml", "--store", "lab.db"],
        ["serve", "missing.toml", "--store", "lab.db"],
        ["serve", "protocol.toml", "--store", "lab.db", "--speed", "-1"],
        ["serve", "protocol.toml", "--store", "lab.db", "--rig", "emulated:abacus"],
        ["serve", "protocol.toml", "--store", "lab.db", "--rig", "piano"],
        ["serve", "protocol.toml", "--store", "lab.db", "--port", "99999"],
        ["serve", "protocol.toml", "--store", "lab.db", "--host", "256.1.1.1"],
    ],
)
def test_experiment__bad_input__is_one_line_and_nothing_is_left(capsys, tmp_path, monkeypatch, arguments) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "protocol.toml").write_text(SHORT)
    (tmp_path / "words.toml").write_text(protocol_text())
    assert main(["experiment", *arguments]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.strip().splitlines()) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"protocol.toml", "words.toml"}


def test_observe_thresholds_export__in_turn__give_files_and_objects(capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "protocol.toml").write_text(SHORT)
    assert main(["experiment", "observe", "protocol.toml", "--store", "lab.db", "--seed", "4", "--json"]) == 0
    truth = json.loads(capsys.readouterr().out)["truth"]
    assert [row["simulated"] for row in truth] == ["simulated"] * 6
    assert main(["experiment", "observe", "protocol.toml", "--store", "lab.db", "--seed", "4"]) == 0
    assert "nothing left to do, all have gone through the study: lab.db" in capsys.readouterr().out
    assert main(["experiment", "judged", "lab.db"]) == 2
    assert "the store holds short; allowed: a study in which tones are judged" in capsys.readouterr().err
    made = ["--curve-out", "curve.csv", "--figures", "figures"]
    assert main(["experiment", "thresholds", "--store", "lab.db", *made, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["thresholds"]) == 6
    assert len(found["curve"]) == 5
    assert "bound" in (tmp_path / "curve.csv").read_text().splitlines()[3]
    assert (tmp_path / "curve.csv").exists()
    assert (tmp_path / "figures" / "fig11.svg").exists()
    assert main(["experiment", "export", "--store", "lab.db", "--format", "bids", "--out", "bids", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["trials"] > 50
    assert main(["experiment", "thresholds", "--store", "lab.db", "--group", "unknown"]) == 2


def test_thresholds__curve_of_two_frequencies__table_then_the_refusal(capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "protocol.toml").write_text(SHORT.replace("[30, 90, 210]", "[30, 90]"))
    assert main(["experiment", "observe", "protocol.toml", "--store", "lab.db", "--seed", "4", "--json"]) == 0
    assert "no curve: frequencies_hz has 2; allowed: 3 or more" in capsys.readouterr().err
    made = ["--curve-out", "curve.csv"]
    assert main(["experiment", "thresholds", "--store", "lab.db", *made]) == 2
    out, err = capsys.readouterr()
    assert "S1" in out
    assert "written" not in out
    assert err == "tactuator: a curve of 2 measured frequencies; allowed: three or more\n"
    assert not (tmp_path / "curve.csv").exists()
    assert main(["experiment", "thresholds", "--store", "lab.db", "--figures", "figures"]) == 0
    assert (tmp_path / "figures" / "fig11.svg").exists()


@pytest.mark.parametrize("port", ["/dev/there-is-none", "socket://127.0.0.1:9"])
def test_serve__port_that_cannot_be_opened__status_3(port, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "protocol.toml").write_text(SHORT)
    assert main(["experiment", "serve", "protocol.toml", "--store", "lab.db", "--rig", f"board:{port}"]) == 3
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.strip().splitlines()) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"protocol.toml"}


@pytest.fixture
def words(tmp_path, controller, items, monkeypatch):
    """A folder with items, a recognition protocol and a controller; work goes on in it."""
    for path in items.iterdir():
        (tmp_path / path.name).symlink_to(path)
    write_controller(tmp_path / "controller.json", controller)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(monkeypatch, *lines: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


RECOGNISE = ["experiment", "recognise", "words.toml", "--store", "lab.db", "--controller", "controller.json", "--json"]


def test_recognise__at_the_terminal__asks_consent_introduces_tells_and_breaks(words, capsys, monkeypatch) -> None:
    text = protocol_text(training=1, test=1, consent="You may stop.")
    (words / "words.toml").write_text(text)
    right = [trial.correct for trial in block_trials(parse_recognition(text), 0, 0)]
    keys = {item.label: item.key for item in parse_recognition(text).item}
    wrong = next(key for label, key in keys.items() if label != right[1])
    typed(monkeypatch, "y", keys[right[0]], "9", wrong, keys[right[2]], "", "1", "1", "1")
    assert main(RECOGNISE) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == {"subject": "S1", "trials": 6, "store": "lab.db", "simulated": True}
    order = [
        "You may stop.",
        "Block 1 of 2: training, 3 trials.",
        "right",
        "'9' is no key of these",
        f"it was {right[1]}",
        "Time for a break",
        "Block 2 of 2: test, 3 trials.",
    ]
    assert [place for place in map(said.err.find, order) if place >= 0] == sorted(map(said.err.find, order))


def test_recognise__no_consent__stores_no_answer(words, capsys, monkeypatch) -> None:
    (words / "words.toml").write_text(protocol_text(consent="You may stop."))
    typed(monkeypatch, "n")
    assert main(RECOGNISE) == 0
    assert json.loads(capsys.readouterr().out)["trials"] == 0


@pytest.mark.parametrize("rig", ["simulated", "in-process"])
def test_recognise__abx_by_script__on_any_rig_with_a_name(words, capsys, rig) -> None:
    (words / "words.toml").write_text(protocol_text("abx", training=0, test=1))
    assert main([*RECOGNISE, "--rig", rig, "--scripted-error", "0"]) == 0
    answered = json.loads(capsys.readouterr().out)
    assert (answered["trials"], answered["simulated"]) == (12, True)
    assert main(["experiment", "information", "--store", "lab.db", "--json"]) == 0
    (abx,) = json.loads(capsys.readouterr().out)["abx"]
    assert (abx["share_correct"], abx["simulated"]) == (1.0, True)
    assert main(["experiment", "information", "--store", "lab.db"]) == 0
    assert "simulated: nobody felt this" in " ".join(capsys.readouterr().out.split())


def test_serve__sessions_are_run_already__is_refused_in_one_line(tmp_path, capsys) -> None:
    (tmp_path / "protocol.toml").write_text(PROTOCOL)
    with sessions_of(tmp_path / "lab.db"):
        arguments = ["experiment", "serve", str(tmp_path / "protocol.toml"), "--store", str(tmp_path / "lab.db")]
        assert main([*arguments, "--port", "0"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "its sessions are run by process" in told
    assert not (tmp_path / "lab.db").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["observe", "mains.toml"], "60 Hz is 0 Hz from the mains line"),
        (["serve", "mains.toml", "--port", "0"], "60 Hz is 0 Hz from the mains line"),
        (["recognise", "words.toml", "--subject", "S9", "--scripted-error", "0"], "subject 'S9' is not in the study"),
    ],
)
def test_experiment__study_that_cannot_be__leaves_no_store_but_one_that_was_there(
    words, capsys, arguments, told
) -> None:
    (words / "mains.toml").write_text(SHORT.replace("[30, 90, 210]", "[30, 60, 210]"))
    (words / "words.toml").write_text(protocol_text())
    before = {path.name for path in words.iterdir()}
    command = ["experiment", *arguments, "--controller", "controller.json", "--store", "lab.db"]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert {path.name for path in words.iterdir()} == before
    Store(words / "lab.db").close()
    assert main(command) == 2
    assert {path.name for path in words.iterdir()} == before | {"lab.db"}
