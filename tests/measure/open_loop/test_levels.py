"""The level of a measurement that nobody stated, on an open loop: beside the same filters run over time by SciPy."""

import numpy as np
import pytest
from scipy import signal

import tactuator as tt
from tactuator.measure.error import level_within_limits
from tactuator.model.controller import Controller
from tactuator.rig.sound.rig import SoundRig, displacement_sections
from tactuator.rig.sound.stream import CardRows
from tactuator.signals.multisine import Multisine, multisine
from tests.measure.open_loop.exciters import PERIOD, exciter_card
from tests.rig.sound.from_start_to_end import EXCITER, RATE_HZ, controller

HERTZ = np.array([43.0, 61.0, 89.0, 127.0, 181.0, 257.0])


def shares_over_time(made: Controller, wave: np.ndarray) -> list[float]:
    """The greatest share of comfort, command and travel while a reference is played over and over."""
    (channel,) = made.display.channels
    volts = signal.sosfilt(made.channels[0].prefilter_sos, np.tile(wave, 3))
    moved = volts
    for sections in displacement_sections(channel, RATE_HZ):
        moved = signal.sosfilt(sections, moved)
    comfort = 10.0 ** (made.display.objectives.comfort_db_sl / 20.0)
    limits = (comfort, made.channels[0].limits.command_v, channel.travel_mm)
    peaks = [float(np.max(np.abs(each[-wave.size :]))) for each in (wave, volts, moved)]
    return [peak / limit for peak, limit in zip(peaks, limits, strict=True)]


@pytest.mark.parametrize("seed", range(4))
def test_level__lines_at_once__fill_nine_tenths_of_the_nearest_limit(seed: int):
    made = controller(0)
    asked = multisine(RATE_HZ, 48000, HERTZ.astype(int), 10.0**2.5, np.random.default_rng(seed))
    level = level_within_limits(made, ["index"], HERTZ, 50.0, asked)
    assert level < 50.0
    fitting = Multisine(RATE_HZ, 48000, asked.bins, np.full(6, 10.0 ** (level / 20.0)), asked.phase_rad)
    assert max(shares_over_time(made, fitting.one_period())) == pytest.approx(0.9, rel=0.02)


def test_level__tones_one_by_one__fill_nine_tenths_of_the_nearest_limit():
    made, time = controller(0), np.arange(48000) / RATE_HZ
    level = level_within_limits(made, ["index"], HERTZ, 54.0, None)
    waves = [10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * hertz * time) for hertz in HERTZ]
    assert max(max(shares_over_time(made, wave)) for wave in waves) == pytest.approx(0.9, rel=0.02)
    assert level_within_limits(made, ["index"], HERTZ, 10.0, None) == 10.0


def test_measure_response__level_not_stated__nothing_is_cut_and_a_stated_one_is_kept(capsys):
    made, rows = controller(PERIOD), CardRows(2, 4, 4 * 48000, RATE_HZ)
    card = exciter_card(rows, [EXCITER, EXCITER], 0)  # its third input hears the displacement of the first
    rig = SoundRig(made.display, rows, card, card.sleep)
    asked = {"method": "multisine", "longest_s": 4.0}  # thirty lines
    (usual,) = tt.measure_response(rig, made, **asked).responses
    assert 20.0 < usual.level_db_sl < 30.0
    assert not usual.saturated.any()
    words = f"level {usual.level_db_sl:g} dB SL: 30 would pass the comfort limit, the range or the travel"
    assert words in capsys.readouterr().err
    (stated,) = tt.measure_response(rig, made, level_db_sl=usual.level_db_sl + 3.0, **asked).responses
    assert stated.saturated.any()
