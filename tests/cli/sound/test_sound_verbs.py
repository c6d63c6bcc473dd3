"""The verbs for sound cards: every refusal in one line, with the output at rest and nothing half-written."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tactuator.io.record import read_record
from tactuator.io.text import toml_text
from tactuator.measure.broadband import Level, PlantEstimate, Recording
from tactuator.measure.open_loop import KnownChannel, NoEqualiser
from tactuator.model.description import display_document
from tactuator.rig.sound import cards
from tactuator.rig.sound import rig as rigs
from tactuator.signals.multisine import Multisine
from tests.rig.sound.from_start_to_end import controller
from tests.rig.sound.turned_card import TurnedCard, sound_display, turned_rig

ROOT = Path(__file__).parents[3]
CALIBRATE = ("sound", "calibrate-display", "sound.toml", "--out", "out")


class PortAudioError(Exception):
    """As sounddevice's."""


def fake_sounddevice(error: str = "", outputs: int = 2, inputs: int = 2) -> SimpleNamespace:
    """A PortAudio with one card, which cannot be opened for the reason `error`."""

    def stream(*given: Any, **more: Any) -> None:
        raise PortAudioError(error, -9985)

    device = {"name": "Card", "hostapi": 0, "max_output_channels": outputs, "max_input_channels": inputs}
    return SimpleNamespace(
        PortAudioError=PortAudioError,
        _exit_handler=lambda: None,
        _StreamBase=stream,
        _ffi=SimpleNamespace(cast=lambda kind, value: value),
        query_hostapis=lambda: [{"name": "ALSA"}],
        query_devices=lambda: [device | {"default_samplerate": 44100.0}] if outputs else [],
    )


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sound.toml").write_text(toml_text(display_document(sound_display(latency_samples=0))))
    return tmp_path


@pytest.mark.parametrize(
    ("card", "status", "words"),
    [
        ({"inputs": 1}, 2, "has 1 inputs; expected 2 or more"),
        ({"error": "Error opening _StreamBase: Invalid sample rate [PaErrorCode -9997]"}, 2,
         "'ALSA/Card' does not run at 8000 Hz; expected 44100 Hz"),
        ({"error": "Error opening _StreamBase: Device unavailable [PaErrorCode -9985]"}, 3,
         "'ALSA/Card' cannot be opened (Device unavailable [PaErrorCode -9985]); expected "
         "one that nobody else holds"),
    ],
    ids=["too few inputs", "rate", "busy"],
)  # fmt: skip
def test_calibrate_display__card_that_will_not_do__one_line_and_nothing_written(
    card: dict[str, Any], status: int, words: str, room, run, monkeypatch
):
    monkeypatch.setattr(cards, "import_module", lambda name: fake_sounddevice(**card))
    run.refused(*CALIBRATE, "--rig", "sound:Card", said=words, status=status)


NEVER_LEAVES = """
import atexit, ctypes, sys, threading
from tactuator.cli import main
from tactuator.rig.sound import cards
from tests.cli.sound.test_sound_verbs import fake_sounddevice
module = fake_sounddevice()
module._StreamBase = lambda *given, **more: threading.Event().wait(60.0)
cards.import_module = lambda name: module
cards.ANSWER_S = 3.0
c = ctypes.CDLL(None)
c.__cxa_atexit(c.pause, None, None)  # as a library that waits for what its own thread holds
atexit.register(print, "tidied up")
sys.exit(main())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the C library is asked by the name that it has on Linux")
def test_calibrate_display__card_that_never_opens__one_line_all_the_same(room):
    given = ["sound", "calibrate-display", str(room / "sound.toml"), "--rig", "sound:Card", "--out", str(room / "out")]
    asked = [sys.executable, "-c", NEVER_LEAVES, *given]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stdout) == (3, "tidied up\n")
    (line,) = done.stderr.splitlines()
    assert "opening sound card 'ALSA/Card': the sound system has not answered for 3 s; expected " in line
    assert not (room / "out").exists()


def put_in(monkeypatch: pytest.MonkeyPatch, **card: Any) -> list[TurnedCard]:
    """Let every display on a sound card stand on a card that is turned by hand."""
    turned: list[TurnedCard] = []

    def opened(spec: str, display: Any, seed: int) -> Any:
        rig, card_of_it = turned_rig(display, **card)
        turned.append(card_of_it)
        return rig

    monkeypatch.setattr(rigs, "sound_rig", opened)
    return turned


def _noise(level: float) -> Any:
    rng = np.random.default_rng(1)
    return lambda out: (level * rng.standard_normal(out.shape)).astype(np.float32)


@pytest.mark.parametrize(
    ("card", "status", "words"),
    [
        ({"stops_at": 200}, 3, "the sound card has stopped: not a sample for 1 s"),
        ({"answer": lambda out: np.clip(200.0 * out, -1.0, 1.0).astype(np.float32)}, 2, "input 1 of the card clips"),
    ],
    ids=["unplugged", "clips"],
)
def test_calibrate_display__amiss_on_the_way__output_at_rest_nothing_written(
    card: dict[str, Any], status: int, words: str, room, run, monkeypatch
):
    opened = put_in(monkeypatch, **card)
    run.refused(*CALIBRATE, "--rig", "sound:", "--json", said=words, status=status)
    (turned,) = opened
    assert turned.closed is not None
    if "stops_at" not in card:  # a card that is gone lets nothing be put out any more
        assert not np.any(turned.put_out[-1])


def test_calibrate_display__no_equaliser__what_was_measured_is_kept(room, run, monkeypatch):
    put_in(monkeypatch)
    period = np.sin(2.0 * np.pi * np.arange(64) / 8.0)
    wave = Multisine(8000.0, 64, np.array([8]), np.ones(1), np.array([-0.5 * np.pi]))
    heard = Recording(wave, 1.0, np.stack([period] * 5), np.stack([0.5 * period] * 5), period)
    level = Level(1.0, 30.0, 0.1, "noise")

    def none(rig: Any, *more: Any) -> None:
        channels = rig.display.channels
        followed = [PlantEstimate(channel.plant, "response", None, 0.2, ()) for channel in channels]
        known = (KnownChannel(*pair[:1], level, heard, pair[1], None) for pair in zip(channels, followed, strict=True))
        raise NoEqualiser("no prefilter of 16 poles", rig.display, tuple(known))

    monkeypatch.setattr("tactuator.api.sound.calibrate", none)
    ended, names = run(*CALIBRATE), ["display.toml", "left.record.h5", "right.record.h5"]
    assert ended.status == 2
    words = f"no prefilter of 16 poles. What was measured is kept in out ({', '.join(names)}); `tactuator design"
    assert words in ended.err
    assert sorted(path.name for path in (room / "out").iterdir()) == names
    record = read_record(room / "out" / "left.record.h5")
    assert np.array_equal(record.position, np.tile(0.5 * period, 5))
    assert (record.rate_hz, record.about["hold"]) == (8000.0, "band-limited")
    assert run("design", "out/display.toml", "--out", "c.json").status in (0, 1)  # 1: met or not
    assert (room / "c.json").is_file()


def test_design__display_on_a_sound_card__is_not_refused_for_what_a_board_takes(room, run):
    (room / "sound.toml").write_text(toml_text(display_document(controller(0).display)))
    assert run("design", "sound.toml", "--out", "c.json").status == 0
    (finding,) = run.json("check", "c.json")["objectives"]["build"]["findings"]
    assert finding["outcome"] == "not judged"
    words = "wired to a sound card, which takes no image; a board would not take it: delay_samples is 0"
    assert words in finding["remark"]


def test_sound_devices_and_calibrate__are_listed_and_tell_the_volts(run, monkeypatch):
    monkeypatch.setattr(cards, "import_module", lambda name: fake_sounddevice())
    (card,) = run.json("sound", "devices")["devices"]
    assert (card["device"], card["outputs"], card["rate_hz"]) == ("ALSA/Card", 2, 44100.0)
    monkeypatch.setattr(cards, "import_module", lambda name: fake_sounddevice(outputs=0))
    assert "`aplay -l` lists" in run("sound", "devices").out
    put_in(monkeypatch, answer=lambda out: (0.25 * out).astype(np.float32))
    given = ("sound", "calibrate", "--device", "Card", "--rate-hz", "8000", "--reading-v", "0.1", "--input", "1")
    volts = run.json(*given, "--duration-s", "2")
    # 0.1 V rms of a tone of a tenth of full scale; of which a quarter comes back
    assert volts["output_full_scale_v"] == pytest.approx(np.sqrt(2.0), rel=1e-6)
    assert volts["input_full_scale_v"] == pytest.approx(4.0 * np.sqrt(2.0), rel=1e-3)


@pytest.mark.parametrize("given", ["latency", "calibrate --reading-v 0.1 --input 1 --duration-s 2"])
def test_sound_verbs__no_wire__are_refused(given: str, run, monkeypatch):
    put_in(monkeypatch, answer=_noise(1e-3))
    words = "what was put out does not come back at the input"
    run.refused("sound", *given.split(), "--device", "Card", "--rate-hz", "8000", said=words)
