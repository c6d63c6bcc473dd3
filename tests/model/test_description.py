"""Loads against hand-derived denominators; what a display refuses."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.model.coupling import CoupledResponse, smooth_shares
from tactuator.model.description import Channel, Converter, Display, Environment, Threshold
from tactuator.model.plant import Load
from tactuator.model.requirements import FeedbackRequirements, PrefilterRequirements
from tactuator.perception.curve import curve
from tactuator.signals.systems import ContinuousSystem

MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
FINGER = Load("finger", 0.12, 31.0, 360.0)
THRESHOLD = Threshold(curve("bolanowski-1988"))
INDEX = Channel("index", "index", 0.19898, 12.5, MOTOR, THRESHOLD, loads=(FINGER,))


def test_load__second_order_motor__is_added_to_the_denominator() -> None:
    expected = ContinuousSystem.from_polynomials([2875.0], [1.12, 125.0, 650.0])
    hz = np.array([0.0, 1.0, 30.0, 300.0])
    np.testing.assert_allclose(INDEX.loaded_plant(FINGER).response(hz), expected.response(hz), rtol=1e-12)


def test_load__none__is_the_plant_itself() -> None:
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
    assert FINGER.applied_to(plant).response(12.0) == pytest.approx(p / (1.0 + p * z))


def test_threshold_voltage__acceleration__is_differentiated_twice() -> None:
    sensed = replace(INDEX, quantity="acceleration")
    ratio = sensed.threshold_voltage(10.0) / INDEX.threshold_voltage(10.0)
    assert ratio == pytest.approx((2.0 * np.pi * 10.0) ** 2)


def test_converter_step__sixteen_bits__is_305_microvolts() -> None:
    assert Converter().step_v == pytest.approx(305.2e-6, rel=1e-3)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"bits": 4}, "bits is 4; allowed: a whole number, 8 to 24"),
        ({"range_v": -10.0}, "range_v is -10"),
        ({"polarity": 0}, "polarity is 0; allowed: 1 or -1"),
        ({"offset_v": 11.0}, "offset_v is 11"),
    ],
)
def test_converter__out_of_range__is_refused(keys: dict[str, float], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        Converter(**keys)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"sensor_gain_v_per_mm": -0.2}, "sensor_gain_v_per_mm is -0.2; allowed: a number, above 0"),
        ({"travel_mm": 0.0}, "travel_mm is 0"),
        ({"quantity": "jerk"}, "quantity is 'jerk'; allowed: \"displacement"),
        ({"loads": (FINGER, FINGER)}, "same name"),
    ],
)
def test_channel__wrong_figure__is_refused(keys: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        replace(INDEX, **keys)  # type: ignore[arg-type]


def test_channel_load__unknown_name__lists_what_is_there() -> None:
    with pytest.raises(BadInput, match="load 'toe' is not described; allowed: finger"):
        INDEX.load("toe")


def test_load__negative__is_refused() -> None:
    with pytest.raises(BadInput, match="damping is -1"):
        Load("finger", 0.0, -1.0, 0.0)


def test_threshold__curve_short_of_the_band__is_refused() -> None:
    with pytest.raises(BadInput, match="reaches from 8 to 315 Hz; allowed: one that covers"):
        Threshold(curve("morioka-griffin-2006"), (0.4, 300.0))


def test_display__rate_too_low_for_the_band__is_refused() -> None:
    with pytest.raises(BadInput, match="rate_hz is 1000 for a band up to 300 Hz; allowed: 1200 or more"):
        Display("slow", 1000.0, 1, (INDEX,))


@pytest.mark.parametrize(
    ("channels", "delay", "words"), [((), 1, "no channel"), ((INDEX, INDEX), 1, "same name"), ((INDEX,), 9, "0 to 8")]
)
def test_display__wrong_shape__is_refused(channels: tuple[Channel, ...], delay: int, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        Display("odd", 4000.0, delay, channels)


def test_display_channel__unknown_name__lists_what_is_there() -> None:
    with pytest.raises(BadInput, match="channel 'ring' is not described; allowed: index"):
        Display("one", 4000.0, 1, (INDEX,)).channel("ring")


def test_requirements__unequal_lists__are_refused() -> None:
    with pytest.raises(BadInput, match="1 mains_hz and 0 mains_max_db"):
        FeedbackRequirements(mains_hz=(60.0,))
    with pytest.raises(BadInput, match="rejection_band_hz"):
        FeedbackRequirements(rejection_band_hz=(10.0, 1.0))
    with pytest.raises(BadInput, match="poles is 1; allowed: a whole number, 2 to 16"):
        PrefilterRequirements(1)


def test_environment__negative_or_unequal__is_refused() -> None:
    with pytest.raises(BadInput, match=r"noise_v_rms is -1; allowed: a number, 0 or more"):
        Environment(noise_v_rms=-1.0)
    with pytest.raises(BadInput, match="2 hum_hz and 1 hum_v_peak"):
        Environment((50.0, 100.0), (1e-3,))


LINES = np.geomspace(1.0, 300.0, 120)


def measured(share: np.ndarray, deviation: np.ndarray, seed: int) -> CoupledResponse:
    noise = np.random.default_rng(seed).normal(size=(2, LINES.size, 2, 2)) / np.sqrt(2.0)
    unsure = np.repeat(deviation, 4).reshape(-1, 2, 2)
    value = (
        np.eye(2) + share[:, None, None] * (1.0 - np.eye(2)) + (noise[0] + 1j * noise[1]) * unsure * (1.0 - np.eye(2))
    )
    return CoupledResponse(("a", "b"), LINES, value.real, value.imag, unsure)


def frame(resonance_hz: float, damping: float) -> np.ndarray:
    ratio = LINES / resonance_hz
    return np.asarray(0.03 * np.exp(-2j * np.pi * LINES * 0.001) / (1.0 - ratio**2 + 2j * damping * ratio))


@pytest.mark.parametrize("damping", [0.5, 0.2, 0.05])
def test_smooth_shares__of_a_frame__are_nearer_the_truth_and_inside_their_disks(damping: float) -> None:
    share, deviation = frame(45.0, damping), 0.02 * (1.0 + (5.0 / LINES) ** 2)
    inside, gain = [], []
    for seed in range(10):
        given = measured(share, deviation, seed)
        smooth, unsure = (each[:, 0, 1] for each in smooth_shares(given))
        inside.append(np.mean(np.abs(smooth - share) < 1.731 * unsure))
        quiet = LINES > 15.0  # below, the noise is beyond the share, and a line stays as it is
        rough = given.shares()[0][:, 0, 1]
        gain.append(np.sum(np.abs(smooth - share)[quiet] ** 2) / np.sum(np.abs(rough - share)[quiet] ** 2))
    assert np.mean(inside) > 0.9
    assert np.mean(gain) < (0.9 if damping < 0.1 else 0.5)


def test_smooth_shares__of_lines_without_neighbours_that_help__stay_as_measured() -> None:
    rng = np.random.default_rng(2)
    rough = 0.03 * np.exp(2j * np.pi * rng.uniform(size=LINES.size))  # another phase at every line
    given = measured(rough, np.full(LINES.size, 1e-3), 3)
    smooth, unsure = (each[:, 0, 1] for each in smooth_shares(given))
    assert np.mean(np.abs(smooth - rough) < 1.731 * unsure) > 0.9


@pytest.mark.parametrize("key", ["real", "imag", "deviation"])
def test_coupled_response__with_a_matrix_of_another_shape__is_refused(key: str) -> None:
    parts = {name: np.tile(np.eye(2), (9, 1, 1)) for name in ("real", "imag", "deviation")}
    with pytest.raises(BadInput, match=key):
        CoupledResponse(("a", "b"), np.geomspace(1.0, 9.0, 9), **(parts | {key: np.ones((8, 2, 2))}))


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        (Environment(hum_hz=(50.0, 100.0), hum_v_peak=(1e-3, 1e-3)), 50.0),
        (Environment(assumed=("hum",)), 77.0),
        (Environment(hum_hz=(), hum_v_peak=()), 77.0),
    ],
)
def test_mains__nothing_asked__is_the_lowest_line_of_hum_that_is_stated(environment, expected: float) -> None:
    display = Display("one", 4000.0, 1, (replace(INDEX, environment=environment),))
    assert display.mains_hz(None, 77.0) == expected
    assert display.mains_hz(0.0, 77.0) == 0.0
