"""The verdict on the four objectives, with numbers computed by hand where the paper's loop gives them."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.display.description import Environment
from tactuator.display.load import Load
from tactuator.display.requirements import Objectives
from tactuator.errors import BadInput
from tactuator.loop.feedback import TwoDegreeLoop
from tactuator.synthesis.family import sampled_plant
from tactuator.synthesis.verdict import felt_db_sl, felt_noise_rms_v, judge
from tests.synthesis.displays import channel, paper_alone, paper_controller, three_finger_controller, three_fingers

RATE_HZ = 4000.0


def test_judge__three_fingers__all_four_met() -> None:
    verdict = judge(three_finger_controller(), three_fingers())
    assert verdict.met
    assert [one.number for one in verdict.objectives] == ["i", "ii", "iii", "iv"]
    assert set(verdict.objectives[0].figures) == {"index", "thumb", "middle"}
    assert set(verdict.objectives[0].figures["index"]) == {"none", "finger"}
    assert set(verdict.objectives[3].figures["index"]) == {"finger"}


def test_judge__hum__felt_through_t() -> None:
    """1 mV at 60 Hz through |T| = -11.95 dB is 1.27 um; the threshold there is 5 dB re 1 um: -2.9 dB SL."""
    figures = judge(paper_controller()).objectives[1].figures["index"]["none"]
    assert figures["felt_db_sl"]["60"] == pytest.approx(20.0 * np.log10(1000.0 / 198.98) - 11.95 - 5.0, abs=0.02)


def test_judge__ten_times_the_hum__not_met() -> None:
    loud = channel(loads=(), environment=Environment(hum_v_peak=(1e-2, 3e-3, 2e-3)))
    verdict = judge(paper_controller(), replace(paper_alone(), channels=(loud,)))
    assert not verdict.met
    assert [one.number for one in verdict.objectives if not one.met] == ["ii"]


def test_judge__much_noise__third_objective_not_met() -> None:
    noisy = channel(loads=(), environment=Environment(noise_v_rms=0.02))
    verdict = judge(paper_controller(), replace(paper_alone(), channels=(noisy,)))
    assert [one.number for one in verdict.objectives if not one.met] == ["iii"]


def test_judge__tighter_tolerances__first_and_fourth_not_met() -> None:
    strict = replace(three_fingers(), objectives=Objectives(flatness_db=0.05, load_max_db=0.05))
    failed = [one.number for one in judge(three_finger_controller(), strict).objectives if not one.met]
    assert failed == ["i", "iv"]


def test_judge__load__worst_change_is_told_over_the_band() -> None:
    figures = judge(three_finger_controller(), three_fingers()).objectives[3].figures["thumb"]["finger"]
    assert figures["max_change_db"] <= 1.0
    assert -3.0 < figures["worst_change_db"] < -1.0
    assert 20.0 < figures["worst_hz"] < 50.0


def test_judge__load_that_makes_the_loop_unstable__says_so() -> None:
    heavy = channel(loads=(Load("anvil", 40.0, 0.0, 0.0),))
    verdict = judge(
        three_finger_controller(), replace(three_fingers(), channels=(heavy, *three_fingers().channels[1:]))
    )
    figures = verdict.objectives[0].figures["index"]["anvil"]
    assert figures == {"met": False, "stable": False}
    assert not verdict.met


def test_judge__another_display__refused() -> None:
    with pytest.raises(BadInput, match="is for channels index; allowed: index, thumb, middle, as the display has"):
        judge(paper_controller(), three_fingers())
    with pytest.raises(BadInput, match="is for 4000 Hz and a delay of 1; allowed: 8000 Hz and 1, as the display has"):
        judge(paper_controller(), replace(paper_alone(), rate_hz=8000.0))


def test_felt_noise__white_noise_through_the_loop__simulated_agrees() -> None:
    """Sensor noise and the A/D's steps filtered by T, in two bands, against the band powers of a long simulation."""
    own, one = paper_controller().channels[0], paper_alone().channels[0]
    loop = TwoDegreeLoop(own.prefilter(RATE_HZ), own.feedback(RATE_HZ), sampled_plant(one.plant, RATE_HZ, 1))
    edges = np.array([[2.0, 20.0], [20.0, 80.0]])
    found = felt_noise_rms_v(one, loop, RATE_HZ, edges)
    assert loop.feedback is not None
    rng = np.random.default_rng(1)
    rms_v = np.hypot(one.environment.noise_v_rms, one.converter.step_v / np.sqrt(12.0))
    spectrum = np.fft.rfft(rng.normal(0.0, rms_v, 2**20))
    frequency = np.fft.rfftfreq(2**20, 1.0 / RATE_HZ)
    frequency[0] = 1e-6
    moved = spectrum * loop.feedback.complementary(frequency)
    for (low, high), rms in zip(edges, found, strict=True):
        inside = (frequency >= low) & (frequency < high)
        assert rms == pytest.approx(np.sqrt(2.0 * np.sum(np.abs(moved[inside]) ** 2)) / 2**20, rel=0.03)


def test_felt_db_sl__at_threshold__zero() -> None:
    one = channel()
    frequency = np.array([1.0, 30.0, 250.0])
    assert felt_db_sl(one, one.threshold_voltage(frequency), frequency) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
