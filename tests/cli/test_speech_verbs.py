"""render, play, corpus, waveforms and experiment recognise/information from the command line."""

import numpy as np
import pytest
import soundfile

from tactuator.io.reference import open_reference

RENDER = ("render", "speech.wav", "--controller", "controller.json", "--out")
WAVEFORMS = ("waveforms", "--out", "set", "--fingers", "index", "--duration", "0.125")
WITH = ("--controller", "controller.json")


def test_render__sample__reference_felt_picture_and_figures(desk, run) -> None:
    before = set(desk.iterdir())
    more = ("--felt", "f.wav", "--figures", "figures", "--save-coding", "c.toml")
    figures = run.json(*RENDER, "n.wav", *more)
    assert figures["limiter"]["index"]["max_reduction_db"] == 0.0
    written = {path.name for path in set(desk.iterdir()) - before}
    assert written == {"c.toml", "f.json", "f.wav", "figures", "n.json", "n.wav"}
    assert sorted(path.suffix for path in (desk / "figures").iterdir()) == [".csv", ".svg"]
    assert run.json(*RENDER, "n2.wav", "--coding", "c.toml")["sha256"] == figures["sha256"]
    played = run.json("play", "n.wav", *WITH)
    assert played["played_s"] == pytest.approx(played["duration_s"])
    assert not played["stopped"]


def test_render__display_file_and_stereo__designs_for_it_and_mixes(desk, run) -> None:
    samples, rate = soundfile.read("speech.wav")
    soundfile.write("two.wav", np.stack([samples, samples], axis=1), rate)
    figures = run.json("render", "two.wav", "--out", "n.h5", "--display", "display.toml")
    assert open_reference("n.h5").frames == figures["frames"]
    assert figures["notes"] == ["2 channels mixed down to one (their mean)"]


def test_corpus__a_bad_file__the_rest_done_and_status_1(desk, run) -> None:
    (desk / "speech").mkdir()
    (desk / "speech.wav").rename(desk / "speech" / "good.wav")
    (desk / "speech" / "bad.wav").write_text("words")
    words = ("corpus", "speech", "--out", "out", "--workers", "1", *WITH)
    figures = run.json(*words, status=1)
    assert (figures["rendered"], [failure["source"] for failure in figures["failures"]]) == (1, ["bad.wav"])
    (desk / "speech" / "bad.wav").unlink()
    figures = run.json(*words)
    assert (figures["rendered"], figures["kept"]) == (0, 1)


def test_waveforms_recognise_information__from_nothing_to_bits(desk, run) -> None:
    figures = run.json(*WAVEFORMS, "--repetitions", "4", *WITH)
    assert len(figures["items"]) == 7
    recognise = ("experiment", "recognise", figures["protocol"], "--store", "lab.db", "--scripted-error", "0.1")
    assert run.json(*recognise, *WITH)["trials"] == 7 * (2 + 4)
    assert run.json(*recognise, "--display", "display.toml")["trials"] == 0  # designed for it; all is done
    (result,) = run.json("experiment", "information", "--store", "lab.db")["results"]
    assert result["trials"] == 28
    assert result["estimates"]["plug_in"]["bits"] > 1.5
    assert result["bits_per_second"]["plug_in"] == pytest.approx(result["estimates"]["plug_in"]["bits"] / 0.125)
    assert "5 a cell" in result["warning"]


def test_information__any_matrix__by_hand(desk, run) -> None:
    (desk / "m.csv").write_text("10,0\n0,10\n")
    figures = run.json("experiment", "information", "--matrix", "m.csv", "--seconds", "0.5")
    assert figures["estimates"]["plug_in"]["bits"] == pytest.approx(1.0)
    assert figures["bits_per_second"]["plug_in"] == pytest.approx(2.0)
    assert figures["warning"] is None
    assert run("experiment", "information", "--matrix", "m.csv").status == 0
