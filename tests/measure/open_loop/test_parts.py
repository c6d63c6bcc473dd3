"""The parts of a calibration without loop: wiring, levels, usable band, and what is taken away."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from tactuator.errors import BadInput
from tactuator.io.display import read_display
from tactuator.io.text import toml_text
from tactuator.measure.broadband import broadband, estimate_plant, find_level, near_band, record_wave
from tactuator.measure.open_loop import _groups, usable_band
from tactuator.model.controller import Controller
from tactuator.rig.rig import require_sensors
from tactuator.rig.sound.rig import SoundRig
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.systems import ContinuousSystem
from tests.measure.open_loop import exciters
from tests.measure.open_loop.exciters import RATE_HZ, exciter_card, exciter_display, exciter_rig
from tests.rig.sound.exciter import Exciter
from tests.rig.sound.turned_card import flat_controller, sound_display, turned_rig

BAND_HZ = (20.0, 300.0)
EXCITER = Exciter(drive=3e4, sensor_full_scale=1e5)


def wave(seed: int = 0):
    return broadband(RATE_HZ, BAND_HZ, 50.0, np.random.default_rng(seed))


def test_broadband__lines__are_in_the_band_and_off_mains():
    made = wave()
    spectrum = np.abs(np.fft.rfft(made.one_period()))
    assert np.max(np.abs(made.one_period())) == pytest.approx(1.0)
    assert made.frequency_hz[0] == pytest.approx(10.0)
    assert made.frequency_hz[-1] == pytest.approx(480.0, abs=0.3)
    assert np.min(np.abs(made.frequency_hz[:, None] - 50.0 * np.arange(1, 10))) > 1.0
    silent = np.setdiff1d(np.arange(spectrum.size), made.bins)
    assert np.max(spectrum[silent]) < 1e-9 * np.max(spectrum)


def test_hear__linear_exciter__its_truth():
    rig = exciter_rig([replace(EXCITER, noise=0.5, hum=3.0)])
    recording = record_wave(rig, "exciter", wave(), 0.05, 2)
    response, _ = recording.response()
    s = 2j * np.pi * recording.wave.frequency_hz
    truth = 1e-3 * s**2 * EXCITER.response(recording.wave.frequency_hz)
    off = 20.0 * np.log10(np.abs(response / truth))
    assert np.max(np.abs(off)) < 0.15
    assert abs(np.median(off)) < 0.01


@pytest.mark.slow
def test_find_level__sensors_swapped_off_or_not_there__are_told():
    rig = exciter_rig([EXCITER, EXCITER], ("left", "right"))
    one, other = rig.display.sound.wires
    swapped = replace(rig.display.sound, wires=(replace(one, input=2), replace(other, input=1)))
    display = replace(rig.display, sound=swapped)
    card = exciter_card(rig._rows, [EXCITER, EXCITER], 0)
    again = SoundRig(display, rig._rows, card, card.sleep)
    with pytest.raises(BadInput, match="channel 'left' is answered by the sensor of 'right'"):
        find_level(again, display.channels[0], wave(), 100.0)
    deaf = exciter_rig([replace(EXCITER, drive=1e-3)])
    with pytest.raises(BadInput, match="its sensor does not measure"):
        find_level(deaf, deaf.display.channels[0], wave(), 100.0)
    none, _ = turned_rig(sound_display(input=0))
    with pytest.raises(BadInput, match="'left' has no sensor, and there is nothing to measure with"):
        require_sensors(none, none.channels)
    require_sensors(deaf, ["exciter"])


def test_usable_band__static_actuator__ends_where_its_volts_meet_the_curve():
    channel = replace(
        exciter_display(EXCITER).channels[0], quantity="displacement", sensor_gain_v_per_mm=1.0, travel_mm=10.0
    )
    curve = channel.threshold.curve
    # 20 dB above threshold at 40 Hz, with 0.9 of 2 V
    gain = 10.0 * float(curve.displacement_mm(40.0)) / (0.9 * 2.0)
    plant = ContinuousSystem(np.empty(0), np.empty(0), gain)
    found = usable_band(channel, plant, (10.0, 300.0), 20.0)
    assert found.band_hz[0] == pytest.approx(40.0, rel=0.01)
    assert found.ends == ("command", "asked")
    with pytest.raises(BadInput, match="dB SL at most"):
        usable_band(channel, plant, (10.0, 300.0), 80.0)


def test_groups__lines_that_ask_for_much__sums_stay_within_the_range():
    """The greatest sum that any phases can have, or 3.5 times its rms, against the range; all lines are played."""
    display = sound_display()
    above, below = signal.iirpeak(100.0, 5.0, fs=8000.0)
    controller = flat_controller(display, prefilter_sos=np.concatenate([0.13 * above, below])[None, :])
    lines = np.geomspace(20.0, 300.0, 40)
    groups = _groups(controller, "left", lines, 20.0)
    assert np.array_equal(np.sort(np.concatenate(groups)), lines)
    rng = np.random.default_rng(0)
    time = np.arange(8000) / 8000.0
    for group in groups:
        _, volts = signal.freqz(0.13 * above, below, worN=group, fs=8000.0)
        tones = np.cos(2.0 * np.pi * (time[:, None] * group + rng.uniform(size=group.size)))
        assert np.max(np.abs(tones @ (10.0 * np.abs(volts)))) <= 1.5
    # at the peak 1.3 of 1.5 V are asked for
    assert min((group.size, abs(group[0] - 100.0)) for group in groups)[0] == 1
    assert len(groups) < 20


def test_toml__of_a_display__is_read_as_the_same(tmp_path: Path):
    from tactuator.model.description import display_document

    display = exciter_display(EXCITER, ("a", 'b "quoted" µ'))
    made: Controller = flat_controller(display)
    path = tmp_path / "display.toml"
    path.write_text(toml_text(display_document(made.display)), encoding="utf-8")
    assert display_document(read_display(path)) == display_document(display)


def test_near_band__pole_beyond_the_sampling_rate__answers_as_the_plant_did():
    # as identified for drawn exciter 10: zeros to the right and a pole at 136 kHz stand for a mode above the band
    hz = 2.0 * np.pi
    zeros = hz * np.array([421.3 + 363.8j, 421.3 - 363.8j, 0.0, 0.0, 0.0])
    poles = -hz * np.array([136234.0, 467.0, 65.3 - 269.8j, 65.3 + 269.8j, 12.1])
    plant = ContinuousSystem(zeros, poles, 8812.9, 8.27e-6)
    near = near_band(plant, (10.0, 400.0))
    frequency = np.geomspace(20.0, 400.0, 50)

    def off_db(system) -> float:
        return float(np.max(np.abs(db(np.abs(system.response(frequency) / plant.response(frequency))))))

    assert off_db(discretise(plant, RATE_HZ, "zoh")) > 3.0
    assert off_db(discretise(near, RATE_HZ, "zoh")) < 0.1
    assert off_db(near) < 0.05
    modest = ContinuousSystem(np.zeros(2), -np.array([30.0, 400.0]), 1.0)
    assert near_band(modest, (10.0, 400.0)) is modest


@pytest.mark.slow
def test_follow__card_that_is_119_ms_late__model_and_its_delay_to_the_sample(monkeypatch):
    monkeypatch.setattr(exciters, "PERIOD", 4096)
    exciter = replace(exciters.drawn_exciter(7), noise=5.0)
    rig = exciter_rig([exciter])
    rig.feed_far_ahead()
    recording, fresh = (record_wave(rig, "exciter", wave(seed), 0.1, 2) for seed in (1, 2))
    found = estimate_plant(rig.display.channels[0], recording, fresh, BAND_HZ)
    assert found.by == "model"
    assert found.departure_db < 0.4
    assert found.plant.delay_s * RATE_HZ == pytest.approx(4096 + exciter.delay_s * RATE_HZ, abs=1.0)
