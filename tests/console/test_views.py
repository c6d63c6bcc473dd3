"""The views: what they show and write is what the shown command does; refusals at their line; the state."""

import json
import shlex
import shutil
import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from tactuator.cli.main import main
from tactuator.console import display_view, identify_view, prefilter_view, speech_view
from tactuator.console.display_view import with_literal
from tactuator.console.loop_chart import channel_figures
from tactuator.console.loop_shape import LoopShape
from tactuator.console.page_server import build_console
from tactuator.console.state import FILE, ConsoleState
from tactuator.errors import BadInput
from tactuator.io.controller import controller_text, read_controller
from tactuator.io.shipped import EXAMPLES
from tactuator.model.verdict import finding_row
from tactuator.report.printed import design_rows
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.synthesis.objectives import whole_verdict
from tests.console.pages import ONE, TOKEN, dropped
from tests.web.server import served

FIT = {"display": FILE, "channel": "index"}


@pytest.fixture(scope="module")
def state(tmp_path_factory):
    path = tmp_path_factory.mktemp("prefilter") / "display.toml"
    path.write_text(ONE)
    return ConsoleState(path)


@pytest.fixture(scope="module")
def plain(state):
    return prefilter_view.fit(state, **FIT)


def moved(found, by_db):
    return [[hz, level + (by_db if hz == 20.0 else 0.0)] for hz, level in found["curve"]["points"]]


def test_fit__of_the_displays_own_curve__has_the_designs_error(state, plain):
    own = state.file_design(FILE, "index").report["prefilter"]
    assert plain["greatest_db"] == f"{own['max_error_db']:.2f}"
    assert max(np.abs(plain["error_db"])) == pytest.approx(own["max_error_db"], abs=0.05)


def test_fit__of_a_moved_point__follows_it_and_more_poles_follow_better(state, plain):
    assert 20.0 in [hz for hz, _ in plain["curve"]["points"]]
    points = moved(plain, -3.0)
    few, many = (prefilter_view.fit(state, **FIT, points=points, poles=poles) for poles in (4, 8))
    at = int(np.argmin(np.abs(np.array(few["frequency_hz"]) - 20.0)))
    assert few["wanted_db"][at] == pytest.approx(plain["wanted_db"][at] - 3.0, abs=0.3)
    assert many["poles"] == 8
    assert float(many["greatest_db"]) < float(few["greatest_db"])


def test_save__with_a_drawn_curve__is_what_the_shown_command_writes(state, plain, tmp_path, monkeypatch, run):
    found = prefilter_view.save(state, FILE, points=moved(plain, 1.5), poles=5)
    (tmp_path / "curve.csv").write_text(found["curve"])
    monkeypatch.chdir(tmp_path)
    assert "--curve curve.csv --poles 5 --out personal.json" in found["command"]
    run(*shlex.split(found["command"])[1:])
    assert (tmp_path / "personal.json").read_text() == found["text"]
    made = read_controller(tmp_path / "personal.json")
    channel, own = made.display.channels[0], made.channels[0]
    plant = discretise(channel.plant, made.rate_hz, "zoh", made.display.delay_samples)
    loop = TwoDegreeLoop(own.prefilter(made.rate_hz), own.feedback(made.rate_hz), plant)
    given_um = 1e3 * np.abs(loop.position_response([20.0])) / channel.sensor_gain_v_per_mm
    wanted_db = dict(plain["curve"]["points"])[20.0] + 1.5
    assert 20.0 * np.log10(given_um)[0] == pytest.approx(wanted_db, abs=1.0)


def test_fit__of_a_curve_that_is_none__is_refused_in_words(state):
    for points, words in (
        ([[1.0, 0.0], [0.5, 0.0], [300.0, 0.0]], "out of order"),
        ([[0.4, 0.0], [0.4, 1.0], [300.0, 0.0]], "occurs twice"),
        ([[10.0, 0.0], [20.0, 0.0], [30.0, 0.0]], "covers"),
    ):
        with pytest.raises(BadInput, match=words):
            prefilter_view.fit(state, **FIT, points=points)


@pytest.fixture(scope="module")
def rendered(state):
    folder = state.path(FILE).parent
    shutil.copy(EXAMPLES / "speech.wav", folder / "speech.wav")
    key = dropped(state, folder / "speech.wav")
    found = speech_view.rendered(state, display=FILE, file=key, level=30.0)
    return folder, found


def test_render__of_a_speech_file__makes_the_files_of_the_shown_command(rendered, state, monkeypatch, run):
    folder, found = rendered
    monkeypatch.chdir(folder)
    felt = run.json(*shlex.split(found["command"])[1:])["felt"]["index"]
    made = state.uploads.path(found["key"]).parent
    for name in found["files"]:
        assert (folder / name).read_bytes() == (made / name).read_bytes(), name
    assert found["rows"][0][3:] == [f"{felt[name]:.2f}" for name in ("rms_db", "median_db_all", "p95_db_all")]


def test_render__figures__are_lists_of_numbers_or_refused(rendered, state):
    _, answer = rendered
    finger = answer["fingers"][0]
    assert len(finger["hz"]) == sum(len(part["hz"]) for part in finger["parts"])
    assert all(len(row) == len(part["hz"]) for part in finger["parts"] for row in part["felt"])
    json.dumps(answer, allow_nan=False)
    speech, display = (dropped(state, EXAMPLES / name) for name in ("speech.wav", "display.toml"))
    for file, coding, words in (
        (display, "direct", "; "),
        (speech, "nothing", "no coding"),
        (speech, "../../secret.toml", "no coding"),
    ):
        with pytest.raises(BadInput, match=words):
            speech_view.rendered(state, display=FILE, file=file, coding=coding)
    with served(build_console(state, TOKEN)) as client:
        for key in (answer["key"], "0123"):
            assert client.get(f"/made/{key}/reference.wav").status == 403


NUM, DEN = [2875.0], [1.0, 94.0, 290.0]


@pytest.fixture(scope="module")
def record(tmp_path_factory):
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
    look = identify_view.look(state, record=key)
    return look, identify_view.model(state, key, order=2, hold="zero-order", validate_on=(other,))


def test_record__of_a_simulated_motor__gives_its_truth_as_its_command_does(found, record, tmp_path, monkeypatch, run):
    look, model = found
    assert (look["input"], look["output"]) == ("drive", "encoder")
    assert look["columns"] == ["time_s", "drive", "encoder"]
    assert look["rate_hz"] == pytest.approx(1000.0)
    response = model["response"]
    true = 20.0 * np.log10(np.abs(signal.freqs(NUM, DEN, 2.0 * np.pi * np.array(response["frequency_hz"]))[1]))
    off = np.abs(np.array(response["magnitude_db"]) - true)
    assert np.mean(off <= np.array(response["band_db"]) + 1e-3) > 0.9
    assert [one["poles"] for one in model["tried"] if one["taken"]] in ([], [2])
    for name in ("bench.csv", "unseen.csv"):
        shutil.copy(record, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert model["command"] == (
        "tactuator identify bench.csv --order 2 --hold zero-order --validate unseen.csv --out model.json"
    )
    printed = run(*shlex.split(model["command"])[1:], "--full").out
    assert (tmp_path / "model.json").read_text() == model["text"]
    assert {row[0]: row[1] for row in model["rows"]}["poles (Hz)"] in printed
    assert "on unseen.csv" in printed


def test_record__with_names_of_its_own__is_said_until_each_is_named(record, tmp_path):
    (foreign := tmp_path / "fremd.csv").write_text(record.read_text().replace("time_s", "Zeit", 1))
    key = dropped(state := ConsoleState(), foreign)
    said = identify_view.look(state, record=key)["said"]
    assert said.startswith("record fremd.csv: which column is which")
    assert "--" not in said  # the page has fields
    look = identify_view.look(state, record=key, input="drive", output="encoder", time="Zeit")
    assert (look["said"], look["rate_hz"]) == (None, pytest.approx(1000.0))


def response_file(path):
    hz = np.geomspace(2.0, 400.0, 60)
    _, truth = signal.freqs([4.0e4], [1.0, 60.0, 2.0e4], 2.0 * np.pi * hz)
    rows = zip(hz, 20.0 * np.log10(np.abs(truth)), np.degrees(np.unwrap(np.angle(truth))), strict=True)
    path.write_text("frequency_hz,magnitude_db,phase_deg\n" + "".join(f"{a},{b},{c}\n" for a, b, c in rows))
    return hz, truth


def test_response__dropped__gives_the_model_that_the_command_writes(tmp_path, monkeypatch, run):
    path = tmp_path / "response.csv"
    hz, truth = response_file(path)
    state = ConsoleState()
    key = dropped(state, path)
    assert identify_view.look(state, record=key)["points"] == 60
    found = identify_view.model(state, record=key, order=2, zeros=0)
    assert max(map(abs, found["departure"]["db"])) < 0.05
    near = np.interp(hz, found["response"]["frequency_hz"], found["response"]["magnitude_db"])
    assert near == pytest.approx(20.0 * np.log10(np.abs(truth)), abs=0.1)
    assert np.interp(hz, found["response"]["frequency_hz"], found["response"]["phase_deg"]) == pytest.approx(
        found["response"]["own"]["phase_deg"], abs=2.0
    )
    monkeypatch.chdir(tmp_path)
    assert found["command"] == "tactuator identify response.csv --order 2 --zeros 0 --out model.json"
    printed = run(*shlex.split(found["command"])[1:], "--full").out
    assert (tmp_path / "model.json").read_text() == found["text"]
    assert all(value in printed for _, value, _ in found["rows"])
    with pytest.raises(BadInput, match="one response by itself"):
        identify_view.model(state, record=key, validate_on=(key,))
    with pytest.raises(BadInput, match="drop it again"):
        identify_view.model(state, record="no such key")


EXAMPLE = (EXAMPLES / "display.toml").read_text("utf-8")


def judged(text, state=None):
    return display_view.judge(state or ConsoleState(), text, "example:display.toml")


def test_judge__of_a_faulty_or_doubtful_text__names_the_line_or_channel():
    for old, new in (
        ("bits = 16", "bits = 99"),
        ("bits = 16", 'bits = "many"'),
        ("phase_margin_deg = 50.0", "phase_margin_deg = -50.0"),
        ("sensor_gain_v_per_mm = 0.1967", "sensor_gain_v_per_mm = true"),
        ('curve = "bolanowski-1988"', 'curve = "nobody-2099"'),
        ("poles = 4", "polse = 4"),
        ("poles = 4", "poles = = 4"),
        ("[prefilter]", "[perfilter]"),
    ):
        text = EXAMPLE.replace(old, new, 1)
        judgement = judged(text)
        assert judgement["fault"]
        assert judgement["line"] == [n for n, line in enumerate(text.splitlines(), 1) if new in line][-1], new
    found = judged(EXAMPLE.replace("travel_mm = 12.5", "travel_mm = 0.0125"))
    assert found["fault"] is None
    assert {one.partition(":")[0] for one in found["doubts"]} == {"index", "thumb", "middle"}
    assert any("travel_mm in metres" in one for one in found["doubts"])


def test_set__of_a_value_or_none__changes_that_line_alone_or_is_refused():
    text = display_view.set_value(ConsoleState(), EXAMPLE, "channel", 1, "travel_mm", "9.5")["text"]
    changed = [(a, b) for a, b in zip(EXAMPLE.splitlines(), text.splitlines(), strict=True) if a != b]
    assert changed == [("travel_mm = 12.5", "travel_mm = 9.5")]
    assert tomllib.loads(text)["channel"][1]["travel_mm"] == 9.5
    text = with_literal(EXAMPLE, "converter", 0, "range_v", "5.0")
    assert "range_v = 5.0               # +/- 10 V" in text
    for value in ("", "= 3", "[1,", '"', "1 2", "3\n[x]"):
        with pytest.raises(BadInput, match="; "):
            with_literal(EXAMPLE, "prefilter", 0, "poles", value)
    text = with_literal(EXAMPLE, "objectives", 0, "flatness_db", "0.5")
    assert tomllib.loads(text)["objectives"] == {"flatness_db": 0.5}


@given(number=st.floats(allow_nan=False, allow_infinity=False), which=st.integers(0, 2))
@settings(max_examples=40)
def test_set__of_any_number__is_read_back_and_nothing_else_changes(number, which):
    text = with_literal(EXAMPLE, "channel", which, "model_error_db", repr(number))
    tables = tomllib.loads(text)
    assert tables["channel"][which].pop("model_error_db") == number
    assert tables == tomllib.loads(EXAMPLE)


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("console")
    path = folder / "display.toml"
    path.write_text(ONE)
    assert main(["design", str(path), "--out", str(folder / "controller.json"), "--json"]) == 0
    state = ConsoleState(path)
    return folder / "controller.json", state, state.designed(FILE, "index")


def test_design__saved_and_shown__is_that_of_design_and_check(designed):
    path, state, shape = designed
    assert controller_text(state.controller(FILE, {"index": shape})) == path.read_text()
    controller = read_controller(path)
    figures = channel_figures(state.plants(FILE, "index"), state.channel_of(FILE, "index", shape))
    assert figures["design"] == [list(row) for row in design_rows(controller.channels)]
    objectives = whole_verdict(controller).objectives
    rows = [[*finding_row(one), one.remark] for objective in objectives for one in objective.worst()]
    assert figures["verdict"]["rows"] == rows


def test_saved__after_a_drag__is_judged_by_check_as_on_the_page(designed, tmp_path, run):
    _, state, shape = designed
    moved = LoopShape(shape.gain_db - 1.5, shape.factors)
    saved = tmp_path / "controller.json"
    saved.write_text(controller_text(state.controller(FILE, {"index": moved})))
    printed = json.loads(run("check", saved, "--json").out)
    shown = channel_figures(state.plants(FILE, "index"), state.channel_of(FILE, "index", moved))
    outcomes = {row[0]: row[2] for row in shown["verdict"]["rows"]}
    assert printed["objectives"]["iv"]["outcome"] == outcomes["iv"]
    assert printed["outcome"] in shown["verdict"]["sentence"]


def test_display__of_every_example__has_a_stable_loop(designed):
    state = ConsoleState()
    assert state.named is None
    keys = [one["key"] for one in state.examples()]
    assert "example:display.toml" in keys
    for key in keys:
        for channel in state.display(key).channels:
            if channel.feedback.structure != "none":
                state.first_shape(key, channel.name).system(state.display(key).rate_hz)
    for key in ("file", "example:../../secret.toml", "example:README.md", "/etc/passwd", ""):
        with pytest.raises(BadInput, match="; "):
            ConsoleState().display(key)
    with pytest.raises(BadInput, match="not on the server any more"):
        ConsoleState().display("text:0123")
    with pytest.raises(BadInput, match="'index' has no loop yet"):
        designed[1].controller(FILE, {})
