"""The table [sound] of a display file."""

from typing import Any

import pytest

from tactuator.errors import BadInput
from tactuator.io.display import parse_display
from tactuator.model.description import display_document
from tactuator.model.requirements import Wires
from tests.three_fingers import three_finger_display

FULL = {"output_full_scale_v": 2.0}


def display_with(sound: dict[str, Any], *channels: dict[str, Any]):
    document = three_finger_display()
    for entry, more in zip(document["channel"], channels, strict=False):
        entry.update(more)
    return parse_display(document | {"sound": sound})


def test_sound__wires__count_from_one_where_a_channel_does_not_say_otherwise():
    card = display_with(FULL).sound
    assert card.wires == tuple(Wires(k, k, 2.0, 1.0) for k in (1, 2, 3))
    assert (card.device, card.latency_samples) == ("", 0)
    display = display_with(FULL | {"device": "x", "latency_samples": 512}, {"output": 7, "input": 0})
    assert (display.sound.wires[0], display.sound.latency_samples) == (Wires(7, 0, 2.0, 1.0), 512)
    assert parse_display(display_document(display)).sound == display.sound
    assert "sound" not in display_document(parse_display(three_finger_display()))


@pytest.mark.parametrize(
    ("sound", "channel", "words"),
    [
        ({}, {}, r"\[sound\]: output_full_scale_v is missing"),
        (FULL | {"volts": 1.0}, {}, r"\[sound\]: volts is not a key that is known; allowed: device, input_device"),
        (FULL, {"output": 2}, "output 2 has two channels"),
        (FULL, {"input": 3}, "input 3 has two channels"),
        (FULL, {"output": 0}, "output is 0; allowed: a whole number, 1 to 64"),
        (FULL, {"device": "x"}, r"device is not a key"),
        (FULL | {"lead_s": 5.0}, {}, "lead_s is 5; allowed: a number, 0.02 to 2"),
    ],
)
def test_sound__amiss__is_refused_in_one_line(sound: dict[str, Any], channel: dict[str, Any], words: str):
    with pytest.raises(BadInput, match=words):
        display_with(sound, channel)


def test_channel__wires_without_the_table__are_unknown_keys():
    document = three_finger_display()
    document["channel"][0]["output"] = 2
    with pytest.raises(BadInput, match="output is not a key"):
        parse_display(document)


def force(**more):
    """Return the keys of a channel whose sensor tells a force."""
    return {"quantity": "force", "mass_kg": 0.02, "sensor_gain_v_per_n": 0.5} | more


def without_gain(**more):
    """Return a display of one channel whose sensor tells a force."""
    document = three_finger_display()
    entry = {key: value for key, value in document["channel"][0].items() if key != "sensor_gain_v_per_mm"}
    return parse_display(document | {"sound": FULL, "channel": [entry | force(**more)]})


def test_channel__force_on_a_known_mass__is_an_accelerometer_by_newtons_law():
    """20 g at 1 m/s² take 20 mN, and these give 10 mV: 1e-5 V for 1 mm/s²."""
    channel = without_gain().channels[0]
    assert channel.quantity == "acceleration"
    assert channel.sensor_gain_v_per_mm == pytest.approx(1e-5, rel=1e-12)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"mass_kg": 0.0}, "mass_kg is 0; allowed: a number, above 0"),
        ({"sensor_gain_v_per_n": -1.0}, "sensor_gain_v_per_n is -1; allowed: a number, above 0"),
        ({"quantity": "velocity"}, "mass_kg is not a key"),
        ({"sensor_gain_v_per_mm": 1.0}, "sensor_gain_v_per_mm is given beside quantity = 'force'"),
    ],
)
def test_channel__force_amiss__is_refused_in_one_line(more: dict[str, Any], words: str):
    with pytest.raises(BadInput, match=words):
        without_gain(**more)


def test_channel__force_without_a_mass__is_refused_and_told_why():
    with pytest.raises(BadInput, match="'force', which alone does not tell how far a finger moves: mass_kg is missing"):
        display_with(FULL, {"quantity": "force"})
