"""Sound cards by name."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from tactuator.errors import BadInput, DeviceFault
from tactuator.io.display import parse_display
from tactuator.rig.open import open_rig
from tactuator.rig.sound import cards as audio_thread
from tactuator.rig.sound import cards as library
from tactuator.rig.sound import rig as rigs
from tactuator.rig.sound.cards import AudioThread, Card, find_card, lasting_name, sound_name
from tactuator.rig.sound.rig import SoundRig
from tests.rig.sound.turned_card import sound_display
from tests.three_fingers import three_finger_display

CARDS = (
    Card(0, "Fireface", "ALSA", 8, 8, 48000.0),
    Card(1, "Fireface", "JACK", 8, 8, 48000.0),
    Card(2, "pulse", "ALSA", 32, 32, 44100.0),
)


@pytest.mark.parametrize(("name", "index"), [("pulse", 2), ("JACK/Fireface", 1), ("jack", 1), ("ALSA/Fireface", 0)])
def test_find_card__one_of_that_name__is_it(name: str, index: int):
    assert find_card(name, CARDS).index == index


@pytest.mark.parametrize(
    ("name", "cards", "words"),
    [
        ("Fireface", CARDS, "may be 'ALSA/Fireface', 'JACK/Fireface'; expected one of these names in full"),
        ("Scarlett", CARDS, "there is no sound card 'Scarlett'; expected 'ALSA/Fireface'"),
        ("any", (), "there is no sound card; expected one that the system lists"),
    ],
)
def test_find_card__none_or_two__is_refused(name: str, cards: tuple[Card, ...], words: str):
    with pytest.raises(BadInput, match=words):
        find_card(name, cards)


@pytest.mark.parametrize(
    ("spec", "found"),
    [("hw:1,0@48000", ("hw:1,0", 48000.0)), ("a@b", ("a@b", None)), ("x", ("x", None)), ("@96000", ("", 96000.0))],
)
def test_sound_name__device_and_rate__come_apart(spec: str, found: tuple[str, float | None]):
    assert sound_name(spec) == found


@pytest.mark.parametrize(
    ("error", "words"), [(ImportError, "pip install 'tactuator"), (OSError, "apt-get install libportaudio2")]
)
def test_sounddevice__missing__says_what_to_install(monkeypatch, error: type[Exception], words: str):
    def missing(name: str) -> None:
        raise error(name)

    monkeypatch.setattr(library, "import_module", missing)
    with pytest.raises(BadInput, match=words):
        open_rig("sound:any", sound_display())


def test_open_rig__another_rate_a_loop_or_no_wiring__is_refused():
    looped = {"sound": {"output_full_scale_v": 1.0}}
    for name, display, words in (
        ("sound:any@44100", sound_display(), "at 44100 Hz; expected the display's rate_hz, 8000 Hz"),
        ("sound:any@-1", sound_display(), "a rate of -1 Hz"),
        ("sound:any", parse_display(three_finger_display()), r"a table \[sound\] with output_full_scale_v"),
        (
            "sound:any",
            parse_display(three_finger_display() | looped),
            "structure is 'paper', and a loop through",
        ),
    ):
        with pytest.raises(BadInput, match=words):
            open_rig(name, display)


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Callable[..., SoundRig]:
    """Opens sound cards of a list, not of this machine."""

    def open_on(spec: str, cards: Sequence[Card] = CARDS, **sound: Any) -> SoundRig:
        monkeypatch.setattr(rigs, "list_cards", lambda: cards)
        monkeypatch.setattr(rigs, "CardPort", lambda *given: SimpleNamespace(close=lambda alive: None))
        return rigs.sound_rig(spec, sound_display(**sound))

    return open_on


def test_sound_rig__card_of_any_spelling__its_display_names_the_card(opened):
    assert opened("JACK/Fire").display.sound.device == "JACK/Fireface"
    both = opened("pulse", input_device="ALSA/Fire").display.sound
    assert (both.device, both.input_device) == ("ALSA/pulse", "ALSA/Fireface")
    assert opened("", device="pulse").display.sound.device == "ALSA/pulse"


@pytest.mark.parametrize("spec", ["JACK/Fireface", "pulse", "ALSA/pulse@8000"])
def test_sound_rig__another_card_than_the_display_names__is_refused(opened, spec: str):
    calibrated = opened("ALSA/Fireface").display.sound.device
    assert opened("ALSA/Fire", device=calibrated).display.sound.device == calibrated
    with pytest.raises(BadInput, match=r"expected 'ALSA/Fireface', the device in \[sound\]") as refused:
        opened(spec, device=calibrated)
    assert f"sound card {find_card(spec.partition('@')[0], CARDS).full_name!r}" in str(refused.value)
    with pytest.raises(BadInput, match="there is no sound card 'ALSA/Fireface'"):
        opened("", CARDS[1:], device=calibrated)


def test_lasting_name__alsa_counts_its_cards_anew__found_again(opened):
    first = (
        Card(0, "Onboard: ALC (hw:0,0)", "ALSA", 2, 2, 48e3),
        Card(1, "DAC: USB Audio (hw:1,0)", "ALSA", 2, 0, 48e3),
    )
    later = (
        Card(0, "DAC: USB Audio (hw:0,0)", "ALSA", 2, 0, 48e3),
        Card(1, "Onboard: ALC (hw:1,0)", "ALSA", 2, 2, 48e3),
    )
    name = lasting_name(first[1], first)
    assert (name, find_card(name, later)) == ("ALSA/DAC: USB Audio", later[0])
    twins = (*first, Card(2, "DAC: USB Audio (hw:2,0)", "ALSA", 2, 0, 48e3))
    assert lasting_name(twins[1], twins) == "ALSA/DAC: USB Audio (hw:1,0)"


def test_answer__several_jobs__from_one_thread_which_goes_on_after_one_that_fails():
    calls = AudioThread()
    names = {calls.answer(lambda: threading.current_thread().ident, "looking") for _ in range(3)}
    with pytest.raises(ZeroDivisionError):
        calls.answer(lambda: 1 // 0, "dividing")
    assert names == {calls.answer(lambda: threading.current_thread().ident, "looking")}
    assert names != {threading.current_thread().ident}


def test_answer__job_that_hangs__one_fault_and_each_later_call_fails(monkeypatch):
    monkeypatch.setattr(audio_thread, "ANSWER_S", 0.05)
    calls, go, undone = AudioThread(), threading.Event(), threading.Event()

    def late() -> str:
        go.wait(10.0)
        return "a stream"

    with pytest.raises(DeviceFault, match=r"opening: the sound system has not answered for 0\.05 s; expected "):
        calls.answer(late, "opening", lambda made: undone.set() if made == "a stream" else None)
    with pytest.raises(DeviceFault, match="opening"):
        calls.answer(lambda: 7, "counting")
    assert not undone.is_set()
    go.set()
    assert undone.wait(10.0)  # what came too late is let go of


def test_quiet__within__nothing_reaches_standard_error(capfd):
    with library.quiet():
        os.write(2, b"ALSA lib warning\n")
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "after\n"


GIVES_UP = """
import ctypes, os, sys, threading
from tactuator.errors import DeviceFault
from tactuator.rig.sound import cards as audio_thread
audio_thread.ANSWER_S = 1e4  # the fault does not wait for it
calls = audio_thread.AudioThread()
print(calls.answer(lambda: 7, "counting"))
if sys.argv[1] == "elsewhere":
    inside = threading.Event()
    threading.Thread(target=lambda: inside.wait() and os.abort()).start()
    calls.answer(lambda: (inside.set(), threading.Event().wait(600.0)), "looking")
for job in (ctypes.CDLL(None).abort, lambda: 8):  # as a library aborts: without the interpreter's lock
    try:
        calls.answer(job, "opening")
    except DeviceFault as fault:
        print(fault)
"""


def program_that_gives_up(where: str) -> subprocess.CompletedProcess[str]:
    asked = [sys.executable, "-c", GIVES_UP, where]
    return subprocess.run(asked, capture_output=True, text=True, timeout=600, check=False)


def test_answer__library_that_calls_abort__one_fault_and_the_program_goes_on():
    done = program_that_gives_up("in the thread")
    assert done.returncode == 0, done.stderr
    counted, *faults = done.stdout.splitlines()
    assert counted == "7"
    words = "opening: the sound system has failed, as it does where its server ends; expected "
    assert [fault.startswith(words) for fault in faults] == [True, True]


def test_answer__abort_in_another_thread__ends_the_program():
    assert program_that_gives_up("elsewhere").returncode == -signal.SIGABRT
