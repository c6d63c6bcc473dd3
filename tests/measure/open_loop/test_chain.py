"""The whole calibration: on a card turned by hand, and blind through PortAudio and a JACK server."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tactuator.measure.open_loop.chain import CalibrationRequest, calibrate
from tactuator.rig.sound.demo.display import demo_exciter
from tests.measure.open_loop.exciters import PERIOD, RATE_HZ, exciter_rig, persons_curve

ROOT = Path(__file__).parents[3]
SEEDS = range(1, 21)


@pytest.mark.slow
def test_calibrate__exciter_and_a_persons_curve__is_felt_flat_by_its_equations():
    exciter = demo_exciter(np.random.default_rng(0))
    person = persons_curve()
    rig = exciter_rig([exciter], curve=person)
    made = calibrate(rig, CalibrationRequest((10.0, 400.0), 20.0, 50.0), np.random.default_rng(0))
    (one,) = made.channels
    assert made.flat
    assert one.followed.by == "model"
    # the card's period and the exciter's own dead time are put back, to the sample
    assert made.controller.display.sound.latency_samples == pytest.approx(PERIOD + exciter.delay_s * RATE_HZ, abs=1.0)
    frequency = one.last.frequency_hz
    volts = np.abs(made.controller.channels[0].prefilter(RATE_HZ).response(frequency))
    assert made.controller.display.channels[0].threshold.curve is person
    threshold = made.controller.display.channels[0].threshold.curve.displacement_mm(frequency)
    felt_db = 20.0 * np.log10(volts * np.abs(exciter.response(frequency)) / threshold)
    assert np.max(np.abs(felt_db)) < 1.0
    # the sensor says what the equations say
    assert np.max(np.abs(felt_db - one.last.error_db)) < 0.3


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("jackd") is None, reason="no jackd here: python3 tools/system.py slow")
def test_calibrate__twenty_drawn_exciters_blind__eighteen_are_felt_flat_or_say_why():
    found = []
    for seed in SEEDS:
        asked = [sys.executable, "-m", "tests.measure.open_loop.blind", str(seed)]
        done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, timeout=1500, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        found.append(json.loads(done.stdout))
    flat = [one for one in found if one.get("flat") and abs(one["felt_worst_db"]) <= 1.0 and one["share"] >= 0.9]
    assert len(flat) >= 18
    assert all(one["minutes"] <= 15.0 for one in found)
