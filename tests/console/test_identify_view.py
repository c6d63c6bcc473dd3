"""The view Identify: what it answers is what `identify` prints and writes for the command that it shows."""

import shlex
import shutil
import sys

import numpy as np
import pytest
from scipy import signal

from tactuator.cli.main import main
from tactuator.console.identify_view import IdentifyLook, IdentifyModel
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput
from tactuator.io.columns import read_columns
from tactuator.io.record import write_record
from tactuator.signals.record import JointRecord
from tests.console.pages import dropped

NUM, DEN = [2875.0], [1.0, 94.0, 290.0]


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """A record of the paper's motor, by SciPy's simulation: columns with names of their own."""
    path = tmp_path_factory.mktemp("record") / "bench.csv"
    random = np.random.default_rng(5)
    time = np.arange(8000) / 1000.0
    command = 0.4 * np.repeat(random.standard_normal(2000), 4)
    _, position, _ = signal.lsim((NUM, DEN), command, time, interp=False)
    columns = np.column_stack([time, command, position + 1e-3 * random.standard_normal(time.size)])
    np.savetxt(path, columns, delimiter=",", header="time_s,drive,encoder", comments="", fmt="%.9g")
    return path


@pytest.fixture
def found(record):
    state = ConsoleState()
    key, other = dropped(state, record), dropped(state, record, "unseen.csv")
    look = IdentifyLook(record=key).answer(state)
    request = IdentifyModel(record=key, order=2, hold="zero-order", validate_on=(other,))
    return look, request.answer(state)


def test_record_of_a_simulated_motor__is_looked_at_holds_its_truth_and_its_command_writes_the_same_bytes(
    found, record, tmp_path, monkeypatch, capsys
):
    look, model = found
    assert (look["input"], look["output"]) == ("drive", "encoder")
    assert look["columns"] == ["time_s", "drive", "encoder"]
    assert look["rate_hz"] == pytest.approx(1000.0)
    response = model["response"]
    true = 20.0 * np.log10(np.abs(signal.freqs(NUM, DEN, 2.0 * np.pi * np.array(response["frequency_hz"]))[1]))
    off = np.abs(np.array(response["magnitude_db"]) - true)
    assert np.mean(off <= np.array(response["band_db"]) + 1e-3) > 0.9
    assert [one["poles"] for one in model["tried"] if one["taken"]] in ([], [2])
    shutil.copy(record, tmp_path / "bench.csv")
    shutil.copy(record, tmp_path / "unseen.csv")
    monkeypatch.chdir(tmp_path)
    assert model["command"] == (
        "tactuator identify bench.csv --order 2 --hold zero-order --validate unseen.csv --out model.json"
    )
    main(shlex.split(model["command"])[1:])
    assert (tmp_path / "model.json").read_text() == model["text"]
    printed = capsys.readouterr().out
    assert {row[0]: row[1] for row in model["rows"]}["poles (Hz)"] in printed
    assert "on unseen.csv" in printed


def test_record__whose_columns_have_names_of_their_own__is_read_once_each_is_said(record, tmp_path):
    (foreign := tmp_path / "fremd.csv").write_text(record.read_text().replace("time_s", "Zeit", 1))
    key = dropped(state := ConsoleState(), foreign)
    said = IdentifyLook(record=key).answer(state)["said"]
    assert said.startswith("record fremd.csv: which column is which")
    assert "--" not in said  # the page has fields
    look = IdentifyLook(record=key, input="drive", output="encoder", time="Zeit").answer(state)
    assert (look["said"], look["rate_hz"]) == (None, pytest.approx(1000.0))


def response_file(path):
    """Write a response of two poles, by SciPy; return its frequencies and values."""
    hz = np.geomspace(2.0, 400.0, 60)
    _, truth = signal.freqs([4.0e4], [1.0, 60.0, 2.0e4], 2.0 * np.pi * hz)
    rows = zip(hz, 20.0 * np.log10(np.abs(truth)), np.degrees(np.unwrap(np.angle(truth))), strict=True)
    path.write_text("frequency_hz,magnitude_db,phase_deg\n" + "".join(f"{a},{b},{c}\n" for a, b, c in rows))
    return hz, truth


@pytest.mark.parametrize("kind", ["record", "response"])
def test_file__looked_at_and_identified__is_read_once_each_time(kind, record, tmp_path, monkeypatch):
    path, read = tmp_path / "dropped.csv", []
    shutil.copy(record, path) if kind == "record" else response_file(path)
    key = dropped(state := ConsoleState(), path)
    for name, module in list(sys.modules.items()):
        if name.startswith("tactuator.") and getattr(module, "read_columns", None) is read_columns:
            monkeypatch.setattr(module, "read_columns", lambda place: read.append(place) or read_columns(place))
    IdentifyLook(record=key).answer(state)
    assert len(read) == 1
    IdentifyModel(record=key, order=2, zeros=0).answer(state)
    assert len(read) == 2


def test_record__of_several_channels__is_said_until_one_is_named(tmp_path):
    several = JointRecord(1e3, ("thumb", "index"), *np.random.default_rng(1).standard_normal((2, 4000, 2)))
    write_record(tmp_path / "both.h5", several)
    key = dropped(state := ConsoleState(), tmp_path / "both.h5")
    assert "several channels; allowed: command and position of one" in IdentifyLook(record=key).answer(state)["said"]
    look = IdentifyLook(record=key, input="command.2", output="position.2").answer(state)
    assert (look["said"], look["rate_hz"]) == (None, 1e3)


def test_response__dropped__gives_the_model_that_the_command_writes_and_its_departure(tmp_path, monkeypatch, capsys):
    path = tmp_path / "response.csv"
    hz, truth = response_file(path)
    state = ConsoleState()
    key = dropped(state, path)
    assert IdentifyLook(record=key).answer(state)["points"] == 60
    found = IdentifyModel(record=key, order=2, zeros=0).answer(state)
    assert max(map(abs, found["departure"]["db"])) < 0.05
    near = np.interp(hz, found["response"]["frequency_hz"], found["response"]["magnitude_db"])
    assert near == pytest.approx(20.0 * np.log10(np.abs(truth)), abs=0.1)
    assert np.interp(hz, found["response"]["frequency_hz"], found["response"]["phase_deg"]) == pytest.approx(
        found["response"]["own"]["phase_deg"], abs=2.0
    )
    monkeypatch.chdir(tmp_path)
    assert found["command"] == "tactuator identify response.csv --order 2 --zeros 0 --out model.json"
    main(shlex.split(found["command"])[1:])
    assert (tmp_path / "model.json").read_text() == found["text"]
    printed = capsys.readouterr().out
    assert all(value in printed for _, value, _ in found["rows"])
    with pytest.raises(BadInput, match="one response by itself"):
        IdentifyModel(record=key, validate_on=(key,)).answer(state)
    with pytest.raises(BadInput, match="drop it again"):
        IdentifyModel(record="no such key").answer(state)
