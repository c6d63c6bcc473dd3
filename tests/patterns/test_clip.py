"""Clips of other formats: what they ask for, every rule that one can break, and hostile files in bounded memory."""

import json
import random
import re
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.patterns.acf import read_acf
from tactuator.patterns.android import read_profile
from tactuator.patterns.clip import Clip
from tactuator.patterns.files import read_clip
from tactuator.patterns.hjif import parse_hjif
from tests.patterns.formats import ACF, HJIF, LIMITS, changed

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


def test_haptic__points__are_strength_pitch_and_taps_and_a_late_frequency_is_refused_unless_legacy(tmp_path) -> None:
    clip = read(tmp_path, "knock.haptic", HAPTIC)
    (tone,), (tap,) = clip.tones, clip.taps
    assert (clip.name, clip.format, clip.duration_s, clip.pitch_in_hz) == ("knock.haptic", "haptic", 0.3, False)
    np.testing.assert_allclose(tone.strength.at(np.array([0.0, 0.05, 0.2])), [0.2, 0.4, 0.3])
    np.testing.assert_allclose(tone.pitch.at(np.array([0.1, 0.3])), [0.4, 0.6])  # held after its end
    assert (tap.time_s, tap.strength, tap.pitch) == (0.1, 0.9, 0.7)
    (tone,) = read(tmp_path, "a.haptic", changed(HAPTIC, (*ENVELOPES, "frequency"), None)).tones
    assert tone.pitch.at(np.array(0.2)) == 0.5
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


def test_ahap__controls_and_sound__multiply_add_and_clamp_or_are_passed_over(tmp_path) -> None:
    clip = read(tmp_path, "a.ahap", AHAP)
    (tone,), (tap,) = clip.tones, clip.taps
    np.testing.assert_allclose(tone.strength.at(np.array([0.0, 0.1, 0.2, 0.5])), [1.0, 1.0, 0.75, 0.5])
    np.testing.assert_allclose(tone.pitch.at(np.array([0.0, 0.4])), [0.7, 1.0])
    # the sharpness control "affects only continuous haptics" (Apple, on AHAP files): the tap keeps its default
    assert (tap.strength, tap.pitch, clip.duration_s) == (0.8, 0.5, 0.5)
    assert clip.clamped == 2  # an intensity of 2, and a sharpness of 1.3
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


def test_android__envelopes__begin_at_zero_reach_each_point_and_tell_what_not_every_device_plays(tmp_path) -> None:
    basic, advanced = read(tmp_path, "a.xml", BASIC), read(tmp_path, "b.xml", ADVANCED)
    assert (basic.format, basic.duration_s, advanced.format, advanced.pitch_in_hz) == (
        "android-basic", pytest.approx(0.2), "android-advanced", True,
    )  # fmt: skip
    np.testing.assert_allclose(basic.tones[0].strength.at(np.array([0.0, 0.05, 0.1, 0.15])), [0.0, 0.1, 0.2, 0.1])
    np.testing.assert_allclose(basic.tones[0].pitch.at(np.array([0.0, 0.1])), [0.3, 0.5])
    np.testing.assert_allclose(advanced.tones[0].pitch.at(np.array([0.0, 0.05])), [80.0, 80.0])
    point = '<control-point amplitude="0.5" frequencyHz="80" durationMs="{}" />'
    points = "".join(point.format(ms) for ms in (10, 1500, *[20] * 15))
    clip = read(tmp_path, "a.xml", ADVANCED.replace("<control", points + "<control", 1))
    assert [line.split(";")[0] for line in clip.unsure] == [
        "18 control points", "a step of 10 ms", "a step of 1500 ms", "an end at 0.5",
    ]  # fmt: skip
    assert read(tmp_path, "b.xml", BASIC).unsure == ()
    with pytest.raises(BadInput, match=r"allowed: .haptic, .ahap, .xml"):
        read(tmp_path, "a.json", HAPTIC)


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


def altered(path, value):
    return json.dumps(changed(HJIF, path, value))


PERCEPTION = ("perceptions", 0)
CHANNEL = (*PERCEPTION, "channels", 0)
BAND = (*CHANNEL, "bands", 1)


def test_hjif__effects__are_taps_and_tones_in_hertz_by_the_timescale_and_others_are_told() -> None:
    clip = parse_hjif(json.dumps(HJIF))
    assert (clip.format, clip.pitch_in_hz, clip.duration_s, clip.unrendered) == ("hjif", True, 1.5, ())
    (tap,), (first, second) = clip.taps, clip.tones
    assert (tap.time_s, tap.strength) == (0.1, 0.25)  # a gain of a half
    assert (first.start_s, first.end_s, second.start_s, second.end_s) == (0.2, 0.7, 1.0, 1.5)
    np.testing.assert_allclose(first.strength.at(np.array([0.2, 0.45, 0.7])), [0.25, 0.375, 0.5])
    np.testing.assert_allclose(first.pitch.at(np.array([0.2, 0.325, 0.7])), [90.0, 195.0, 300.0])  # the band's end
    assert parse_hjif(altered(("timescale",), 500)).duration_s == 3.0
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


PROFILE = "frequency_hz,acceleration_g\n" + "".join(f"{hertz},{hertz / 100}\n" for hertz in range(30, 301, 10))
GOOD = {
    **{f"a.{kind}": json.dumps(file, indent=1) for kind, file in (("haptic", HAPTIC), ("ahap", AHAP), ("hjif", HJIF))},
    "a.xml": BASIC, "a.acf": ACF, "a.csv": PROFILE,
}  # fmt: skip
MOST_KB = 700_000
CHILD = """
import resource, sys
from pathlib import Path
from tactuator.errors import BadInput
from tactuator.patterns.acf import read_acf
from tactuator.patterns.android import read_profile
from tactuator.patterns.files import read_clip
soft = int(sys.argv[2]) * 1024
resource.setrlimit(resource.RLIMIT_DATA, (soft, soft))
read = {".acf": read_acf, ".csv": read_profile}
lines = answers = 0
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        read.get(path.suffix, read_clip)(path)
        answers += 1
    except BadInput as error:
        assert "\\n" not in str(error) and len(str(error)) < 1000, path
        lines += 1
own = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))  # ru_maxrss has the parent's too
print(answers, lines, own.split()[1])
"""


def long(good, rng):
    """A part that stands very often: up to some megabytes of it."""
    places = list(re.finditer(r"\{[^{}]*\}|<control[^>]*>|\n[\d.,]+", good))
    place = rng.choice(places)
    joint = "," if place[0].startswith("{") else ""
    times = rng.choice([1000, 100_001, 6_000_000 // len(place[0])])
    return good[: place.start()] + joint.join([place[0]] * times) + good[place.end() :]


def nested(good, rng):
    at, deep = rng.randrange(len(good)), rng.choice([50, 5000, 1_000_000])
    opened = rng.choice(["[", "{", '{"a":', "<a>", "/*", "'", "\\"])
    return good[:at] + opened * deep + good[at:]


def spoilt(good, rng):
    content = bytearray(good.encode())
    for _ in range(rng.randint(1, 16)):
        content[rng.randrange(len(content))] = rng.randrange(256)
    return bytes(content)


def encoded(good, rng):
    kind = rng.choice(["utf-16", "utf-8-sig", "utf-32", "utf-7", "cp500", "utf-16-be"])
    return good.encode(kind)


def swollen(good, rng):
    """Little that becomes much where it is taken apart: spaces, a string, numbers, entities."""
    much = rng.choice([" " * 11_000_000, '"' + "a" * 11_000_000 + '"', "[" + "0," * 5_000_000 + "0]",
                       "[" + "{}," * 3_000_000 + "{}]", "&#65;" * 2_000_000, "a" * 13_000_000])  # fmt: skip
    at = rng.randrange(len(good))
    return good[:at] + much + good[at:]


HARM = (long, nested, spoilt, encoded, swollen)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(GOOD))
@pytest.mark.parametrize("count", [5, pytest.param(200, marks=pytest.mark.soak)])
def test_hostile__many_files__each_ends_in_an_answer_or_a_line_in_bounded_memory(tmp_path, name, count) -> None:
    rng = random.Random(name)
    for number in range(count):
        content = HARM[number % len(HARM)](GOOD[name], rng)
        path = tmp_path / f"{number:03}{name[1:]}"
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
    command = [sys.executable, "-c", CHILD, str(tmp_path), str(2 * MOST_KB)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert (done.returncode, done.stderr) == (0, "")
    answers, lines, most_kb = map(int, done.stdout.split())
    assert answers + lines == count
    assert lines >= count // 4  # most harm is noticed; what is not, is a file that keeps the rules
    assert most_kb < MOST_KB
