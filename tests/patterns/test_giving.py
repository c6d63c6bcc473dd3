"""Clips and displays: what is given to others with its loss, and what a clip becomes that a display does not give."""

import json
import tomllib

import numpy as np
import pytest
import soundfile

from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.io.display import parse_display
from tactuator.io.reference import ReferenceHead, curves_of, write_reference
from tactuator.io.shipped import display_template
from tactuator.measure.error import ChannelPrediction
from tactuator.patterns.acf import read_acf
from tactuator.patterns.android import read_profile
from tactuator.patterns.clip import Breakpoints, Clip, Tap, Tone
from tactuator.patterns.device import device_sheet
from tactuator.patterns.files import read_clip
from tactuator.patterns.rendering import MAPS, PatternMap, render_clip
from tactuator.signals.record import Response
from tactuator.synthesis.design import design_controller
from tests.patterns.test_clip import ADVANCED, HAPTIC

RATE_HZ, SECONDS = 4000.0, 2.0


@pytest.fixture
def held(tmp_path, controller):
    path = tmp_path / "controller.json"
    write_controller(path, controller)
    return path


@pytest.fixture
def reference(tmp_path, controller):
    """A tone from 80 to 140 Hz on one finger, at most 30 dB SL, and the same with a second tone on another."""
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    level = np.interp(time, [0.0, 0.5, 1.5, 2.0], [0.0, 30.0, 20.0, 0.0])
    wave = 10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * np.cumsum(80.0 + 30.0 * time) / RATE_HZ)
    two = 0.5 * wave + 0.5 * 10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * 250.0 * time)
    channels = controller.display.channels
    head = ReferenceHead(RATE_HZ, tuple(c.name for c in channels), curves_of(channels), (0.4, 300.0))
    path = tmp_path / "reference.wav"
    with write_reference(path, head) as writer:
        writer.write(np.stack([wave, two, np.zeros_like(wave)], axis=1))
    return path


def test_device_sheet__of_a_channel__is_what_its_limits_leave_and_its_model_gives(controller) -> None:
    """Oracle: the limit that is said to stop it, reached by the amplitude that is said, at every frequency."""
    sheet, channel = device_sheet(controller, "index"), controller.display.channel("index")
    prediction = ChannelPrediction.of(controller, "index")
    for hertz, moved_mm, limit, acceleration in zip(
        sheet.frequency_hz, sheet.displacement_mm, sheet.binding, sheet.acceleration_g, strict=True
    ):
        asked = moved_mm / abs(prediction.displacement(hertz))
        reached = {
            "travel": moved_mm / channel.travel_mm,
            "command": asked * abs(prediction.command(hertz)) / channel.converter.range_v,
            "comfort": max(asked, moved_mm / channel.threshold.curve.displacement_mm(hertz)) / 10.0 ** (55.0 / 20.0),
        }
        assert reached[limit] == pytest.approx(1.0, rel=1e-6)
        assert max(reached.values()) < 1.0 + 1e-6
        assert acceleration == pytest.approx(moved_mm * 1e-3 * (2.0 * np.pi * hertz) ** 2 / 9.80665)


def test_device_sheet__with_a_measured_response__has_the_measured_error(controller) -> None:
    hertz = np.array([20.0, 60.0, 200.0])
    prediction, gain = (
        ChannelPrediction.of(controller, "index"),
        controller.display.channel("index").sensor_gain_v_per_mm,
    )
    volts = 0.5 * prediction.displacement(hertz) * gain  # half of what the model says
    flags, nothing = np.ones(3, bool), np.zeros(3)
    response = Response(
        "index", "none", 20.0, "adaptive", hertz, volts, np.ones(3), nothing, nothing, nothing, ~flags, flags, nothing
    )
    plain, measured = device_sheet(controller, "index"), device_sheet(controller, "index", [response])
    assert (plain.measured, measured.measured) == (False, True)
    assert measured.frequency_hz[[0, -1]].tolist() == [20.0, 200.0]
    shared = [f for f in measured.frequency_hz if f in plain.frequency_hz and 20.0 < f < 200.0]
    for hertz_shared in shared:
        before, after = (s.level_db_sl[np.flatnonzero(s.frequency_hz == hertz_shared)[0]] for s in (plain, measured))
        assert before - after == pytest.approx(6.02, abs=0.6)  # between the measured frequencies it is interpolated


def test_export__of_a_display__is_a_profile_a_configuration_and_a_sheet(tmp_path, held, controller, run) -> None:
    for ending in ("csv", "acf", "md"):
        told = run.json("export", held, "--out", tmp_path / f"a.{ending}", "--channel", "index")
        assert told["sheet"]["channel"] == "index"
    sheet = device_sheet(controller, "index")
    np.testing.assert_allclose(read_profile(tmp_path / "a.csv").acceleration_g, sheet.acceleration_g, rtol=1e-5)
    assert read_acf(tmp_path / "a.acf") == sheet.map
    text = (tmp_path / "a.md").read_text()
    assert all(words in text for words in ("g peak", "dB SL", "Rise", "Amplitude JND", "Frequency JND", "Hz"))


@pytest.mark.parametrize("ending", ["haptic", "ahap"])
def test_export__of_a_tone__is_a_clip_that_has_its_level_and_pitch(tmp_path, reference, run, ending) -> None:
    out = tmp_path / f"a.{ending}"
    answer = run.json("export", reference, "--out", out)
    loss = answer["loss"]
    assert loss["level_rms_db"] < 0.3
    assert loss["frequency_shift_jnd"] < 0.1
    assert loss["carried"] > 0.99
    (tone,), low, high = read_clip(out).tones, *((55.0, 200.0) if ending == "haptic" else (65.0, 300.0))
    assert low + (high - low) * tone.pitch.at(np.array(1.0)) == pytest.approx(110.0, abs=1.0)
    full = float(answer["strength_1"].split()[0])
    assert full + 20.0 * np.log10(tone.strength.at(np.array(1.0))) == pytest.approx(25.0, abs=0.3)


def test_export__of_two_tones_or_as_acceleration__tells_its_loss_and_is_what_the_curve_says(
    tmp_path, reference, run, controller
) -> None:
    asked = ("export", reference, "--channel", "thumb", "--out", tmp_path / "a.haptic")
    assert run.json(*asked, "--most-loss", "20")["loss"]["carried"] < 0.7
    assert run(*asked, "--most-loss", "0").status == 1
    answer = run.json("export", reference, "--out", tmp_path / "b.wav")
    assert answer["loss"]["level_rms_db"] < 0.2
    samples, rate = soundfile.read(tmp_path / "b.wav")
    assert rate == RATE_HZ
    peak_g, name = float(answer["strength_1"].split()[0]), controller.display.channels[0].name
    middle = slice(round(0.98 * RATE_HZ), round(1.02 * RATE_HZ))  # 110 Hz at 25 dB SL
    threshold_mm = controller.display.channel(name).threshold.curve.displacement_mm(110.0)
    expected = 10.0 ** (25.0 / 20.0) * threshold_mm * 1e-3 * (2.0 * np.pi * 110.0) ** 2 / 9.80665
    assert peak_g * np.abs(samples[middle, 0]).max() == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("source", "out", "said"),
    [
        ("controller.json", "a.haptic", "ending '.haptic' for a controller; allowed: .csv, .acf, .md"),
        ("reference.wav", "a.md", "ending '.md' for a reference; allowed: .haptic, .ahap, .wav"),
        ("a.txt", "a.md", "neither a controller nor a reference"),
    ],
)
def test_export__what_does_not_fit__is_refused(tmp_path, held, reference, run, source, out, said) -> None:
    (tmp_path / "a.txt").write_text("nothing")
    run.refused("export", tmp_path / source, "--out", tmp_path / out, said=said)


def steady(strength, pitch, taps=(), format="haptic", pitch_in_hz=False, duration_s=1.0):
    courses = [Breakpoints(np.zeros(1), np.array([float(value)])) for value in (strength, pitch)]
    return Clip("steady", format, duration_s, (Tone(0.0, duration_s, *courses),), tuple(taps), pitch_in_hz)


@pytest.mark.parametrize(
    ("clip", "hertz", "level_db_sl"),
    [
        (steady(1.0, 0.5), 127.5, 30.0),
        (steady(0.1, 0.0), 55.0, 10.0),
        (steady(0.5, 1.0, format="ahap"), 300.0, 30.0 - 6.0206),
        (steady(0.5, 0.0, format="android-basic"), 65.0, 15.0),
        (steady(1.0, 80.0, format="android-advanced", pitch_in_hz=True), 80.0, 30.0),
    ],
)
def test_render__steady_tone__has_the_level_and_the_frequency_that_the_map_says(controller, clip, hertz, level_db_sl):
    mapping = PatternMap(**vars(MAPS[clip.format]) | {"full_db_sl": 30.0})
    rendered = render_clip(clip, controller, mapping)
    count = round(0.5 * controller.rate_hz)
    middle = rendered.reference[count // 2 : count // 2 + count]
    turn = np.exp(-2j * np.pi * hertz / controller.rate_hz * np.arange(count)) * np.hanning(count)
    amplitudes = np.abs(turn @ middle) * 2.0 / np.hanning(count).sum()
    np.testing.assert_allclose(20.0 * np.log10(amplitudes), level_db_sl, atol=0.02)
    assert (rendered.loss.shortfall_db_sl, rendered.loss.frequency_shift_jnd) == (0.0, 0.0)


def test_render__tap_pitch_or_level_beyond__rises_is_moved_in_noticed_differences_or_refused(controller) -> None:
    loss = render_clip(steady(0.5, 0.5, [Tap(0.4, 1.0, 0.5)]), controller).loss
    asked, delivered = loss.emphasis_rise_db
    assert asked == delivered
    assert 6.0 < asked < 15.0  # 1 and a quarter against a quarter, however the two meet
    loss = render_clip(steady(0.5, 600.0, format="android-advanced", pitch_in_hz=True), controller).loss
    assert loss.frequency_shift_jnd == pytest.approx(np.log(2.0) / np.log(1.13))
    with pytest.raises(BadInput):
        render_clip(steady(1.0, 0.5), controller, PatternMap(full_db_sl=60.0))


@pytest.fixture(scope="module")
def lra():
    return design_controller(parse_display(tomllib.loads(display_template("lra"))))


def test_render__more_than_a_resonant_actuator_gives__tells_how_far_it_falls_short(lra) -> None:
    loud = render_clip(steady(1.0, 0.0), lra, PatternMap(full_db_sl=50.0))
    quiet = render_clip(steady(1.0, 0.0), lra, PatternMap(full_db_sl=5.0))
    middle = np.abs(loud.reference[len(loud.reference) // 3 : len(loud.reference) // 2]).max()
    assert quiet.loss.shortfall_db_sl == 0.0
    assert loud.loss.mean_shortfall_db == pytest.approx(50.0 - 20.0 * np.log10(middle), abs=0.5)
    assert loud.loss.shortfall_db_sl > loud.loss.mean_shortfall_db > 20.0  # a beginning needs more than its tone
    assert loud.loss.clipped_s > 0.9


def test_render_verb__clip__writes_a_reference_and_ends_with_1_where_more_is_lost_than_allowed(tmp_path, lra, run):
    clip, at = tmp_path / "knock.haptic", tmp_path / "lra.json"
    clip.write_text(json.dumps(HAPTIC))
    write_controller(at, lra)
    asked = ("render", clip, "--controller", at, "--out", tmp_path / "a.wav")
    loss = run.json(*asked, "--level", "5")["loss"]
    assert {"shortfall_db_sl", "clipped_s", "frequency_shift_jnd"} <= set(loss)
    lost = run.json(*asked, "--level", "54", "--figures", tmp_path / "f", status=1)["loss"]
    assert lost["shortfall_db_sl"] > 3.0
    assert (tmp_path / "f" / "knock.svg").exists()
    assert run(*asked, "--coding", "bands").status == 2


def test_pattern_verb__clip__says_what_it_is_or_the_rule_that_it_breaks(tmp_path, run) -> None:
    clip = tmp_path / "a.xml"
    clip.write_text(ADVANCED)
    # valid, but a device need not play an envelope that does not end at 0: the answer is told, and does not hold
    told = run.json("pattern", clip, "--figures", tmp_path / "f", status=1)
    assert (told["format"], told["valid"], told["duration_s"]) == ("android-advanced", True, 0.05)
    assert told["unsure"] == ["an end at 0.5; sure: an end at 0"]
    ending = '<control-point amplitude="0" frequencyHz="80" durationMs="50" /></w'
    clip.write_text(ADVANCED.replace("</w", ending))
    assert run("pattern", clip).status == 0
    clip.write_text(ADVANCED.replace("0.5", "5"))
    run.refused("pattern", clip, said="amplitude is 5; allowed: 0 to 1")
