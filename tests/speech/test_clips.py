"""Clips of other formats: what they ask for, every rule that one can break, and hostile files in bounded memory."""

import copy
import json
import random
import re
import subprocess
import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.io.display import parse_display
from tactuator.io.shipped import display_template
from tactuator.speech.clip import Breakpoints, Clip, Tap, Tone
from tactuator.speech.clip_signal import clip_signal, read_clip
from tactuator.speech.limiter import Limiter
from tactuator.synthesis.design import design_controller

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


def changed(document, path, value):
    """A copy of the document with another value at a path; None takes the key away."""
    document = copy.deepcopy(document)
    part = document
    for key in path[:-1]:
        part = part[key]
    if value is None:
        del part[path[-1]]
    else:
        part[path[-1]] = value
    return document


def read(tmp_path, name, content, **how) -> Clip:
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return read_clip(path, **how)


def test_haptic__points__are_strength_pitch_and_taps(tmp_path) -> None:
    clip = read(tmp_path, "knock.haptic", HAPTIC)
    (tone,), (tap,) = clip.tones, clip.taps
    assert (clip.format, clip.duration_s) == ("haptic", 0.3)
    np.testing.assert_allclose(tone.strength.at(np.array([0.0, 0.05, 0.2])), [0.2, 0.4, 0.3])
    np.testing.assert_allclose(tone.pitch.at(np.array([0.1, 0.3])), [0.4, 0.6])  # held after its end
    assert (tap.time_s, tap.strength, tap.pitch) == (0.1, 0.9, 0.7)
    (tone,) = read(tmp_path, "a.haptic", changed(HAPTIC, (*ENVELOPES, "frequency"), None)).tones
    assert tone.pitch.at(np.array(0.2)) == 0.5
    late = changed(HAPTIC, (*ENVELOPES, "frequency", 1, "time"), 0.3001)
    with pytest.raises(BadInput, match=r"a point at 0.3001 s; expected up to the amplitude's end, 0.3 s.*`legacy`"):
        read(tmp_path, "a.haptic", late)
    assert read(tmp_path, "a.haptic", late, legacy=True).duration_s == 0.3


POINTS = (*ENVELOPES, "amplitude")


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("version", "major"), 2, "major is 2; it must be 1"),
        (("signals",), None, "signals is missing"),
        (POINTS, [], "0 points; expected two points or more"),
        (POINTS, [{"time": 0.0, "amplitude": 0.1}], "1 points"),
        (POINTS, [{"time": 0.0, "amplitude": 0.1}] * 2, "a duration of 0 s"),
        (POINTS, 3, "no list of tables"),
        ((*POINTS, 2, "time"), 0.05, "0.05 s after 0.1 s; expected times that do not decrease"),
        ((*POINTS, 0, "time"), -1.0, "time is -1; it must be 0 to 600"),
        ((*POINTS, 1, "amplitude"), 1.5, r"amplitude\[1\]: amplitude is 1.5; it must be 0 to 1"),
        ((*POINTS, 1, "amplitude"), "loud", "amplitude is 'loud'; it must be a number"),
        ((*POINTS, 1, "amplitude"), True, "amplitude is True; it must be a number"),
        ((*POINTS, 1, "emphasis", "amplitude"), 0.5, "amplitude is 0.5; it must be the envelope's 0.6 or more"),
        ((*POINTS, 1, "emphasis", "amplitude"), -0.2, "amplitude is -0.2; it must be 0 to 1"),
        ((*POINTS, 1, "emphasis", "frequency"), 1.1, "frequency is 1.1; it must be 0 to 1"),
        ((*POINTS, 1, "emphasis"), 3, "emphasis: 3; expected a table"),
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
        (("Version",), 2.0, "Version is 2; it must be 1 to 1"),
        (("Pattern",), None, "Pattern is missing"),
        (("Pattern",), [], "no haptic event"),
        (("Pattern", 1), {"ParameterCurves": {}}, r"Pattern\[1\]: ParameterCurves; expected Event, ParameterCurve"),
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


TEXTS = {"a.haptic": json.dumps(HAPTIC), "a.ahap": json.dumps(AHAP)}


@given(st.sampled_from(sorted(TEXTS)), st.data())
def test_clip__any_alteration__is_read_or_refused(tmp_path_factory, name, data) -> None:
    text, path = TEXTS[name], tmp_path_factory.getbasetemp() / name
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 20)))
    put = data.draw(st.sampled_from(["", "0", "-1", "1e400", "[", "{}", "null", '"', "NaN", "<a/>", "9" * 400]))
    path.write_text(text[:start] + put + text[end:])
    try:
        assert 0.0 <= read_clip(path).duration_s <= 600.0
    except BadInput:
        return


GOOD = {name: json.dumps(json.loads(text), indent=1) for name, text in TEXTS.items()}
MOST_KB = 700_000
CHILD = """
import resource, sys
from pathlib import Path
from tactuator.errors import BadInput
from tactuator.speech.clip_signal import read_clip
soft = int(sys.argv[2]) * 1024
resource.setrlimit(resource.RLIMIT_DATA, (soft, soft))
lines = answers = 0
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        read_clip(path)
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


def steady(strength, pitch, taps=(), format="haptic"):
    courses = [Breakpoints(np.zeros(1), np.array([float(value)])) for value in (strength, pitch)]
    return Clip(format, 1.0, (Tone(0.0, 1.0, *courses),), tuple(taps))


def rendered(clip, controller, level_db_sl=35.0):
    """The reference within the display's limits, and what is lost."""
    signal = clip_signal(clip, controller, level_db_sl)
    reference = np.concatenate(list(Limiter(controller).process(signal.blocks)))
    return reference, signal.loss(reference)


@pytest.mark.parametrize(
    ("clip", "hertz", "level_db_sl"),
    [
        (steady(1.0, 0.5), 127.5, 30.0),
        (steady(0.1, 0.0), 55.0, 10.0),
        (steady(0.5, 1.0, format="ahap"), 300.0, 30.0 - 6.0206),
    ],
)
def test_clip_signal__steady_tone__has_its_level_and_the_frequency_of_the_format(controller, clip, hertz, level_db_sl):
    reference, loss = rendered(clip, controller, 30.0)
    count = round(0.5 * controller.rate_hz)
    middle = reference[count // 2 : count // 2 + count]
    turn = np.exp(-2j * np.pi * hertz / controller.rate_hz * np.arange(count)) * np.hanning(count)
    amplitudes = np.abs(turn @ middle) * 2.0 / np.hanning(count).sum()
    np.testing.assert_allclose(20.0 * np.log10(amplitudes), level_db_sl, atol=0.02)
    assert (loss.shortfall_db_sl, loss.clipped_s, loss.frequency_shift_jnd) == (0.0, 0.0, 0.0)


def test_clip_signal__tap_or_pitch_or_level_beyond__rises_is_moved_or_refused(controller) -> None:
    _, loss = rendered(steady(0.5, 0.5, [Tap(0.4, 1.0, 0.5)]), controller)
    asked, delivered = loss.emphasis_rise_db
    assert asked == delivered
    assert 6.0 < asked < 15.0  # 1 and a quarter against a quarter, however the two meet
    channels = [replace(c, threshold=replace(c.threshold, band_hz=(0.4, 150.0))) for c in controller.display.channels]
    narrow = replace(controller, display=replace(controller.display, channels=tuple(channels)))
    _, loss = rendered(steady(0.5, 1.0), narrow)
    assert loss.frequency_shift_jnd == pytest.approx(np.log(200.0 / 150.0) / np.log(1.13))
    with pytest.raises(BadInput):
        clip_signal(steady(1.0, 0.5), controller, 60.0)


@pytest.fixture(scope="module")
def lra():
    return design_controller(parse_display(tomllib.loads(display_template("lra"))))


def test_loss__more_than_a_resonant_actuator_gives__is_how_far_it_falls_short(lra) -> None:
    reference, loss = rendered(steady(1.0, 0.0), lra, 50.0)
    middle = slice(len(loss.time_s) // 3, len(loss.time_s) // 2)
    given = np.abs(reference[len(reference) // 3 : len(reference) // 2]).max()
    assert np.median(loss.asked_db_sl[middle] - loss.delivered_db_sl[middle]) == pytest.approx(
        50.0 - 20.0 * np.log10(given), abs=0.5
    )
    assert loss.shortfall_db_sl > 20.0
    assert loss.clipped_s > 0.9
    assert rendered(steady(1.0, 0.0), lra, 5.0)[1].shortfall_db_sl == 0.0


def test_render__clip__ends_with_1_where_more_is_lost_than_allowed(tmp_path, lra, run):
    clip, at = tmp_path / "knock.haptic", tmp_path / "lra.json"
    clip.write_text(json.dumps(HAPTIC))
    write_controller(at, lra)
    asked = ("render", clip, "--controller", at, "--out", tmp_path / "a.wav")
    told = run.json(*asked, "--level", "5", "--felt", tmp_path / "felt.wav")
    assert (told["format"], told["pitch_hz"], told["met"]) == ("haptic", [55.0, 200.0], True)
    assert set(told["loss"]) == {"shortfall_db_sl", "clipped_s", "frequency_shift_jnd", "emphasis_rise_db"}
    assert set(told["felt"]) == set(told["limiter"]) == {"index"}
    lost = run.json(*asked, "--level", "54", "--figures", tmp_path / "f", status=1)["loss"]
    assert lost["shortfall_db_sl"] > 3.0
    assert (tmp_path / "f" / "knock.svg").exists()
    run.refused(*asked, "--coding", "bands", said="--coding with")


def test_haptic__impulse_of_no_length__is_told(controller, tmp_path):
    points = [(0.0, 0.2), (0.5, 0.2), (0.5, 1.0), (0.5, 0.2), (1.0, 0.2)]
    envelope = [{"time": time_s, "amplitude": amplitude} for time_s, amplitude in points]
    document = {"version": {"major": 1}, "signals": {"continuous": {"envelopes": {"amplitude": envelope}}}}
    path = tmp_path / "a.haptic"
    path.write_text(json.dumps(document))
    assert "not rendered: an impulse of no length at 0.5 s" in clip_signal(read_clip(path), controller, 30.0).notes
    envelope[3]["time"] = 0.51
    path.write_text(json.dumps(document))
    assert clip_signal(read_clip(path), controller, 30.0).notes == ()
