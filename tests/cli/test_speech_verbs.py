"""render, play, corpus, waveforms and experiment recognise/information from the command line."""

import json
import resource
import signal
import tomllib

import numpy as np
import pytest
import soundfile

from tactuator.cli import main
from tactuator.io.controller import write_controller
from tactuator.io.display import parse_display
from tactuator.io.reference import open_reference
from tactuator.speech.reading import sample_path
from tactuator.synthesis.design import design_controller
from tests.one_finger import DISPLAY


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with display.toml and controller.json."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "display.toml").write_text(DISPLAY)
    write_controller(folder / "controller.json", design_controller(parse_display(tomllib.loads(DISPLAY))))
    return folder


@pytest.fixture
def run(made, capfd):
    """Runs the program in this process: (status, JSON or None, standard error)."""

    def go(*arguments, controller=True, as_json=True):
        words = [str(argument) for argument in arguments]
        words += ["--controller", str(made / "controller.json")] if controller else []
        capfd.readouterr()
        status = main([*words, *(["--json"] if as_json else [])])
        out, err = capfd.readouterr()
        return status, json.loads(out) if out.strip() and as_json else None, err

    return go


def test_render__sample__reference_felt_picture_and_figures(run, tmp_path):
    status, figures, _ = run(
        "render", sample_path(), "--out", tmp_path / "r.wav", "--felt", tmp_path / "f.wav",
        "--figures", tmp_path / "figures", "--save-coding", tmp_path / "c.toml",
    )  # fmt: skip
    assert status == 0
    assert figures["felt"]["index"]["rms_db"] < 1.0
    assert figures["limiter"]["index"]["max_reduction_db"] == 0.0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "c.toml", "f.json", "f.wav", "figures", "r.json", "r.wav"
    ]  # fmt: skip
    assert sorted(path.suffix for path in (tmp_path / "figures").iterdir()) == [".csv", ".svg"]
    status, again, _ = run("render", sample_path(), "--out", tmp_path / "r2.wav", "--coding", tmp_path / "c.toml")
    assert (status, again["sha256"]) == (0, figures["sha256"])


def test_render__display_file__designs_for_it(run, made, tmp_path):
    status, figures, _ = run(
        "render", sample_path(), "--out", tmp_path / "r.h5", "--display", made / "display.toml", controller=False
    )
    assert status == 0
    assert open_reference(tmp_path / "r.h5").frames == figures["frames"]


def test_render__stereo__mixed_and_said(run, tmp_path):
    samples, rate = soundfile.read(sample_path())
    soundfile.write(tmp_path / "two.wav", np.stack([samples, samples], axis=1), rate)
    status, figures, _ = run("render", tmp_path / "two.wav", "--out", tmp_path / "r.wav")
    assert status == 0
    assert figures["notes"] == ["2 channels mixed down to one (their mean)"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("render S --out r.wav --controller C --level 60", "level (--level) of 60 dB SL; allowed: -60 to 55 dB SL"),
        ("render S --out r.wav --controller C --coding morse", "coding 'morse' is not known"),
        ("render S --out r.wav --controller C --figures figures", "--figures without --felt"),
        ("render S --out r.wav --controller C --display none.toml", "none.toml"),
        ("render S --out r.wav", "neither --display nor --controller"),
        ("play none.wav --controller C", "No such file"),
        ("play REFERENCE --controller C --rig abacus", "abacus"),
        ("corpus SPEECH --out out --controller C --scheduler tcp://127.0.0.1:1", "no Dask scheduler"),
        ("corpus SPEECH --out out --controller C --scheduler tcp://127.0.0.1:1 --workers 2", "allowed: one of them"),
        ("experiment information", "one of the two"),
        ("experiment information --store none.db", "none.db"),
        ("experiment information --matrix none.csv", "No such file"),
        ("experiment information --store . --seconds 1", "--seconds with --store"),
    ],
)
def test_verbs__amiss__one_line_status_2_and_nothing_left(run, made, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    places = {
        "S": sample_path(), "C": made / "controller.json", "SPEECH": sample_path().parent, "REFERENCE": made / "r.wav"
    }  # fmt: skip
    if "REFERENCE" in arguments:
        run("render", sample_path(), "--out", made / "r.wav")
    status, figures, err = run(*(places.get(word, word) for word in arguments.split()), controller=False)
    assert (status, figures) == (2, None)
    assert words in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "file_bytes"), [("r.wav", 30_000), ("r.h5", 42_000), ("r.wav", 60_000)])
def test_render__disk_full__one_line_and_nothing_left(run, tmp_path, name, file_bytes):
    """A limit on the length of a file is what a full disk does."""
    usual, before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, before[1]))
    try:
        status, _, err = run("render", sample_path(), "--out", tmp_path / name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, usual)
    assert status == 2, err
    assert err.count("\n") == 1
    assert "room" in err
    assert list(tmp_path.iterdir()) == []


def test_play__rendered_sample__to_its_end(run, tmp_path):
    run("render", sample_path(), "--out", tmp_path / "r.wav")
    status, figures, _ = run("play", tmp_path / "r.wav")
    assert status == 0
    assert figures["played_s"] == pytest.approx(figures["duration_s"])
    assert not figures["stopped"]


def test_corpus__one_bad_file__the_rest_done_and_status_1(run, tmp_path):
    speech = tmp_path / "speech"
    speech.mkdir()
    (speech / "good.wav").write_bytes(sample_path().read_bytes())
    (speech / "bad.wav").write_text("words")
    status, figures, _ = run("corpus", speech, "--out", tmp_path / "out", "--workers", "1")
    assert status == 1
    assert figures["rendered"] == 1
    assert [failure["source"] for failure in figures["failures"]] == ["bad.wav"]
    (speech / "bad.wav").unlink()
    status, figures, _ = run("corpus", speech, "--out", tmp_path / "out", "--workers", "1")
    assert (status, figures["rendered"], figures["kept"]) == (0, 0, 1)


def test_waveforms_recognise_information__from_nothing_to_bits(run, tmp_path, made):
    status, figures, _ = run(
        "waveforms", "--out", tmp_path / "set", "--fingers", "index", "--duration", "0.125", "--repetitions", "4"
    )
    assert status == 0
    assert len(figures["items"]) == 7
    status, figures, _ = run(
        "experiment", "recognise", figures["protocol"], "--store", tmp_path / "lab.db", "--scripted-error", "0.1"
    )
    assert (status, figures["trials"]) == (0, 7 * (2 + 4))
    protocol, store = tmp_path / "set" / "protocol.toml", tmp_path / "lab.db"
    again = ("experiment", "recognise", protocol, "--store", store, "--scripted-error", "0.1")
    status, done, _ = run(*again, "--display", made / "display.toml", controller=False)  # designed for it; all is done
    assert (status, done["trials"]) == (0, 0)
    status, _, err = run(*again, "--display", tmp_path / "none.toml", controller=False)
    assert (status, "none.toml" in err) == (2, True)
    status, figures, _ = run("experiment", "information", "--store", tmp_path / "lab.db", controller=False)
    assert status == 0
    (result,) = figures["results"]
    assert result["trials"] == 28
    assert result["estimates"]["plug_in"]["bits"] > 1.5
    assert result["bits_per_second"]["plug_in"] == pytest.approx(result["estimates"]["plug_in"]["bits"] / 0.125)
    assert "5 a cell" in result["warning"]


def test_waveforms__over_an_older_set__all_of_it_or_nothing(run, tmp_path, monkeypatch):
    short = ("waveforms", "--out", tmp_path / "set", "--fingers", "index", "--duration", "0.125")
    assert run(*short)[0] == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "set").iterdir()}
    assert len(before) == 7 * 2 + 1

    def full(path, text):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("tactuator.io.atomic.write_text", full)
        status, _, err = run(*short, "--level", "30")
    assert (status, "No space left" in err) == (2, True)
    assert {path.name: path.read_bytes() for path in (tmp_path / "set").iterdir()} == before
    assert run(*short, "--level", "30")[0] == 0
    after = {path.name: path.read_bytes() for path in (tmp_path / "set").iterdir()}
    assert after.keys() == before.keys()
    assert after["K-index.wav"] != before["K-index.wav"]
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_waveforms__folder_with_other_files__left_alone(run, tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    status, _, err = run("waveforms", "--out", tmp_path)
    assert (status, "holds other files (thesis.tex" in err) == (2, True)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_information__any_matrix__by_hand(run, tmp_path):
    (tmp_path / "m.csv").write_text("10,0\n0,10\n")
    status, figures, _ = run(
        "experiment", "information", "--matrix", tmp_path / "m.csv", "--seconds", "0.5", controller=False
    )
    assert status == 0
    assert figures["estimates"]["plug_in"]["bits"] == pytest.approx(1.0)
    assert figures["bits_per_second"]["plug_in"] == pytest.approx(2.0)
    assert figures["warning"] is None
    status, _, _ = run("experiment", "information", "--matrix", tmp_path / "m.csv", controller=False, as_json=False)
    assert status == 0
