"""Clips of other formats: what they ask for, and every rule that one can break."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.patterns.acf import read_acf
from tactuator.patterns.android import read_profile
from tactuator.patterns.clip import Clip
from tactuator.patterns.files import read_clip
from tests.patterns.formats import ACF, HJIF, changed

HAPTIC = {
    "version": {"major": 1, "minor": 0, "patch": 0},
    "metadata": {"anything": 1},
    "signals": {
        "continuous": {
            "envelopes": {
                "amplitude": [
                    {"time": 0.0, "amplitude": 0.2},
                    {"time": 0.1, "amplitude": 0.6, "emphasis": {"amplitude": 0.9, "frequency": 0.7}},
                    {"time": 0.3, "amplitude": 0.0},
                ],
                "frequency": [{"time": 0.0, "frequency": 0.2}, {"time": 0.2, "frequency": 0.6}],
            }
        }
    },
}
ENVELOPES = ("signals", "continuous", "envelopes")
AHAP = {
    "Version": 1.0,
    "Pattern": [
        {"Event": {"Time": 0.1, "EventType": "HapticTransient", "EventParameters": [
            {"ParameterID": "HapticIntensity", "ParameterValue": 0.8}]}},
        {"Event": {"Time": 0.0, "EventType": "HapticContinuous", "EventDuration": 0.5, "EventParameters": [
            {"ParameterID": "HapticIntensity", "ParameterValue": 2.0},
            {"ParameterID": "HapticSharpness", "ParameterValue": 0.4}]}},
        {"ParameterCurve": {"ParameterID": "HapticIntensityControl", "Time": 0.1, "ParameterCurveControlPoints": [
            {"Time": 0.0, "ParameterValue": 1.0}, {"Time": 0.2, "ParameterValue": 0.5}]}},
        {"ParameterCurve": {"ParameterID": "HapticSharpnessControl", "Time": 0.0, "ParameterCurveControlPoints": [
            {"Time": 0.0, "ParameterValue": 0.3}, {"Time": 0.4, "ParameterValue": 0.9}]}},
    ],
}  # fmt: skip
BASIC = """<vibration-effect><basic-envelope-effect initialSharpness="0.3">
<control-point intensity="0.2" sharpness="0.5" durationMs="100" />
<control-point intensity="0.0" sharpness="0.5" durationMs="100" /></basic-envelope-effect></vibration-effect>"""
ADVANCED = """<vibration-effect><waveform-envelope-effect>
<control-point amplitude="0.5" frequencyHz="80" durationMs="50" /></waveform-envelope-effect></vibration-effect>"""


def read(tmp_path, name, content, **how) -> Clip:
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return read_clip(path, **how)


def test_haptic__points__are_strength_pitch_and_taps(tmp_path) -> None:
    clip = read(tmp_path, "knock.haptic", HAPTIC)
    (tone,), (tap,) = clip.tones, clip.taps
    assert (clip.name, clip.format, clip.duration_s, clip.pitch_in_hz) == ("knock.haptic", "haptic", 0.3, False)
    np.testing.assert_allclose(tone.strength.at(np.array([0.0, 0.05, 0.2])), [0.2, 0.4, 0.3])
    np.testing.assert_allclose(tone.pitch.at(np.array([0.1, 0.3])), [0.4, 0.6])  # held after its end
    assert (tap.time_s, tap.strength, tap.pitch) == (0.1, 0.9, 0.7)


def test_haptic__without_frequency__has_the_middle_pitch(tmp_path) -> None:
    (tone,) = read(tmp_path, "a.haptic", changed(HAPTIC, (*ENVELOPES, "frequency"), None)).tones
    assert tone.pitch.at(np.array(0.2)) == 0.5


def test_haptic__frequency_that_outlasts_amplitude__is_refused_unless_legacy(tmp_path) -> None:
    late = changed(HAPTIC, (*ENVELOPES, "frequency", 1, "time"), 0.3001)
    with pytest.raises(BadInput, match=r"a point at 0.3001 s; allowed: up to the amplitude's end, 0.3 s.*--legacy"):
        read(tmp_path, "a.haptic", late)
    assert read(tmp_path, "a.haptic", late, legacy=True).duration_s == 0.3


POINTS = (*ENVELOPES, "amplitude")


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("version", "major"), 2, "major is 2; allowed: 1"),
        (("signals",), None, "signals is missing"),
        (POINTS, [], "0 points; allowed: two points or more"),
        (POINTS, [{"time": 0.0, "amplitude": 0.1}], "1 points"),
        (POINTS, [{"time": 0.0, "amplitude": 0.1}] * 2, "a duration of 0 s"),
        (POINTS, 3, "no list of tables"),
        ((*POINTS, 2, "time"), 0.05, "0.05 s after 0.1 s; allowed: times that do not decrease"),
        ((*POINTS, 0, "time"), -1.0, "time is -1; allowed: 0 to 600"),
        ((*POINTS, 1, "amplitude"), 1.5, r"amplitude\[1\]: amplitude is 1.5; allowed: 0 to 1"),
        ((*POINTS, 1, "amplitude"), "loud", "amplitude is 'loud'; allowed: a number"),
        ((*POINTS, 1, "amplitude"), True, "amplitude is True; allowed: a number"),
        ((*POINTS, 1, "emphasis", "amplitude"), 0.5, "amplitude is 0.5; allowed: the envelope's 0.6 or more"),
        ((*POINTS, 1, "emphasis", "amplitude"), -0.2, "amplitude is -0.2; allowed: 0 to 1"),
        ((*POINTS, 1, "emphasis", "frequency"), 1.1, "frequency is 1.1; allowed: 0 to 1"),
        ((*POINTS, 1, "emphasis"), 3, "emphasis: 3; allowed: a table"),
    ],
)
def test_haptic__rule_broken__is_refused_with_it(tmp_path, path, value, said) -> None:
    with pytest.raises(BadInput, match=f"a.haptic: .*{said}"):
        read(tmp_path, "a.haptic", changed(HAPTIC, path, value))


def test_ahap__controls__multiply_strength_and_add_to_sharpness_and_values_clamp(tmp_path) -> None:
    clip = read(tmp_path, "a.ahap", AHAP)
    (tone,), (tap,) = clip.tones, clip.taps
    np.testing.assert_allclose(tone.strength.at(np.array([0.0, 0.1, 0.2, 0.5])), [1.0, 1.0, 0.75, 0.5])
    np.testing.assert_allclose(tone.pitch.at(np.array([0.0, 0.4])), [0.7, 1.0])
    # the sharpness control "affects only continuous haptics" (Apple, on AHAP files): the tap keeps its default
    assert (tap.strength, tap.pitch, clip.duration_s) == (0.8, 0.5, 0.5)
    assert clip.clamped == 2  # an intensity of 2, and a sharpness of 1.3


def test_ahap__sound_and_unknown_parameters__are_passed_over_and_sound_alone_is_silent(tmp_path) -> None:
    sound = {"Event": {"Time": 0.0, "EventType": "AudioCustom"}}
    clip = read(tmp_path, "a.ahap", changed(AHAP, ("Pattern",), [sound, {"Parameter": {}}, *AHAP["Pattern"]]))
    assert clip.ignored == ("Pattern[0].Event", "Pattern[1].Parameter.None")
    silent = {"Version": 1, "Pattern": [{"Event": {"EventType": "AudioContinuous", "EventDuration": 0.5}}]}
    clip = read(tmp_path, "b.ahap", silent)
    assert (clip.duration_s, clip.tones, clip.taps) == (0.5, (), ())


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("Version",), 2.0, "Version is 2; allowed: 1 to 1"),
        (("Pattern",), None, "Pattern is missing"),
        (("Pattern",), [], "no haptic event"),
        (("Pattern", 1), {"ParameterCurves": {}}, r"Pattern\[1\]: ParameterCurves; allowed: Event, ParameterCurve"),
        (("Pattern", 1, "Event", "EventType"), "Buzz", "EventType is 'Buzz'"),
        (("Pattern", 1, "Event", "EventDuration"), None, "EventDuration is missing"),
        (("Pattern", 1, "Event", "Time"), -1.0, "Time is -1"),
        (("Pattern", 1, "Event", "EventDuratoin"), 1.0, r"EventDuratoin is not known \(did you mean 'EventDur"),
        (("Pattern", 1, "Event", "EventParameters", 1, "ParameterID"), "HapticSharpnes", "mean 'HapticSharpness'"),
        (("Pattern", 2, "ParameterCurve", "ParameterID"), "HapticIntensityContrl", "mean 'HapticIntensityControl'"),
    ],
)
def test_ahap__rule_broken__is_refused_with_it(tmp_path, path, value, said) -> None:
    with pytest.raises(BadInput, match=f"a.ahap: .*{said}"):
        read(tmp_path, "a.ahap", changed(AHAP, path, value))


def test_android__basic_and_advanced__begin_at_zero_and_reach_each_point_in_its_time(tmp_path) -> None:
    basic, advanced = read(tmp_path, "a.xml", BASIC), read(tmp_path, "b.xml", ADVANCED)
    assert (basic.format, basic.duration_s, advanced.format, advanced.pitch_in_hz) == (
        "android-basic", pytest.approx(0.2), "android-advanced", True,
    )  # fmt: skip
    np.testing.assert_allclose(basic.tones[0].strength.at(np.array([0.0, 0.05, 0.1, 0.15])), [0.0, 0.1, 0.2, 0.1])
    np.testing.assert_allclose(basic.tones[0].pitch.at(np.array([0.0, 0.1])), [0.3, 0.5])
    np.testing.assert_allclose(advanced.tones[0].pitch.at(np.array([0.0, 0.05])), [80.0, 80.0])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('intensity="0.0"', 'intensity="0.4"', "intensity is 0.4; allowed: 0 at the end"),
        ('intensity="0.2"', 'intensity="1.2"', "intensity is 1.2; allowed: 0 to 1"),
        ('durationMs="100"', 'durationMs="0"', "durationMs is 0"),
        ('durationMs="100"', 'durationMs="10.5"', "durationMs is 10.5; allowed: a whole number"),
        ('initialSharpness="0.3"', 'initialSharpness="1.3"', "initialSharpness is 1.3; allowed: 0 to 1"),
        ('initialSharpness="0.3">', 'initialSharpness="0.3">here', "text between its tags"),
        ('sharpness="0.5" d', "d", "sharpness is missing"),
        ('sharpness="0.5" d', 'colour="1" d', "colour is not a key that is known"),
        ('intensity="0.2"', 'intensity="nan"', "intensity is 'nan'; allowed: a number"),
        ('frequencyHz="80"', 'frequencyHz="0"', "frequencyHz is 0; allowed"),
        ("basic-envelope-effect", "waveform-effect", "allowed: vibration-effect with one of"),
        ("<vibration-effect>", "<vibration-effect", "it is not XML"),
        ("<vibration-effect>", "<!DOCTYPE a><vibration-effect>", "a document type or entity"),
    ],
)
def test_android__rule_broken__is_refused_with_it(tmp_path, old, new, said) -> None:
    with pytest.raises(BadInput, match=f"a.xml: .*{said}"):
        read(tmp_path, "a.xml", (ADVANCED if "frequencyHz" in old else BASIC).replace(old, new))


def test_clip__of_no_known_ending__is_refused(tmp_path) -> None:
    with pytest.raises(BadInput, match=r"allowed: .haptic, .ahap, .xml"):
        read(tmp_path, "a.json", HAPTIC)


def test_android__more_than_every_device_plays__is_told(tmp_path) -> None:
    point = '<control-point amplitude="0.5" frequencyHz="80" durationMs="{}" />'
    points = "".join(point.format(ms) for ms in (10, 1500, *[20] * 15))
    clip = read(tmp_path, "a.xml", ADVANCED.replace("<control", points + "<control", 1))
    assert [line.split(";")[0] for line in clip.unsure] == [
        "18 control points", "a step of 10 ms", "a step of 1500 ms", "an end at 0.5",
    ]  # fmt: skip
    assert read(tmp_path, "b.xml", BASIC).unsure == ()


def test_ahap__as_tutorials_write_it__is_read_by_the_documented_defaults(tmp_path) -> None:
    """Keys that are missing, whole numbers, sound, dynamic parameters, shaping, a byte-order mark, thirty seconds."""
    sound = {"EventType": "AudioCustom", "EventWaveformPath": "a/b.caf", "Time": 0.25, "Priority": 1}
    long = {"EventType": "HapticContinuous", "Duration": 40, "Priority": 2, "EventParameters": [
        {"ParameterID": "HapticIntensity", "Value": 1}, {"ParameterID": "Sustained", "ParameterValue": 0}]}  # fmt: skip
    halved = {"ParameterID": "HapticIntensityControl", "ParameterValue": 0.5, "Time": 2.0}
    rising = {"ParameterID": "HapticIntensityControl", "Time": 4, "ParameterCurveControlPoints": [
        {"Time": 0, "ParameterValue": 1}, {"Time": 1, "ParameterValue": 0}]}  # fmt: skip
    document = {"Metadata": {"Project": "x"}, "Pattern": [
        {"Event": sound}, {"Event": long}, {"Event": {"EventType": "HapticTransient"}}, {"Parameter": halved},
        {"ParameterCurve": rising}]}  # fmt: skip
    clip = read(tmp_path, "a.ahap", "\ufeff" + json.dumps(document))
    (tone,), (tap,) = clip.tones, clip.taps
    assert (tap.time_s, tap.strength, tap.pitch, tone.end_s, clip.clamped) == (0.0, 1.0, 0.5, 30.0, 1)
    at = np.array([0.0, 1.9, 2.1, 3.9, 4.0, 4.5, 9.0])  # held between, from the parameter to the curve
    np.testing.assert_allclose(tone.strength.at(at), [1.0, 1.0, 0.5, 0.5, 1.0, 0.5, 0.0])
    assert clip.ignored == ("Metadata", "Pattern[0].Event", "Pattern[1].Event.Priority")
    assert clip.unrendered == ("Sustained",)


TEXTS = {"a.haptic": json.dumps(HAPTIC), "a.ahap": json.dumps(AHAP), "a.xml": BASIC, "a.hjif": json.dumps(HJIF)}
TEXTS |= {"a.acf": ACF, "a.csv": "frequency_hz,acceleration_g\n30,0.3\n60,0.6\n90,1.2\n"}


@given(st.sampled_from(sorted(TEXTS)), st.data())
def test_clip__any_alteration__is_read_or_refused(tmp_path_factory, name, data) -> None:
    text, path = TEXTS[name], tmp_path_factory.getbasetemp() / name
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 20)))
    put = data.draw(st.sampled_from(["", "0", "-1", "1e400", "[", "{}", "null", '"', "NaN", "<a/>", "9" * 400]))
    path.write_text(text[:start] + put + text[end:])
    try:
        made = {".acf": read_acf, ".csv": read_profile}.get(path.suffix, read_clip)(path)
    except BadInput:
        return
    assert not isinstance(made, Clip) or 0.0 <= made.duration_s <= 1200.0
