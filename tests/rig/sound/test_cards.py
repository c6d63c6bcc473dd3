"""Sound cards by name."""

from __future__ import annotations

import pytest

from tactuator.errors import BadInput
from tactuator.rig.open import open_rig
from tactuator.rig.sound import cards as library
from tactuator.rig.sound.cards import Card, find_card, sound_name
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
    ("name", "words"),
    [
        ("Fireface", "may be 'ALSA/Fireface', 'JACK/Fireface'; allowed: one of these names in full"),
        ("Scarlett", "there is no sound card 'Scarlett'; allowed: 'ALSA/Fireface'"),
    ],
)
def test_find_card__none_or_two__is_refused(name: str, words: str):
    with pytest.raises(BadInput, match=words):
        find_card(name, CARDS)


def test_find_card__no_card_at_all__is_refused():
    with pytest.raises(BadInput, match="there is no sound card"):
        find_card("any", ())


@pytest.mark.parametrize(
    ("spec", "found"),
    [("hw:1,0@48000", ("hw:1,0", 48000.0)), ("a@b", ("a@b", None)), ("x", ("x", None)), ("@96000", ("", 96000.0))],
)
def test_sound_name__device_and_rate__come_apart(spec: str, found: tuple[str, float | None]):
    assert sound_name(spec) == found


def test_sound_name__negative_rate__is_refused():
    with pytest.raises(BadInput, match="a rate of -1 Hz"):
        sound_name("x@-1")


@pytest.mark.parametrize(
    ("error", "words"), [(ImportError, "pip install 'tactuator"), (OSError, "apt-get install libportaudio2")]
)
def test_sounddevice__missing__says_what_to_install(monkeypatch, error: type[Exception], words: str):
    def missing(name: str) -> None:
        raise error(name)

    monkeypatch.setattr(library, "import_module", missing)
    with pytest.raises(BadInput, match=words):
        open_rig("sound:any", sound_display())


def test_open_rig__other_rate_than_the_displays__is_refused():
    with pytest.raises(BadInput, match="at 44100 Hz; allowed: the display's rate_hz, 8000 Hz"):
        open_rig("sound:any@44100", sound_display())


def test_open_rig__display_with_a_loop_or_without_wiring__is_refused():
    from tactuator.io.display import parse_display

    with pytest.raises(BadInput, match=r"allowed: a table \[sound\] with output_full_scale_v"):
        open_rig("sound:any", parse_display(three_finger_display()))
    looped = parse_display(three_finger_display() | {"sound": {"output_full_scale_v": 1.0}})
    with pytest.raises(BadInput, match="structure is 'paper', and a loop through a sound card"):
        open_rig("sound:any", looped)


def test_quiet__within__nothing_reaches_standard_error(capfd):
    import os

    with library.quiet():
        os.write(2, b"ALSA lib warning\n")
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "after\n"
