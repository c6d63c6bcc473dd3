"""A refusal of every verb: status 2, one line, nothing left, each rule's sentence where the rule is; `init` as a
newcomer uses it; `play` at a terminal; record, identify, measure, noise, disturb and calibrate, as a user types them.
"""

import csv
import json
import os
import pty
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactuator.cli import main
from tactuator.experiment.protocol.file import StudyProtocol, read_protocol
from tactuator.experiment.session.studies import fresh_token, open_study, task_of
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.store.store import Store, sessions_of
from tactuator.io.controller import write_controller
from tactuator.io.display import read_display
from tactuator.io.reference import ReferenceHead, write_reference
from tactuator.io.shipped import DISPLAY_KINDS, PROTOCOL_KINDS, display_template, example_names
from tactuator.rig.simulated import SimulatedRig
from tests.measure.loops import controller, display
from tests.one_finger import DISPLAY
from tests.rig.guard.guarded import designed

# One of each kind, as the command line spells it: the rules themselves are tested where they are made.
REFUSALS = {
    "design none.toml": "display none.toml: file not found",
    "design wild.toml": "unstable",
    "design lines.toml --out record.h5": "--out record.h5 is a file that the command reads; expected another name",
    "design display.toml --poles 40": "--poles is 40; it must be a whole number, 2 to 16",
    "design display.toml --curve record.h5 --out record.h5": "record.h5: this is a record: ",
    "design controller.json --out controller.json": "controller.json: this is a controller: `tactuator check`",
    "firmware wordlength controller.json --rate fast": "Invalid value for '--rate': it must be a number",
    "firmware wordlength controller.json --rate -5": "--rate is -5; it must be a number, above 0",
    "build controller.json": "Missing option '--out'",
    "build controller.json --out none/i.bin": "none is not a folder",
    "firmware image .": "image .: Is a directory",
    "record display.toml --out r.h5 --excitation song": "excitation 'song'; expected mix, delimited, steps, noise",
    "record display.toml --out r.h5 --duration-s 1e9": "duration 1e+09 s; expected at most a day",
    "identify record.h5 --rate-hz 100": "--rate-hz says 100 Hz, rate_hz says 1000 Hz",
    "measure response --controller controller.json --level 90": "--level is 90 dB SL; it must be -60 to 55 dB SL",
    "measure response --controller controller.json --frequency-hz 301": "301 Hz; expected 0.4 to 300 Hz, the band",
    "measure response --controller controller.json --frequency-hz=-10": "-10 Hz; expected 0.4 to 300 Hz, the band",
    "init --examples . --like lra": "--examples alone",
    "init --like lra": "display.toml already exists",
    "render speech.wav --out n.wav --controller controller.json --figures figures": "--figures without --felt",
    "listen --input speech.wav --controller controller.json --rate 8000": "--rate with speech.wav",
    "listen --input speech.wav --controller controller.json --gain 200": "--gain is 200",
    "listen --input speech.wav --controller controller.json --fast --rig board:x": "--fast at board:x",
    "listen --input none.wav --controller controller.json": "none.wav: file not found",
    "render speech.wav --out n.wav": "neither --display nor --controller",
    "render . --out . --controller controller.json": ". holds .; ",
    "render speech.wav --out n.wav --controller controller.json --workers 2": "--workers with speech.wav (speech)",
    "sound latency --device Card --input 0": "input 0; expected the input to which the wire leads",
    "experiment simulate --effect-db 1": "one of --effect-db and --spread-db; expected both",
    "experiment simulate --guess 3": "--guess is 3; it must be a number, 0 to 1",
    "record display.toml --out rec.csv": "record rec.csv: ending '.csv'; expected .h5, .hdf5",
    "design display.toml --figures bode.svg": "bode.svg is the name of a file; expected that of a folder",
    "experiment export --store lab.db --out ex.csv": "ex.csv is the name of a file; expected that of a folder",
    "experiment waveforms --out one.toml --controller controller.json": "one.toml is the name of a file; expected",
    "init --examples one.zip": "one.zip is the name of a file; expected that of a folder",
    "render . --out made.wav --controller controller.json": "made.wav is the name of a file; expected that of a folder",
    "experiment simulate --slope steep": "slope 'steep'; expected a number, or LOW:HIGH",
    "experiment information": "--store and --matrix; expected one of the two",
    "experiment serve words.toml --store lab.db": "reference M-index.wav: file not found",
    "experiment serve protocol.toml --store lab.db --port 99999": "port 99999; expected 0 to 65535",
    "experiment serve protocol.toml --store lab.db --host 256.1.1.1": "address 256.1.1.1, port 8765: ",
}


@pytest.mark.parametrize("command", REFUSALS)
def test_verb__amiss__one_line_status_2_and_nothing_left(desk, run, command) -> None:
    (desk / "lines.toml").write_text('[[channel]]\nplant = """\nrecord.h5"""\n')
    (desk / "wild.toml").write_text((desk / "display.toml").read_text().replace("[2875.0]", "[90000.0]"))
    run.refused(*command.split(), said=REFUSALS[command])


def test_study__store_in_use_or_port_that_cannot_be_opened__is_refused(desk, run) -> None:
    serve = ("experiment", "serve", "protocol.toml", "--store", "lab.db", "--port", "0")
    with sessions_of(desk / "lab.db"):
        run.refused(*serve, said="its sessions are run by process")
    run.refused(*serve[:3], "--store", "new.db", "--rig", "board:/dev/there-is-none", said="there-is-none", status=3)


def at_a_terminal(arguments, out, key):
    """Exit status and what was said; `key` is pressed once the progress shows that something has been played."""
    child, terminal = pty.fork()
    if child == 0:
        os.dup2(os.open(out, os.O_CREAT | os.O_WRONLY), 1)
        code = "import sys; from tactuator.cli import main; sys.exit(main(sys.argv[1:]))"
        os.execv(sys.executable, [sys.executable, "-c", code, *arguments])
    said, pressed = b"", False
    while True:
        try:
            said += os.read(terminal, 1 << 16)
        except OSError:  # nobody is left at the other end
            break
        if not pressed and arguments[0].encode() in said:
            time.sleep(0.5)
            os.write(terminal, key)
            pressed = True
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    return os.waitstatus_to_exitcode(status), said.decode(errors="replace")


def test_play__stopped_by_ctrl_c__ramps_down_and_says_how_far_it_came(tmp_path):
    made = designed()
    names = tuple(channel.name for channel in made.display.channels)
    write_controller(tmp_path / "c.json", made)
    with write_reference(tmp_path / "r.h5", ReferenceHead(made.rate_hz, names)) as writer:
        writer.write(np.full((80000, 3), 10.0))
    arguments = ["play", str(tmp_path / "r.h5"), "--controller", str(tmp_path / "c.json"), "--rig", "in-process"]
    status, said = at_a_terminal([*arguments, "--realtime", "--json"], tmp_path / "out.json", b"\x03")
    assert status == 130, said
    played = json.loads((tmp_path / "out.json").read_text())
    assert played["stopped"]
    assert played["played_s"] < 20.0
    assert "interrupted" in said.splitlines()[-1]


def test_listen__stopped_by_q__fades_and_says_how_far_it_came(tmp_path):
    write_controller(tmp_path / "c.json", designed())
    noise = 0.1 * np.random.default_rng(0).standard_normal(16000 * 60)
    soundfile.write(tmp_path / "long.wav", noise, 16000)
    arguments = ["listen", "--input", str(tmp_path / "long.wav"), "--controller", str(tmp_path / "c.json")]
    status, said = at_a_terminal([*arguments, "--rig", "simulated", "--json"], tmp_path / "out.json", b"q")
    assert status == 130, said
    listened = json.loads((tmp_path / "out.json").read_text())
    assert listened["stopped"]
    assert listened["seconds"] < 50.0
    assert set(listened["delays_s"]) == {"source", "buffer", "resampler", "block", "limiter", "rig"}


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_init__examples__copies_them_and_names_them(empty, run) -> None:
    assert run.json("init", "--examples", ".")["written"] == list(example_names())
    assert sorted(p.relative_to(empty).as_posix() for p in empty.rglob("*") if p.is_file()) == list(example_names())


MINE = DISPLAY.replace('finger = "index"', 'finger = "ring"') + "band_hz = [59, 250]\nhum_hz = [45]\nhum_v_peak = [0]\n"


KINDS = (*DISPLAY_KINDS, "mine")


@pytest.mark.parametrize(("kind", "protocol"), [(KINDS[n % len(KINDS)], each) for n, each in enumerate(PROTOCOL_KINDS)])
def test_init__display_and_protocol__are_named_and_a_study_opens_with_both(kind, protocol, empty, run) -> None:
    out = empty / "display.toml"
    if kind == "mine":
        out.write_text(MINE)
    like = () if out.exists() else ("--like", kind)
    written = run.json("init", *like, "--protocol", protocol, "--out", str(out))["written"]
    assert (str(out) in written, {str(out), *written}) == (bool(like), {*map(str, empty.iterdir())})
    read, text = read_protocol(empty / "protocol.toml", StudyProtocol)
    shown, store = read_display(out), Store(empty / "lab.db")
    at = Apparatus(SimulatedRig(shown, 0), replace(controller(display()), display=shown), "simulated")
    open_study(store, task_of(read, empty, at), text, SystemClock(), fresh_token)
    store.close()
    assert out.read_text() == (MINE if kind == "mine" else display_template(kind))


@pytest.mark.slow
@pytest.mark.parametrize("kind", DISPLAY_KINDS)
def test_init__every_kind__can_be_designed_and_meets_or_leaves_open_every_objective(kind: str, empty, run) -> None:
    for words in (f"init --like {kind}", "design display.toml --out controller.json", "check controller.json"):
        assert run(*words.split()).status == 0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A display, a record of it, and the paper's controller."""
    place = tmp_path_factory.mktemp("api")
    (place / "display.toml").write_text(DISPLAY)
    write_controller(place / "controller.json", controller(display()))
    words = ["record", str(place / "display.toml"), "--duration-s", "5", "--out", str(place / "r.h5"), "--json"]
    assert main(words) == 0
    return place


@pytest.fixture
def paper(folder: Path) -> tuple[str, str]:
    return "--controller", str(folder / "controller.json")


def test_identify__record_of_the_simulated_display__prints_what_the_design_promises(folder, run, tmp_path) -> None:
    out = tmp_path / "m.json"
    answer = run.json("identify", folder / "r.h5", "--out", out)
    np.testing.assert_allclose(answer["model"]["den"], [1.0, 94.0, 290.0], rtol=0.005)
    np.testing.assert_allclose(answer["model"]["num"], [2875.0], rtol=0.005)
    assert (answer["model"]["delay_s"], answer["order"]) == (0.0, 2)
    assert len(answer["frf"]["frequency_hz"]) == len(answer["frf"]["band_db"]) >= 500
    assert answer["excitation"]["sufficient"] is True
    assert set(answer["residuals"]) >= {"white", "uncorrelated_with_input"}
    assert json.loads(out.read_text())["format"] == "tactuator-model/1"
    ended = run("identify", folder / "r.h5", "--method", "rls", "--full", "--figures", tmp_path / "figures")
    assert ended.status == 0
    assert "denominator, s^0" in ended.out
    assert (tmp_path / "figures" / "identification.svg").exists()


def test_measure__table__ascends_in_frequency_and_breaks_no_word(paper, run, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    ended = run("measure", "response", *paper, "--frequency-hz", "5,30,251.2", "--level", "40", "--full")
    assert ended.status == 1
    assert {"channel", "error", "load", "rest", "phase", "delay", "dist."} <= set(ended.out.split())
    shown = [line.split() for line in ended.out.splitlines() if line.split()[:1] == ["index"] and "felt" not in line]
    assert [float(row[1]) for row in shown[:3]] == [5.0, 30.0, 251.2]
    assert abs(float(shown[2][3])) > 3.0  # the paper's own prefilter is far below the curve at 250 Hz


def test_measure__multisine_and_stepped__print_responses(paper, run, tmp_path) -> None:
    not_flat = 1  # the paper's own prefilter is 8 dB low at 300 Hz
    out = tmp_path / "resp.h5"
    flat = run.json("measure", "response", *paper, "--method", "multisine", "--out", out, status=not_flat)
    assert len(flat["responses"][0]["frequency_hz"]) == 33  # three of them where a sweep found too much between
    assert out.exists()
    asked = ("--frequency-hz", "5,120", "--load", "finger", "--level", "40", "--figures", tmp_path / "measured")
    (answer,) = run.json("measure", "response", *paper, *asked)["responses"]
    off = np.array(answer["sensation_level_db"]) - np.array(answer["expected_level_db_sl"])
    assert np.all(np.abs(off) < 0.25)  # the expected is that under the load, which takes a third of a decibel at 122 Hz
    assert answer["expected_level_db_sl"][1] < 39.8
    felt_less_asked = np.array(answer["sensation_level_db"]) - 40.0
    np.testing.assert_allclose(answer["error_db"], felt_less_asked)
    np.testing.assert_allclose(answer["error_jnd"], np.abs(felt_less_asked) / 1.65)  # Israr, Tan, Reed 2006: the least
    np.testing.assert_allclose(answer["model_error_db"], felt_less_asked - off)
    parts = [np.array(answer[f"{name}_error_db"]) for name in ("prefilter", "load", "rest")]
    np.testing.assert_allclose(sum(parts), felt_less_asked, atol=1e-9)
    assert parts[1][1] < -0.2  # a third of a decibel at 122 Hz
    rows = list(csv.DictReader((tmp_path / "measured" / "response.csv").read_text().splitlines()))
    assert [float(row["measured_v"]) for row in rows][:2] == pytest.approx(answer["magnitude_v"])
    assert (tmp_path / "measured" / "response.svg").exists()
    assert (answer["frequency_hz"], answer["load"]) == ([5.0, 122.0], "finger")


def test_noise_finger_and_disturb__of_the_papers_loop__tell_levels_and_loads(paper, run) -> None:
    ended = run("measure", "noise", *paper, "--gains", "4,32", "--json")
    answer = json.loads(ended.out)
    assert ended.status == (1 if answer["outcome"] == "not met" else 0)
    assert set(answer["objectives"]) == {"ii", "iii"}
    assert [played["under"] for played in answer["runs"]] == ["gain 4", "gain 32", "loop"]
    lines = [played["channels"][0]["worst_line_db_sl"] for played in answer["runs"]]
    assert lines[1] > lines[0]
    asked = ("measure", "load", *paper, "--duration-s", "27")
    (answer,) = run.json(*asked)["channels"]
    assert answer["described_by"] == "one"
    values = [answer[name] for name in ("mass", "damping", "stiffness")]
    np.testing.assert_allclose(values, [0.12, 31.0, 360.0], rtol=0.01)
    assert run.json(*asked, "--load", "none", status=1)["channels"][0]["described_by"] == "cannot tell"
    rejection = run.json("measure", "disturbance", *paper, "--frequency-hz", "1,10")["channels"][0]["rejection"]
    np.testing.assert_allclose(rejection["measured_db"], rejection["expected_db"], atol=0.4)


def test_calibrate__outlier__is_refused_by_name_or_stops(run, tmp_path) -> None:
    pairs = tmp_path / "pairs.csv"
    rows = [f"p{k},{x},{0.19898 * x + (0.5 if k == 3 else 0.0)}" for k, x in enumerate(range(-6, 7))]
    pairs.write_text("name,displacement_mm,voltage_v\n" + "\n".join(rows) + "\n")
    ended = run("calibrate", pairs, "--json")
    answer = json.loads(ended.out)
    assert answer["sensor_gain_v_per_mm"] == pytest.approx(0.19898, rel=0.005)
    assert [pair["name"] for pair in answer["refused"]] == ["p3"]
    assert "p3" in ended.err
    run.refused("calibrate", pairs, "--strict", said="p3")
