"""What is given to others: a display's profile, configuration and sheet; a reference as a clip, with its loss."""

import json

import numpy as np
import pytest
import soundfile

from tactuator.cli.main import main
from tactuator.io.controller import write_controller
from tactuator.io.reference import ReferenceHead, curves_of, write_reference
from tactuator.measure.error import ChannelPrediction
from tactuator.patterns.acf import read_acf
from tactuator.patterns.android import read_profile
from tactuator.patterns.device import device_sheet
from tactuator.patterns.files import read_clip
from tactuator.signals.record import Response

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


def told(capsys):
    return json.loads(capsys.readouterr().out)


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


def test_export__of_a_display__is_a_profile_a_configuration_and_a_sheet(tmp_path, held, controller, capsys) -> None:
    for ending in ("csv", "acf", "md"):
        assert main(["export", str(held), "--out", str(tmp_path / f"a.{ending}"), "--channel", "index", "--json"]) == 0
        assert told(capsys)["sheet"]["channel"] == "index"
    sheet = device_sheet(controller, "index")
    np.testing.assert_allclose(read_profile(tmp_path / "a.csv").acceleration_g, sheet.acceleration_g, rtol=1e-5)
    assert read_acf(tmp_path / "a.acf") == sheet.map
    text = (tmp_path / "a.md").read_text()
    assert all(words in text for words in ("g peak", "dB SL", "Rise", "Amplitude JND", "Frequency JND", "Hz"))


@pytest.mark.parametrize("ending", ["haptic", "ahap"])
def test_export__of_a_tone__is_a_clip_that_has_its_level_and_pitch(tmp_path, reference, capsys, ending) -> None:
    out = tmp_path / f"a.{ending}"
    assert main(["export", str(reference), "--out", str(out), "--json"]) == 0
    answer = told(capsys)
    loss = answer["loss"]
    assert loss["level_rms_db"] < 0.3
    assert loss["frequency_shift_jnd"] < 0.1
    assert loss["carried"] > 0.99
    (tone,), low, high = read_clip(out).tones, *((55.0, 200.0) if ending == "haptic" else (65.0, 300.0))
    assert low + (high - low) * tone.pitch.at(np.array(1.0)) == pytest.approx(110.0, abs=1.0)
    full = float(answer["strength_1"].split()[0])
    assert full + 20.0 * np.log10(tone.strength.at(np.array(1.0))) == pytest.approx(25.0, abs=0.3)


def test_export__of_two_tones_at_once__says_that_one_is_lost_and_ends_with_1_where_that_is_too_much(
    tmp_path, reference, capsys
) -> None:
    asked = ["export", str(reference), "--channel", "thumb", "--out", str(tmp_path / "a.haptic"), "--json"]
    assert main([*asked, "--most-loss", "20"]) == 0
    assert told(capsys)["loss"]["carried"] < 0.7
    assert main([*asked, "--most-loss", "0"]) == 1


def test_export__as_acceleration__is_the_acceleration_that_the_curve_says(
    tmp_path, reference, controller, capsys
) -> None:
    assert main(["export", str(reference), "--out", str(tmp_path / "b.wav"), "--json"]) == 0
    answer = told(capsys)
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
def test_export__what_does_not_fit__is_refused(tmp_path, held, reference, capsys, source, out, said) -> None:
    (tmp_path / "a.txt").write_text("nothing")
    assert main(["export", str(tmp_path / source), "--out", str(tmp_path / out)]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / out).exists()
