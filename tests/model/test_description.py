"""Loads against hand-derived denominators; what a display refuses.

The checks of numbers that can hardly be: each by its bounds.

The slips of whole files, and the right files beside them, are in `tests/api/test_slips.py`.
"""

import re
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from scipy import signal

from tactuator.errors import BadInput
from tactuator.io.environment import channel_environment
from tactuator.model.description import Channel, Converter, Display, Environment, Threshold
from tactuator.model.plant import Load
from tactuator.model.plausibility import EXPECTED, doubtful, record_doubts, swing
from tactuator.model.requirements import FeedbackRequirements, PrefilterRequirements
from tactuator.model.verdict import Outcome
from tactuator.perception.curve import curve
from tactuator.signals.record import Record
from tactuator.signals.systems import ContinuousSystem
from tests.measure.loops import display

MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
FINGER = Load("finger", 0.12, 31.0, 360.0)
THRESHOLD = Threshold(curve("bolanowski-1988"))
INDEX = Channel("index", 0.19898, 12.5, MOTOR, threshold=THRESHOLD, loads=(FINGER,))


def test_load__second_order_motor__is_added_to_the_denominator() -> None:
    expected = ContinuousSystem.from_polynomials([2875.0], [1.12, 125.0, 650.0])
    hz = np.array([0.0, 1.0, 30.0, 300.0])
    np.testing.assert_allclose(INDEX.loaded_plant(FINGER).response(hz), expected.response(hz), rtol=1e-12)
    assert INDEX.loaded_plant(None) == MOTOR


def test_load__acceleration_sensor__acts_on_the_displacement() -> None:
    sensed = ContinuousSystem.from_polynomials([2875.0, 0.0, 0.0], [1.0, 94.0, 290.0])
    loaded = FINGER.applied_to(sensed, "acceleration")
    s = 2j * np.pi * 20.0
    assert loaded.response(20.0) == pytest.approx(2875.0 * s**2 / (1.12 * s**2 + 125.0 * s + 650.0))


def test_load__general_plant__is_p_over_one_plus_pz() -> None:
    plant = ContinuousSystem.from_polynomials([50.0, 3000.0], [1.0, 90.0, 5000.0, 9000.0])
    s = 2j * np.pi * 12.0
    p = (50.0 * s + 3000.0) / (s**3 + 90.0 * s**2 + 5000.0 * s + 9000.0)
    z = (0.12 * s**2 + 31.0 * s + 360.0) / 50.0
    touched = replace(FINGER, per=50.0)
    assert touched.applied_to(plant).response(12.0) == pytest.approx(p / (1.0 + p * z))


def test_channel__threshold_and_converter__by_hand() -> None:
    sensed = replace(INDEX, quantity="acceleration")
    ratio = sensed.threshold_voltage(10.0) / INDEX.threshold_voltage(10.0)
    assert ratio == pytest.approx((2.0 * np.pi * 10.0) ** 2)
    assert Converter().step_v == pytest.approx(305.2e-6, rel=1e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Converter(bits=4), "bits is 4; it must be a whole number, 8 to 24"),
        (lambda: Converter(range_v=-10.0), "range_v is -10"),
        (lambda: Converter(polarity=0), "polarity is 0; it must be 1 or -1"),
        (lambda: Converter(offset_v=11.0), "offset_v is 11"),
        (
            lambda: replace(INDEX, sensor_gain_v_per_mm=-0.2),
            "-0.2; it must be a number, above 0",
        ),
        (lambda: replace(INDEX, travel_mm=0.0), "travel_mm is 0"),
        (lambda: replace(INDEX, quantity="jerk"), "quantity is 'jerk'; it must be \"displacement"),
        (lambda: replace(INDEX, loads=(FINGER, FINGER)), "same name"),
        *(
            (lambda key=key, name=name: replace(INDEX, **{key: name}), rf"channel\]\]: {key} is .*; it must be 1 to 50")
            for key in ("name", "finger")
            for name in ("", " ", "left/index", "left\\index", "a\x00b", "a\nb", "a\n", "..", ".hidden", "a" * 51)
        ),
        (lambda: Load("left/finger"), "load: name is 'left/finger'; it must be 1 to 50 printable characters"),
        (lambda: INDEX.load("toe"), "no load 'toe'; expected finger"),
        (lambda: Load("finger", 0.0, -1.0, 0.0), "damping is -1"),
        (lambda: Threshold(curve("morioka-griffin-2006"), (0.4, 300.0)), "8 to 315 Hz; expected one that covers"),
        (lambda: Display(1000.0, (INDEX,), 1, "slow"), "1000 for a band up to 300 Hz; it must be 1200 or more"),
        (lambda: Display(4000.0, (), 1, "odd"), "no channel"),
        (lambda: Display(4000.0, ("index",)), "channels.0 is 'index'; it must be a Channel"),
        (lambda: Display(4000.0, INDEX), "channels is a Channel; it must be a list, each a Channel"),
        (
            lambda: replace(INDEX, plant=([1, 2, 3], [1, 2])),
            r"is improper \(2 zeros, 1 poles\); it must be proper",
        ),
        (lambda: INDEX.load("fingr"), r"channel 'index': no load 'fingr' \(did you mean 'finger'\?\)"),
        (lambda: Display(4000.0, (INDEX,)).channel("indx"), r"no channel 'indx' \(did you mean 'index'\?\)"),
        (lambda: Display(4000.0, (INDEX, INDEX), 1, "odd"), "same name"),
        (lambda: Display(4000.0, (INDEX,), 9, "odd"), "0 to 8"),
        (lambda: Display(4000.0, (INDEX,), 1, "one").channel("ring"), "display: no channel 'ring'; expected index"),
        (lambda: FeedbackRequirements(mains_hz=(60.0,)), "1 mains_hz and 0 mains_max_db"),
        (lambda: FeedbackRequirements(rejection_band_hz=(10.0, 1.0)), "rejection_band_hz"),
        (lambda: PrefilterRequirements(1), "poles is 1; it must be a whole number, 2 to 16"),
        (lambda: Environment(noise_v_rms=-1.0), "noise_v_rms is -1; it must be a number, 0 or more"),
        (lambda: Environment((50.0, 100.0), (1e-3,)), "2 hum_hz and 1 hum_v_peak"),
    ],
)
def test_description__that_cannot_be__is_refused(make, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        make()


def test_mains__nothing_asked__is_the_lowest_line_of_hum_that_is_stated() -> None:
    for environment, expected in (
        (Environment(hum_hz=(50.0, 100.0), hum_v_peak=(1e-3, 1e-3)), 50.0),
        (Environment(assumed=("hum",)), 77.0),
        (Environment(hum_hz=(), hum_v_peak=()), 77.0),
    ):
        display = Display(4000.0, (replace(INDEX, environment=environment),), 1, "one")
        assert display.mains_hz(None, 77.0) == expected
        assert display.mains_hz(0.0, 77.0) == 0.0


@pytest.mark.parametrize("name", EXPECTED)
def test_check__on_either_side_of_each_bound__doubts_beyond_it_alone(name: str) -> None:
    check = EXPECTED[name]
    for bound, outwards, slip in ((check.low, -1.0, check.below), (check.high, 1.0, check.above)):
        if not np.isfinite(bound):
            assert slip == ""
            continue
        size = 1e-6 * max(abs(bound), 1e-3)
        assert list(check.doubts(bound)) == list(check.doubts(bound - outwards * size)) == []
        (doubt,) = check.doubts(bound + outwards * size)
        assert doubt.bound == bound
        if slip or bound != 0.0:
            assert slip
            assert slip in str(doubt)


def test_record__in_no_unit_or_another__has_no_doubts_about_volts() -> None:
    values = np.sin(np.arange(1000.0))
    assert record_doubts(Record(1000.0, values, 1e6 * values, "", "um")) == ()
    assert [doubt.expected for doubt in record_doubts(Record(1000.0, values, 1e6 * values))] == [EXPECTED["position"]]


def test_swing__of_a_signal_far_off_zero__is_its_amplitude() -> None:
    assert swing(100.0 + 2.0 * np.sin(np.arange(10_000.0))) == pytest.approx(2.0, rel=1e-4)


def altered(travel_mm: float = 12.5, friction_v: float = 4e-3) -> Display:
    (channel,) = display().channels
    environment = replace(channel.environment, friction_v=friction_v)
    return replace(display(), channels=(replace(channel, travel_mm=travel_mm, environment=environment),))


def test_doubtful__display_with_what_cannot_be__is_not_met_and_else_not_judged() -> None:
    assert list(doubtful(altered())) == []
    assert Outcome.NOT_MET in {finding.outcome for finding in doubtful(altered(travel_mm=0.0125))}
    assert {finding.outcome for finding in doubtful(altered(friction_v=4.0))} == {Outcome.NOT_JUDGED}
    unseen = 1.01 * INDEX.converter.range_v / display().channels[0].sensor_gain_v_per_mm
    assert [each.outcome for each in doubtful(altered(travel_mm=unseen))] == [Outcome.NOT_MET]
    assert list(doubtful(altered(travel_mm=unseen / 1.02))) == []


def by_hand(plant: object) -> Channel:
    return Channel("index", sensor_gain_v_per_mm=0.2, travel_mm=12.5, plant=plant)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "plant",
    [
        ([2875.0], [1.0, 94.0, 290.0]),
        {"num": [2875.0], "den": [1.0, 94.0, 290.0]},
        control.tf([2875.0], [1.0, 94.0, 290.0]),
        control.ss(control.tf([2875.0], [1.0, 94.0, 290.0])),
        signal.TransferFunction([2875.0], [1.0, 94.0, 290.0]),
    ],
    ids=["pair", "table", "tf", "ss", "lti"],
)
def test_channel__made_by_hand__has_the_plant_and_a_file_s_defaults(plant: object) -> None:
    made, hertz = by_hand(plant), np.array([1.0, 30.0, 300.0])
    np.testing.assert_allclose(made.plant.response(hertz), MOTOR.response(hertz), rtol=1e-9)
    assert (made.finger, made.threshold, Display(4000.0, (made,)).name) == ("index", THRESHOLD, "display")
    assert made.environment.assumed == channel_environment({}, "", Path(), "index", None).assumed != ()


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (control.tf([1.0], [1.0, 0.5], 1e-3), "a system sampled at 1000 Hz; it must be a continuous one"),
        (
            control.ss(-np.eye(2), np.eye(2), np.eye(2), 0),
            "2 inputs and 2 outputs; it must be one of each",
        ),
        (signal.dlti([1.0], [1.0, 0.5]), "sampling period is True"),
        (signal.TransferFunction([2875.0], [1.0, 94.0, 290.0]).to_ss(), "a state space without exact zeros"),
        ("tf", "'tf'; it must be `{ num, den }` or `{ zeros, poles, gain }`; a display file names files"),
        (
            Path("model.json"),
            "'model.json'; it must be `{ num, den }` or `{ zeros, poles, gain }`; a display file names",
        ),
        (([0.0], [1.0, 1.0]), ": num is zero; it must be a polynomial"),
        (object(), "of type object; it must be a linear system of python-control or scipy.signal"),
    ],
    ids=["sampled", "two by two", "no period", "rounded zeros", "text", "path", "zero", "object"],
)
def test_channel__plant_that_is_none__is_refused_by_its_name(plant: object, words: str) -> None:
    with pytest.raises(BadInput, match=f"plant.*{re.escape(words)}"):
        by_hand(plant)
