"""Levels of the scope: against the truth at the finger port, of which they know nothing, and plain arithmetic."""

import subprocess
import sys

import numpy as np
import pytest

from tactuator.console.rig_process import Levels
from tactuator.console.scope import ScopeSamples
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.decibels import db

RATE = 4000


def rows_of(trace):
    return np.concatenate((trace.reference, trace.command_v, trace.position_v), axis=1).astype(np.float32)


@pytest.mark.parametrize(("hertz", "level"), [(40.0, 30.0), (100.3, 25.0), (250.0, 40.0)])
def test_tone__on_the_simulated_rig__is_read_as_the_finger_feels_it(controller, hertz, level):
    rig, felt = SimulatedRig(controller.display, 1), []
    rig.load(controller)
    rig.finger("thumb").attach(felt.append)
    reference = np.zeros((2 * RATE, 3))
    reference[:, 1] = 10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * hertz * np.arange(2 * RATE) / RATE)
    trace = rig.play(reference)
    moved = np.concatenate(felt)[-RATE:] * np.hanning(RATE)
    amplitude = 2.0 * abs(np.exp(-2j * np.pi * hertz * np.arange(RATE) / RATE) @ moved) / np.hanning(RATE).sum()
    truth = float(db(amplitude / controller.display.channels[1].threshold.curve.displacement_mm(hertz)))
    found = Levels(controller.display).of_rows(rows_of(trace)[-RATE:], hertz)[1]
    assert found.tone_db_sl == pytest.approx(truth, abs=0.25)
    assert found.level_db_sl == pytest.approx(truth, abs=1.0)
    assert truth == pytest.approx(level, abs=1.0)


def test_spectrum__of_two_tones__stands_at_their_levels_over_the_threshold(controller):
    display, time = controller.display, np.arange(RATE) / RATE
    levels, rows = Levels(display), np.zeros((RATE, 9), np.float32)
    channel = display.channels[2]
    for hertz, level in ((40.0, 20.0), (160.0, -5.0)):
        volts = float(channel.threshold_voltage(hertz)) * 10.0 ** (level / 20.0)
        rows[:, 8] += volts * np.sin(2.0 * np.pi * hertz * time)
    found = levels.of_rows(rows)[2]
    for hertz, level in ((40.0, 20.0), (160.0, -5.0)):
        near = np.argmin(np.abs(np.log(levels.frequency_hz / hertz)))
        assert found.spectrum_db_sl[near - 1 : near + 2].max() == pytest.approx(level, abs=0.1)
    assert found.level_db_sl == pytest.approx(10.0 * np.log10(10.0**2.0 + 10.0**-0.5), abs=0.05)


def test_levels__of_nothing__are_the_floor_and_of_less_than_a_second_or_with_a_gap_none(controller):
    rows, levels = np.zeros((RATE, 9), np.float32), Levels(controller.display)
    rows[:, 3:6] = [0.1, -0.2, 0.3]
    rows[:, 6:] = 1.5  # a sensor's offset is no level
    quiet = levels.of_rows(rows)
    assert [each.level_db_sl for each in quiet] == [-120.0] * 3
    assert [each.command_mean_v for each in quiet] == pytest.approx([0.1, -0.2, 0.3])
    assert [each.tone_db_sl for each in quiet] == [None] * 3
    assert [each.tone_db_sl for each in levels.of_rows(rows, 2.3)] == [-120.0] * 3
    samples = ScopeSamples(3, 10 * RATE)
    for first, count in ((0, RATE - 1), (RATE, 10)):
        samples.add(first, rows[:count])
        assert levels.of(samples) is None
    assert samples.lost == 1


def test_process_that_holds_a_rig__imports_no_web_server():
    program = "import sys, tactuator.console.rig_worker; sys.exit('fastapi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0
