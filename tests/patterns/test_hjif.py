"""HJIF: the part that AHAP maps to, and the rules of MPEG's reference software."""

import json

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.patterns.hjif import parse_hjif
from tests.patterns.formats import HJIF, LIMITS, changed


def altered(path, value):
    return json.dumps(changed(HJIF, path, value))


PERCEPTION = ("perceptions", 0)
CHANNEL = (*PERCEPTION, "channels", 0)
BAND = (*CHANNEL, "bands", 1)


def test_hjif__transients_and_waves__are_taps_and_tones_in_hertz() -> None:
    clip = parse_hjif(json.dumps(HJIF))
    assert (clip.format, clip.pitch_in_hz, clip.duration_s, clip.unrendered) == ("hjif", True, 1.5, ())
    (tap,), (first, second) = clip.taps, clip.tones
    assert (tap.time_s, tap.strength) == (0.1, 0.25)  # a gain of a half
    assert (first.start_s, first.end_s, second.start_s, second.end_s) == (0.2, 0.7, 1.0, 1.5)
    np.testing.assert_allclose(first.strength.at(np.array([0.2, 0.45, 0.7])), [0.25, 0.375, 0.5])
    np.testing.assert_allclose(first.pitch.at(np.array([0.2, 0.325, 0.7])), [90.0, 195.0, 300.0])  # the band's end


def test_hjif__ticks_of_another_timescale__are_other_seconds() -> None:
    assert parse_hjif(altered(("timescale",), 500)).duration_s == 3.0


def test_hjif__other_bands_and_senses__are_passed_over_and_told() -> None:
    bands = [*HJIF["perceptions"][0]["channels"][0]["bands"], {"band_type": "Curve", **LIMITS, "effects": []}]
    assert parse_hjif(altered((*CHANNEL, "bands"), bands)).unrendered == ("Curve band",)
    with pytest.raises(BadInput, match="perceptions: Force; allowed: transients or vectorial waves"):
        parse_hjif(altered((*PERCEPTION, "perception_modality"), "Force"))


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("version",), "2022", "version is '2022'; allowed: a year from 2023 on"),
        (("version",), "2023-0", "version is '2023-0'"),
        (("profile",), "Most", "profile is 'Most'; allowed: Main, Simple Parametric"),
        (("profile",), "Simple Parametric", None),
        (("level",), 3, "level is 3; allowed: 1 to 2"),
        (("date",), "now", "date is 'now'"),
        (("timescale",), 96_000, "timescale is 96000; allowed: 1 to 48000"),
        (("syncs",), None, "syncs is missing"),
        (("avatars",), [{"id": 0}], "avatars: id is 0"),
        ((*PERCEPTION, "avatar_id"), 4, "avatar_id is 4"),
        ((*PERCEPTION, "perception_modality"), "Smell", "perception_modality is 'Smell'"),
        (("perceptions",), HJIF["perceptions"] * 2, "perceptions: id is 0 twice"),
        ((*PERCEPTION, "reference_devices", 0, "resonance_frequency"), 400, "maximum_frequency is 300"),
        ((*CHANNEL, "reference_device_id"), 4, "reference_device_id is 4"),
        ((*CHANNEL, "reference_device_id"), [], r"reference_device_id is \[\]; allowed: a number"),
        ((*CHANNEL, "gain"), None, "gain is missing"),
        ((*CHANNEL, "bands"), HJIF["perceptions"][0]["channels"][0]["bands"] * 4, "8 bands; allowed: 7 on this level"),
        ((*BAND, "band_type"), "Wave", "band_type is 'Wave'"),
        ((*BAND, "upper_frequency_limit"), 60, "upper_frequency_limit is 60; allowed: 65 or more"),
        ((*BAND, "curve_type"), "Linear", "curve_type is there in a VectorialWave band"),
        ((*BAND, "effects", 0, "effect_type"), "Wish", "effect_type is 'Wish'"),
        ((*BAND, "effects", 1, "id"), 8, "id is 8; allowed: an effect of the library"),
        ((*BAND, "effects", 0, "position"), 0.5, "position is 0.5; allowed: a whole number"),
        ((*BAND, "effects", 0, "keyframes", 1, "relative_position"), -1, "relative_position is -1"),
        ((*BAND, "effects", 0, "keyframes", 0, "amplitude_modulation"), 2, "amplitude_modulation is 2"),
        ((*BAND, "band_type"), "WaveletWave", "block_length is missing"),
    ],
)
def test_hjif__rule_broken__is_refused_with_it(path, value, said) -> None:
    if said is None:
        parse_hjif(altered(path, value))
        return
    with pytest.raises(BadInput, match=said):
        parse_hjif(altered(path, value))
