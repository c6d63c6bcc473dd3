"""The verb `experiment`: one JSON object, or one line and status 2."""

import json

import pytest

from tactuator.cli.main import main
from tests.experiment.identifying import protocol_text
from tests.experiment.stations import PROTOCOL

SHORT = PROTOCOL.replace("reversals = 6", "reversals = 4").replace("averaged = 4", "averaged = 2")


@pytest.mark.parametrize(
    ("arguments", "keys"),
    [
        (["--procedure", "imece2004", "--runs", "200", "--lapse", "0.01", "--start-db", "16"], {"sd_db", "trials_p05"}),
        (["--procedure", "quest-plus", "--runs", "50", "--trials", "20", "--slope", "1.5:3.5"], {"sd_db", "refit"}),
        (["--procedure", "curve", "--runs", "4", "--trials", "20"], {"rms_error_db", "coverage95"}),
    ],
)
def test_simulate__json__is_one_object_and_the_same_again(capsys, arguments, keys) -> None:
    told = []
    for _ in range(2):
        assert main(["experiment", "simulate", *arguments, "--seed", "3", "--json"]) == 0
        told.append(capsys.readouterr().out)
    assert told[0] == told[1]
    assert keys <= set(json.loads(told[0]))


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
        ["identify", "protocol.toml", "--store", "lab.db"],
        ["identify", "words.toml", "--store", "lab.db"],
        ["identify", "words.toml", "--store", "lab.db", "--rig", "piano"],
        ["identify", "words.toml", "--store", "lab.db", "--scripted-error", "2"],
        ["serve", "words.toml", "--store", "lab.db"],
        ["serve", "missing.toml", "--store", "lab.db"],
        ["serve", "protocol.toml", "--store", "lab.db", "--speed", "-1"],
        ["serve", "protocol.toml", "--store", "lab.db", "--rig", "emulated:abacus"],
        ["serve", "protocol.toml", "--store", "lab.db", "--rig", "board:/dev/there-is-none"],
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
    assert len(json.loads(capsys.readouterr().out)["truth"]) == 6
    made = ["--curve-out", "curve.csv", "--figure-out", "figures"]
    assert main(["experiment", "thresholds", "--store", "lab.db", *made, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["thresholds"]) == 6
    assert len(found["curve"]) == 5
    assert (tmp_path / "curve.csv").exists()
    assert (tmp_path / "figures" / "fig11.svg").exists()
    assert main(["experiment", "export", "--store", "lab.db", "--format", "bids", "--out", "bids", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["trials"] > 50
    assert main(["experiment", "thresholds", "--store", "lab.db", "--group", "unknown"]) == 2
