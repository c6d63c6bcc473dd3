"""Stepped sine and multisine against the loop's own response; felt noise against the finger port; rejection."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.measure.disturbance import disturbance
from tactuator.measure.error import response_verdict
from tactuator.measure.noise import felt_noise, felt_of_command, noise_verdict, proportional_controller, sensor_noise
from tactuator.measure.options import MeasurementOptions
from tactuator.measure.response import multisine_response, stepped_sine
from tactuator.model.description import Converter
from tactuator.model.verdict import Outcome
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import InProcess
from tactuator.signals.spectra import lock_in, power_spectrum
from tests.measure.loops import FULL, PLANT, QUIETER, RATE_HZ, controller, display, loaded, loop_response
from tests.rig.guard.guarded import designed


def error_db(response, made):
    expected, _ = loop_response(made, response.frequency_hz)
    return 20.0 * np.log10(np.abs(response.amplitude_v / response.reference / expected))


def test_stepped_sine__50_db_sl__within_a_tenth_of_a_decibel_and_in_phase() -> None:
    found = stepped_sine(loaded(FULL, 1), [1.0, 10.0, 50.0, 120.0, 250.0], MeasurementOptions(50.0))[0]
    expected, _ = loop_response(FULL, found.frequency_hz)
    assert found.frequency_hz.tolist() == [1.0, 10.0, 50.0, 122.0, 250.0]
    assert np.max(np.abs(error_db(found, FULL))) < 0.1
    assert np.max(np.abs(np.angle(found.amplitude_v / expected))) < 0.02
    np.testing.assert_allclose(
        found.latency_s, -np.unwrap(np.angle(expected)) / (2.0 * np.pi * found.frequency_hz), atol=3e-4
    )
    assert np.all(found.reached)
    assert not np.any(found.saturated)


def test_stepped_sine__below_a_converter_step__within_its_confidence() -> None:
    inside = 0
    for seed in range(4):
        options = MeasurementOptions(0.0, confidence_db=1.5, longest_s=40.0)
        found = stepped_sine(loaded(QUIETER, seed), [298.0], options)[0]
        assert found.magnitude_v[0] < 20.0 / 65536.0
        assert found.confidence_db[0] <= 1.5
        inside += abs(error_db(found, QUIETER)[0]) <= found.confidence_db[0]
    assert inside >= 3


def test_stepped_sine__60_db_below_the_threshold__is_noise_and_not_judged() -> None:
    """The noise was told as a response 42 dB too great, plus or minus 11 dB: not met, of a controller that is flat."""
    found = stepped_sine(loaded(QUIETER, 6), [50.0, 250.0], MeasurementOptions(-60.0, longest_s=2.0))[0]
    assert np.all(np.isinf(found.confidence_db))
    assert response_verdict([found], QUIETER.display).outcome is Outcome.NOT_JUDGED


def test_stepped_sine__friction__distorts_and_is_reported_apart_from_noise() -> None:
    rubbing, free = (stepped_sine(loaded(made, 2), [5.0], MeasurementOptions(10.0))[0] for made in (FULL, QUIETER))
    assert rubbing.distortion_v[0] > 4.0 * free.distortion_v[0]
    assert rubbing.noise_v[0] < 0.05 * rubbing.magnitude_v[0]


def test_stepped_sine__beyond_the_range__is_marked_saturated() -> None:
    paper = QUIETER.display
    described = replace(paper, channels=(replace(paper.channels[0], converter=Converter(range_v=2.5)),))
    rig = loaded(controller(described), 3)
    found = stepped_sine(rig, [5.0, 250.0], MeasurementOptions(50.0))[0]
    assert found.saturated.tolist() == [False, True]
    short = replace(paper, channels=(replace(paper.channels[0], travel_mm=0.1),))
    assert stepped_sine(loaded(controller(short), 3), [5.0, 250.0], MeasurementOptions(50.0))[0].saturated[0]


def test_multisine__30_frequencies__as_the_stepped_sine_within_a_quarter_decibel() -> None:
    rig = loaded(FULL, 4)
    asked = np.geomspace(0.4, 300.0, 30)
    found = multisine_response(
        rig, asked, MeasurementOptions(30.0, longest_s=20.0), np.random.default_rng(1), exactly=False
    )[0]
    assert found.frequency_hz.size == 30
    assert found.averaged_s[0] + 1.25 <= 10.0
    assert np.max(found.confidence_db) <= 0.25
    assert np.max(np.abs(error_db(found, FULL))) < 0.25
    stepped = stepped_sine(rig, found.frequency_hz[::6], MeasurementOptions(30.0))[0]
    assert np.max(np.abs(found.magnitude_db[::6] - stepped.magnitude_db)) < 0.25
    np.testing.assert_allclose(np.angle(found.amplitude_v[::6] / stepped.amplitude_v), 0.0, atol=0.03)
    hastily, rng = MeasurementOptions(45.0, confidence_db=50.0), np.random.default_rng
    with pytest.raises(BadInput, match="level_db_sl is 45 dB SL for 30 frequencies at once") as refused:
        multisine_response(rig, asked, hastily, rng(1), exactly=False)
    most = float(re.search(r"at most ([\d.]+) dB SL", str(refused.value))[1])
    multisine_response(rig, asked, replace(hastily, level_db_sl=most), rng(1), exactly=False)
    with pytest.raises(BadInput, match=f"at most {most:g} dB SL"):
        multisine_response(rig, asked, replace(hastily, level_db_sl=most + 0.1), rng(1), exactly=False)


def test_multisine__friction__shows_on_silent_lines() -> None:
    levels = []
    for made in (FULL, QUIETER):
        options, asked = MeasurementOptions(10.0, longest_s=20.0), np.geomspace(0.4, 50.0, 12)
        found = multisine_response(loaded(made, 5), asked, options, np.random.default_rng(2), exactly=False)[0]
        levels.append(np.max(found.distortion_v / found.magnitude_v))
    assert levels[0] > 5.0 * levels[1]


def options_of(asked) -> MeasurementOptions:
    return MeasurementOptions(**{key: value for key, value in asked.items() if key != "frequency_hz"})


@pytest.mark.parametrize(
    ("asked", "match"),
    [
        ({"frequency_hz": [10.0], "level_db_sl": 56.0}, "level_db_sl is 56 dB SL; .*comfortable"),
        ({"frequency_hz": [10.0], "level_db_sl": float("nan")}, "comfortable"),
        ({"frequency_hz": [10.0], "level_db_sl": -(2.0**63)}, "comfortable"),
        ({"frequency_hz": [], "level_db_sl": 10.0}, "; "),
        ({"frequency_hz": [1900.0], "level_db_sl": 10.0}, "below"),
        ({"frequency_hz": [10.0], "level_db_sl": 10.0, "channels": ["toe"]}, "toe"),
        ({"frequency_hz": [10.0], "level_db_sl": 10.0, "confidence_db": 0.0}, "confidence_db is 0; it must be above 0"),
    ],
)
def test_response__impossible__is_refused_before_anything_moves(asked, match: str) -> None:
    rig = loaded(FULL, 0)
    with pytest.raises(BadInput, match=match):
        stepped_sine(rig, asked["frequency_hz"], options_of(asked))
    with pytest.raises(BadInput, match=match):
        multisine_response(rig, asked["frequency_hz"], options_of(asked), np.random.default_rng(0))
    assert rig.rate_hz == RATE_HZ


def stepped(rig):
    return stepped_sine(rig, [20.0, 200.0], MeasurementOptions(35.0, longest_s=4.0, confidence_db=0.05))


def multisine(rig):
    return multisine_response(
        rig, [20.0, 55.0], MeasurementOptions(35.0, longest_s=2.0, confidence_db=0.05), np.random.default_rng(2)
    )


@pytest.mark.parametrize("measure", [stepped, multisine])
def test_measure__free_board__agrees_with_the_simulated_display(measure):
    made = designed()
    free = BoardRig(LinkClient(InProcess()), made.display, waits=False, sleep=lambda seconds: None)
    free.simulate(1)
    free.load(made)
    for found, wanted in zip(measure(free), measure(loaded(made, 2)), strict=True):
        bound = found.confidence_db + wanted.confidence_db + 0.03  # float32 on the board
        assert np.all(np.abs(found.magnitude_db - wanted.magnitude_db) < bound)
        assert np.all(np.abs(found.phase_rad - wanted.phase_rad) < 0.02)


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
    report = disturbance(rig, made, "index", frequency, np.random.default_rng(0))
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
        disturbance(rig, made, "index", frequency, np.random.default_rng(0), excursion_mm=0.0)
