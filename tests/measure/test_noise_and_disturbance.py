"""Felt noise against what the finger port really feels; rejection against S."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.measure.disturbance import disturbance
from tactuator.measure.noise import felt_noise, felt_of_command, noise_verdict, proportional_controller, sensor_noise
from tactuator.model.description import Converter
from tactuator.model.verdict import Outcome
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.spectra import lock_in, power_spectrum
from tests.measure.loops import FULL, PLANT, QUIETER, RATE_HZ, controller, display, loaded, loop_response


@pytest.fixture(scope="module")
def probed():
    """Gain to (what was said, what the finger port felt in mm)."""
    made = {}
    described = display()
    for gain in (8.0, 16.0, 32.0, 60.0):
        rig = loaded(proportional_controller(described, gain), 3)
        felt: list[np.ndarray] = []
        rig.finger("index").attach(felt.append)
        made[gain] = (felt_noise(rig, described)[0], np.concatenate(felt)[8000:])
    return made


def test_felt_noise__lines__as_the_finger_feels_them(probed) -> None:
    curve = display().channels[0].threshold.curve
    for said, felt in probed.values():
        truth = 20.0 * np.log10(
            np.abs(lock_in(felt, [60.0, 120.0, 180.0], RATE_HZ)) / curve.displacement_mm([60.0, 120.0, 180.0])
        )
        np.testing.assert_allclose(said.line_db_sl[:3], truth, atol=0.5)


def test_felt_noise__sensor__what_the_simulated_display_has(probed) -> None:
    """Told apart from the motion at every gain, though the loop moves the sensor at 60 Hz by more than its hum."""
    stated = display().channels[0].environment
    for said, _ in probed.values():
        assert said.sensor.hum_hz.tolist() == list(stated.hum_hz)
        np.testing.assert_allclose(said.sensor.hum_v_peak, stated.hum_v_peak, rtol=0.1)
        assert said.sensor.noise_v_rms == pytest.approx(stated.noise_v_rms, rel=0.1)


@pytest.mark.parametrize("bits", [12, 16])
def test_noise_verdict__sensor_that_reads_nothing__is_not_judged(bits: int) -> None:
    described = display()
    quiet = replace(described.channels[0], converter=Converter(bits=bits))
    described = replace(described, channels=(quiet,))
    rig = loaded(controller(described), 3)
    verdict = noise_verdict(felt_noise(rig, described, duration_s=4.0), described)
    hum = [finding for finding in verdict.objectives[1].findings if "reads nothing" in finding.remark]
    assert bool(hum) == (verdict.outcome is Outcome.NOT_JUDGED) == (bits == 12)
    assert "amplifier off" in verdict.assumptions[0]


@pytest.mark.parametrize(("hertz", "motor_v", "opens"), [(60.0, 0.02, "ii"), (87.0, 0.03, "iii"), (60.0, 0.0, "")])
def test_noise_verdict__what_comes_in_at_the_motor__is_not_judged_as_the_sensors(
    hertz: float, motor_v: float, opens: str
) -> None:
    """An outsider's amplifier hummed: told was -7.9 dB SL, met, and felt +3.2."""
    described, rig = QUIETER.display, loaded(QUIETER, 3)
    rig.finger("index").press(motor_v * np.sin(2.0 * np.pi * hertz * np.arange(44_000) / RATE_HZ))
    felt: list[np.ndarray] = []
    rig.finger("index").attach(felt.append)
    (heard,) = felt_noise(rig, described)
    judged = noise_verdict([heard], described).objectives
    assert [each.number for each in judged if each.outcome is not Outcome.MET] == [opens][: bool(opens)]
    if opens:
        peak_mm = np.abs(lock_in(np.concatenate(felt)[8000:40_000], [hertz], RATE_HZ)[0])
        true = 20.0 * np.log10(peak_mm / described.channels[0].threshold.curve.displacement_mm(hertz))
        told = heard.line_db_sl[0], heard.line_moved_db_sl[0]
        if opens == "iii":
            band = int(np.argmin(np.abs(heard.band_hz / hertz - 1.0)))
            told = heard.band_db_sl[band], heard.band_moved_db_sl[band]
        assert told[0] < 0.0 < true <= told[1] + 2.0
        (finding,) = (each for each in judged[opens == "iii"].findings if each.outcome is Outcome.NOT_JUDGED)
        assert f"{told[0]:.1f} dB SL if it comes in at the sensor, {told[1]:.1f} if at the motor" in finding.remark


def test_sensor_noise__no_mains__no_lines_and_the_noise() -> None:
    rng = np.random.default_rng(1)
    channel = display().channels[0]
    reading = 1e-3 * rng.standard_normal(40_000)
    found = sensor_noise(reading, np.zeros(40_000), RATE_HZ, channel, PLANT, None)
    assert found.hum_hz.size == 0
    assert found.noise_v_rms == pytest.approx(1e-3, rel=0.05)
    assert sensor_noise(reading, np.zeros(40_000), RATE_HZ, channel, PLANT).hum_hz.size == 0


def test_felt_noise__rising_gain__resonance_rises_in_level_and_frequency(probed) -> None:
    frequency = [said.resonance_hz for said, _ in probed.values()]
    level = [said.resonance_db_sl for said, _ in probed.values()]
    assert all(one is not None for one in frequency)
    assert frequency == sorted(frequency)
    assert level == sorted(level)
    lines = [said.worst_line_db_sl for said, _ in probed.values()]
    assert lines == sorted(lines)
    assert lines[0] < 0.0 < lines[-1]


def test_felt_noise__third_octaves__as_the_finger_feels_them(probed) -> None:
    said, felt = probed[60.0]
    spectrum = power_spectrum(felt, RATE_HZ, 1.0)
    curve = display().channels[0].threshold.curve
    for centre, level in zip(said.band_hz, said.band_db_sl, strict=True):
        if 40.0 < centre < 110.0:
            edge = 10.0**0.05
            peak_mm = np.sqrt(2.0 * spectrum.power(centre / edge, centre * edge, said.line_hz))
            assert level == pytest.approx(20.0 * np.log10(peak_mm / curve.displacement_mm(centre)), abs=0.6)


def test_felt_of_command__known_sinusoid__has_the_level_of_the_hand_calculation() -> None:
    channel = display().channels[0]
    command = 0.01 * np.sin(2.0 * np.pi * 120.0 * np.arange(16000) / RATE_HZ)
    said = felt_of_command(command, RATE_HZ, channel, PLANT)
    millimetres = 0.01 * 2875.0 / abs((2j * np.pi * 120.0) ** 2 + 94.0 * 2j * np.pi * 120.0 + 290.0) / 0.19898
    expected = 20.0 * np.log10(millimetres / float(channel.threshold.curve.displacement_mm(120.0)))
    # the hold between samples takes 0.013 dB at 120 Hz
    assert said.line_db_sl[1] == pytest.approx(expected, abs=0.02)
    with pytest.raises(BadInput, match="3 s or more"):
        felt_noise(SimulatedRig(display(), 0), display(), duration_s=1.0)
    with pytest.raises(BadInput, match="positive"):
        proportional_controller(display(), 0.0)


def test_disturbance__paper_loop__rejects_as_s_says() -> None:
    made, rig = FULL, loaded(FULL, 5)
    frequency = np.array([0.5, 2.0, 10.0, 30.0, 100.0])
    report = disturbance(rig, rig.finger("index"), made, "index", frequency, np.random.default_rng(0))
    _, sensitivity = loop_response(made, frequency)
    np.testing.assert_allclose(report.rejection.expected_db, 20.0 * np.log10(np.abs(sensitivity)), atol=1e-6)
    np.testing.assert_allclose(report.rejection.measured_db, report.rejection.expected_db, atol=0.4)
    assert report.tremor.rejection_db == pytest.approx(report.tremor.expected_db, abs=0.3)
    assert report.tremor.without_loop_mm == pytest.approx(1.0, rel=1e-6)
    # without the loop a second's press moves a millimetre; with it, hundredths, soon gone
    assert report.press.without_loop_mm > 0.9
    assert report.press.peak_mm < 0.05
    assert report.press.left_mm < 0.1 * report.press.peak_mm
    assert report.press.recovery_s < 0.8
    with pytest.raises(BadInput, match="excursion"):
        disturbance(rig, rig.finger("index"), made, "index", frequency, np.random.default_rng(0), excursion_mm=0.0)
