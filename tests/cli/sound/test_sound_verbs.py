"""The verbs for sound cards: every refusal in one line, with the output at rest and nothing half-written."""

import json
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tactuator.cli import main
from tactuator.errors import BadInput
from tactuator.io.csv_tables import read_curve, write_curve
from tactuator.io.record import read_record
from tactuator.io.shipped import EXAMPLES
from tactuator.io.text import toml_text
from tactuator.measure import open_loop
from tactuator.measure.broadband import Followed, Heard, Level
from tactuator.measure.open_loop import KnownChannel, NoEqualiser
from tactuator.model.description import display_document
from tactuator.rig.sound import cards
from tactuator.rig.sound import rig as rigs
from tactuator.signals.multisine import Multisine
from tests.cli.refusals import refused
from tests.measure.open_loop.exciters import persons_curve
from tests.rig.sound.from_start_to_end import controller
from tests.rig.sound.turned_card import OVERFLOW, TurnedCard, sound_display, turned_rig

ROOT = Path(__file__).parents[3]


class PortAudioError(Exception):
    """As sounddevice's."""


def fake_sounddevice(error: str = "", outputs: int = 2, inputs: int = 2) -> SimpleNamespace:
    """A PortAudio with one card, which cannot be opened for the reason `error`."""

    def stream(*given: Any, **more: Any) -> None:
        raise PortAudioError(error, -9985)

    device = {
        "name": "Card",
        "hostapi": 0,
        "max_output_channels": outputs,
        "max_input_channels": inputs,
        "default_samplerate": 44100.0,
    }
    return SimpleNamespace(
        PortAudioError=PortAudioError,
        _exit_handler=lambda: None,
        _StreamBase=stream,
        _ffi=SimpleNamespace(cast=lambda kind, value: value),
        query_hostapis=lambda: [{"name": "ALSA"}],
        query_devices=lambda: [device] if outputs else [],
    )


@pytest.fixture
def display_file(tmp_path: Path) -> str:
    path = tmp_path / "display.toml"
    path.write_text(toml_text(display_document(sound_display(latency_samples=0))), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("card", "status", "words"),
    [
        ({"outputs": 0}, 2, "there is no sound card"),
        ({"outputs": 1}, 2, "has 1 outputs; allowed: 2 or more"),
        ({"inputs": 1}, 2, "has 1 inputs; allowed: 2 or more"),
        ({"error": "Error opening _StreamBase: Invalid sample rate [PaErrorCode -9997]"}, 2,
         "'ALSA/Card' does not run at 8000 Hz; allowed: 44100 Hz"),
        ({"error": "Error opening _StreamBase: Device unavailable [PaErrorCode -9985]"}, 3,
         "'ALSA/Card' cannot be opened (Device unavailable [PaErrorCode -9985]); allowed: "
         "one that nobody else holds"),
    ],
    ids=["no card", "too few outputs", "too few inputs", "rate", "busy"],
)  # fmt: skip
def test_calibrate_display__card_that_will_not_do__one_line_and_nothing_written(
    card: dict[str, Any], status: int, words: str, display_file: str, tmp_path: Path, monkeypatch, capfd
):
    monkeypatch.setattr(cards, "import_module", lambda name: fake_sounddevice(**card))
    arguments = ["calibrate-display", display_file, "--rig", "sound:Card", "--out", str(tmp_path / "out")]
    if not card.get("outputs", 2):
        arguments[3] = "sound:"
    assert main(arguments) == status
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("tactuator: ")
    assert err.count("\n") == 1
    assert words in err
    assert not (tmp_path / "out").exists()


def test_calibrate_display__card_that_never_opens__one_line_and_nothing_written(
    display_file: str, tmp_path: Path, monkeypatch, capfd
):
    go = threading.Event()
    module = fake_sounddevice()
    module._StreamBase = lambda *given, **more: go.wait(10.0)
    monkeypatch.setattr(cards, "import_module", lambda name: module)
    monkeypatch.setattr(cards, "ANSWER_S", 0.1)
    for name in ("_hung", "lost"):  # as they were, at the end of the test
        monkeypatch.setattr(cards.PORTAUDIO, name, getattr(cards.PORTAUDIO, name))
    out = tmp_path / "out"
    assert main(["calibrate-display", display_file, "--rig", "sound:Card", "--out", str(out)]) == 3
    go.set()
    (line,) = capfd.readouterr().err.splitlines()
    assert "opening sound card 'ALSA/Card': the sound system has not answered for 0.1 s; allowed: " in line
    assert not out.exists()


NEVER_LEAVES = """
import atexit, ctypes, sys, threading
from tactuator.cli import main
from tactuator.rig.sound import cards
from tests.cli.sound.test_sound_verbs import fake_sounddevice
module = fake_sounddevice()
module._StreamBase = lambda *given, **more: threading.Event().wait(60.0)
cards.import_module = lambda name: module
cards.ANSWER_S = 0.1
c = ctypes.CDLL(None)
c.__cxa_atexit(c.pause, None, None)  # as a library that waits for what its own thread holds
atexit.register(print, "tidied up")
sys.exit(main())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the C library is asked by the name that it has on Linux")
def test_calibrate_display__library_that_would_not_let_the_program_end__ends_all_the_same(
    display_file: str, tmp_path: Path
):
    given = ["calibrate-display", display_file, "--rig", "sound:Card", "--out", str(tmp_path / "out")]
    asked = [sys.executable, "-c", NEVER_LEAVES, *given]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (3, "tidied up\n")
    (line,) = done.stderr.splitlines()
    assert "opening sound card 'ALSA/Card'" in line


def put_in(monkeypatch: pytest.MonkeyPatch, **card: Any) -> list[TurnedCard]:
    """Let every display on a sound card stand on a card that is turned by hand."""
    made: list[TurnedCard] = []

    def opened(spec: str, display: Any, seed: int) -> Any:
        rig, turned = turned_rig(display, **card)
        made.append(turned)
        return rig

    monkeypatch.setattr(rigs, "sound_rig", opened)
    return made


def _noise(level: float) -> Any:
    rng = np.random.default_rng(1)
    return lambda out: (level * rng.standard_normal(out.shape)).astype(np.float32)


@pytest.mark.parametrize(
    ("card", "status", "words"),
    [
        ({"stops_at": 200}, 3, "the sound card has stopped: not a sample for 1 s"),
        ({"flags": lambda call: OVERFLOW if call % 50 == 7 else 0}, 3, "the sound card told of a gap"),
        ({"answer": lambda out: np.clip(200.0 * out, -1.0, 1.0).astype(np.float32)}, 2, "input 1 of the card clips"),
        ({"answer": lambda out: out[:, ::-1] + _noise(1e-6)(out)}, 2, "is answered by the sensor of 'right'"),
        ({"answer": _noise(1e-3)}, 2, "its sensor does not hear"),
    ],
    ids=["unplugged", "gaps", "clips", "swapped", "not connected"],
)
def test_calibrate_display__amiss_on_the_way__one_line_output_at_rest_and_nothing_written(
    card: dict[str, Any], status: int, words: str, display_file: str, tmp_path: Path, monkeypatch, capfd
):
    cards = put_in(monkeypatch, **card)
    arguments = ["calibrate-display", display_file, "--rig", "sound:", "--out", str(tmp_path / "out"), "--json"]
    assert main(arguments) == status
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert words in err
    assert not (tmp_path / "out").exists()
    (turned,) = cards
    assert turned.closed is not None
    if "stops_at" not in card:  # a card that is gone lets nothing be put out any more
        assert not np.any(turned.put_out[-1])


def test_calibrate_display__curve_of_a_person__is_the_one_that_is_calibrated_to(
    display_file: str, tmp_path: Path, monkeypatch, capsys
):
    put_in(monkeypatch)
    asked = []

    def stopped(rig: Any, *more: Any) -> None:
        asked.append(rig.display.channels[1].threshold.curve)
        raise BadInput("enough")

    monkeypatch.setattr(open_loop, "calibrate", stopped)
    own = tmp_path / "s9.csv"
    write_curve(own, persons_curve())
    given = ["calibrate-display", display_file, "--curve", str(own), "--out", str(tmp_path / "out")]
    refused(given, "enough", capsys, tmp_path)
    (found,) = asked
    assert found.name == "S9"
    assert np.array_equal(found.level_db_re_1um, read_curve(own).level_db_re_1um)
    # a curve that ends below the display's band tells nothing of what lies above
    refused([*given[:3], str(EXAMPLES / "curve.csv")], "allowed: one that covers the band", capsys, tmp_path)


def test_calibrate_display__no_equaliser__what_was_measured_is_kept_and_can_be_designed_on(
    display_file: str, tmp_path: Path, monkeypatch, capsys
):
    put_in(monkeypatch)
    period = np.sin(2.0 * np.pi * np.arange(64) / 8.0)
    wave = Multisine(8000.0, 64, np.array([8]), np.ones(1), np.array([-0.5 * np.pi]))
    heard = Heard(wave, 1.0, np.stack([period] * 5), np.stack([0.5 * period] * 5), period)

    def none(rig: Any, *more: Any) -> None:
        known = tuple(
            KnownChannel(
                one, Level(1.0, 30.0, 0.1, "noise"), heard, Followed(one.plant, "response", None, 0.2, ()), None
            )
            for one in rig.display.channels
        )
        raise NoEqualiser("no prefilter of 16 poles", rig.display, known)

    monkeypatch.setattr(open_loop, "calibrate", none)
    out = tmp_path / "out"
    assert main(["calibrate-display", display_file, "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    names = ["display.toml", "left.record.h5", "right.record.h5"]
    assert (
        f"no prefilter of 16 poles. What was measured is kept in {out} ({', '.join(names)}); `tactuator design" in line
    )
    assert sorted(path.name for path in out.iterdir()) == names
    record = read_record(out / "left.record.h5")
    assert np.array_equal(record.position, np.tile(0.5 * period, 5))
    assert (record.rate_hz, record.about["hold"]) == (8000.0, "band-limited")
    controller = tmp_path / "controller.json"
    assert main(["design", str(out / "display.toml"), "--out", str(controller)]) in (0, 1)  # 1: met or not
    assert controller.is_file()


def test_design__display_on_a_sound_card__is_not_refused_for_what_a_board_takes(tmp_path: Path, capsys):
    display = tmp_path / "display.toml"
    display.write_text(toml_text(display_document(controller(0).display)), encoding="utf-8")
    made = str(tmp_path / "controller.json")
    assert main(["design", str(display), "--out", made]) == 0
    capsys.readouterr()
    assert main(["check", made, "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["objectives"]["build"]["findings"]
    assert found["outcome"] == "not judged"
    assert (
        "wired to a sound card, which takes no image; a board would not take it: delay_samples is 0" in found["remark"]
    )


def test_sound_devices__a_card__is_listed(monkeypatch, capfd):
    monkeypatch.setattr(cards, "import_module", lambda name: fake_sounddevice())
    assert main(["sound", "devices", "--json"]) == 0
    (card,) = json.loads(capfd.readouterr().out)["devices"]
    assert (card["device"], card["outputs"], card["rate_hz"]) == ("ALSA/Card", 2, 44100.0)


def test_sound_devices__no_card__tells_what_to_do(monkeypatch, capfd):
    monkeypatch.setattr(cards, "import_module", lambda name: fake_sounddevice(outputs=0))
    assert main(["sound", "devices"]) == 0
    assert "`aplay -l` lists" in capfd.readouterr().out


@pytest.mark.parametrize(
    "given", [["latency"], ["calibrate", "--reading-v", "0.1", "--input", "1", "--duration-s", "2"]], ids=lambda x: x[0]
)
def test_sound_verbs__no_wire__are_refused(given: list[str], monkeypatch, capsys, tmp_path: Path):
    put_in(monkeypatch, answer=_noise(1e-3))
    told = ["sound", given[0], "--device", "Card", "--rate-hz", "8000", *given[1:]]
    refused(told, "what was put out does not come back at the input", capsys, tmp_path)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["latency", "--input", "0"], "input 0; allowed: the input to which the wire leads"),
        (["latency", "--rate-hz", "-1"], "a rate of -1 Hz; allowed: 1000 Hz or more"),
        (["calibrate", "--rate-hz", "nan"], "a rate of nan Hz; allowed: 1000 Hz or more"),
        (["calibrate", "--reading-v", "-3"], "a reading of -3 V rms; allowed: a positive number"),
    ],
    ids=["no input", "rate", "no rate", "reading"],
)
def test_sound_verbs__numbers_that_are_none__are_refused_before_a_card_is_opened(
    given: list[str], words: str, monkeypatch, capsys, tmp_path: Path
):
    cards = put_in(monkeypatch)
    refused(["sound", given[0], "--device", "Card", *given[1:]], words, capsys, tmp_path)
    assert cards == []


def test_sound_calibrate__wire_and_reading__volts_of_both(monkeypatch, capsys):
    put_in(monkeypatch, answer=lambda out: (0.25 * out).astype(np.float32))
    given = ["sound", "calibrate", "--device", "Card", "--rate-hz", "8000", "--reading-v", "0.1", "--input", "1"]
    assert main([*given, "--duration-s", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    # 0.1 V rms of a tone of a tenth of full scale; of which a quarter comes back
    assert found["output_full_scale_v"] == pytest.approx(np.sqrt(2.0), rel=1e-6)
    assert found["input_full_scale_v"] == pytest.approx(4.0 * np.sqrt(2.0), rel=1e-3)
