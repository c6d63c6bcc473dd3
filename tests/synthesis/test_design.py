"""Assembled controllers: sections, anti-windup, headroom, and what a finger feels of them on the simulated display."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import BadInput, NoDesign
from tactuator.model.controller import AntiWindup, Controller
from tactuator.model.description import Converter, Display, Recorded, Threshold
from tactuator.model.requirements import FeedbackRequirements
from tactuator.perception.curve import curve
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis import design as module
from tactuator.synthesis import paper
from tactuator.synthesis.design import design_controller, headroom
from tactuator.synthesis.felt import dahl_harmonic
from tactuator.synthesis.sections import anti_windup, feedback_sections
from tests.synthesis.displays import (
    channel,
    of,
    paper_alone,
    paper_controller,
    three_finger_controller,
    three_fingers,
    with_structure,
)

RATE_HZ = 4000.0


def paper_loop() -> TwoDegreeLoop:
    own = paper_controller().channels[0]
    plant = zero_order_hold(paper.PLANT, RATE_HZ, 1)
    return TwoDegreeLoop(own.prefilter(RATE_HZ), own.feedback(RATE_HZ), plant)


def test_design__paper_structure__is_the_papers_c() -> None:
    system = paper_controller().channels[0].feedback(RATE_HZ)
    assert system is not None
    frequency = np.geomspace(0.1, 1900.0, 40)
    assert np.allclose(system.response(frequency), bilinear(paper.FEEDBACK, RATE_HZ).response(frequency), rtol=1e-9)


def test_design__given_controller__taken_as_given() -> None:
    given = ContinuousSystem.from_polynomials([20.0, 400.0], [1.0, 300.0])
    limits = replace(paper_alone().channels[0].feedback, structure="paper", controller=given)
    own = design_controller(paper_alone(), 4).channels[0]
    other = design_controller(replace(paper_alone(), channels=(channel(loads=(), feedback=limits),)), 4).channels[0]
    assert own.anti_windup.gains != (0.0, 0.0)
    assert other.anti_windup == AntiWindup((0.0, 0.0))


def test_threshold_voltage_dc__is_the_curve_at_rest() -> None:
    for own, one in zip(three_finger_controller().channels, three_fingers().channels, strict=True):
        wanted = float(one.threshold_voltage(0.0))
        assert 20.0 * np.log10(own.threshold_voltage_dc / wanted) == pytest.approx(0.0, abs=1.3)


def test_prefilter_sections__first_holds_the_gain__others_unity_at_rest() -> None:
    sections = three_finger_controller().channels[0].prefilter_sos
    at_rest = sections[:, :3].sum(axis=1) / sections[:, 3:].sum(axis=1)
    assert at_rest[1:] == pytest.approx(np.ones(len(sections) - 1), rel=1e-6)


def test_feedback_sections__many_poles__integrator_last_and_exact() -> None:
    system = SampledSystem(
        [0.99 + 0.01j, 0.99 - 0.01j, 0.97, 0.9, -0.2, 0.5], [1.0, 0.93, 0.8 + 0.1j, 0.8 - 0.1j, 0.7, 0.6], 3.0, RATE_HZ
    )
    sections = feedback_sections(system)
    assert sections.shape == (3, 6)
    assert sections[-1, 3:].sum() == 0.0
    frequency = np.geomspace(1.0, 1900.0, 30)
    found = SampledSystem.from_sections(sections, RATE_HZ).response(frequency)
    assert np.allclose(found, system.response(frequency), rtol=1e-9)


@pytest.mark.parametrize("zeros", [[], [0.99], [0.99, 0.9], [0.99 + 0.01j, 0.99 - 0.01j]])
@pytest.mark.parametrize("others", [[], [0.9], [0.9, 0.8], [0.9 + 0.1j, 0.9 - 0.1j]])
def test_feedback_sections__any_shape__same_response(zeros: list[complex], others: list[complex]) -> None:
    if len(zeros) > 1 + len(others):
        return
    system = SampledSystem(zeros, [1.0, *others], 2.0, RATE_HZ)
    found = SampledSystem.from_sections(feedback_sections(system), RATE_HZ)
    frequency = np.geomspace(1.0, 1900.0, 20)
    assert np.allclose(found.response(frequency), system.response(frequency), rtol=1e-9)


def test_anti_windup__rule__poles_of_the_saturated_section() -> None:
    """d^2 + (a1 + g1) d + g2 has its roots at the section's own pole and at exp(-2 pi crossover / rate) - 1."""
    sections = feedback_sections(bilinear(paper.FEEDBACK, RATE_HZ))
    g1, g2 = anti_windup(sections, 20.48, RATE_HZ).gains
    own = 2.0 + sections[-1, 4]
    wanted = sorted([-own, np.expm1(-2.0 * np.pi * 20.48 / RATE_HZ)])
    assert np.sort(np.roots([1.0, own + g1, g2])) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(
    ("controller", "most_swing_v"), [(paper_controller, 0.1), (three_finger_controller, 5.0)], ids=["paper", "ours"]
)
def test_anti_windup__force_beyond_the_command__lets_go_without_swinging_to_the_stop(
    controller: Callable[[], Controller], most_swing_v: float
) -> None:
    """A finger presses harder than the motor can for one second, then lets go: without the correction the position
    swings to the other end of its range; with it, it comes back within a second and a half."""
    designed = controller()
    without = [replace(own, anti_windup=AntiWindup((0.0, 0.0))) for own in designed.channels]
    position = _after_a_press(designed)
    assert position.min() > -most_swing_v
    assert np.abs(position[6000:]).max() < 0.02
    assert _after_a_press(replace(designed, channels=tuple(without))).min() < -9.9


def _after_a_press(controller: Controller) -> np.ndarray:
    """The index finger's position (V) in the two seconds after a second of +15 V of force."""
    rig = SimulatedRig(controller.display, 1)
    rig.load(controller)
    rig.finger("index").press(np.full(4000, 15.0))
    trace = rig.play(np.zeros((12_000, len(controller.channels))))
    assert trace.saturated[:4000].any()
    return trace.position_v[4000:, 0]


def test_headroom__paper_loop__saturates_just_above_300_hz_at_50_db_sl() -> None:
    """facts, section 1: 50 dB SL asks 1.35 V at 10 Hz, 5.5 V at 100 Hz, 6.2 V at 200 Hz, 9.8 V at 300 Hz."""
    loop = paper_loop()
    frequency = np.array([10.0, 100.0, 200.0, 300.0])
    asked = 10.0 ** (50.0 / 20.0) * np.abs(loop.command_response(frequency))
    assert asked == pytest.approx([1.35, 5.5, 6.2, 9.8], rel=0.08)
    found = headroom(paper_alone().channels[0], loop, frequency, 55.0)
    assert found.binding == ("comfort", "comfort", "command", "command")
    assert 50.0 < found.level_db_sl[-1] < 51.0


def test_headroom__offset_at_the_motor__takes_its_share() -> None:
    loop, frequency = paper_loop(), np.array([300.0])
    plain = headroom(paper_alone().channels[0], loop, frequency, 55.0)
    shifted = headroom(channel(converter=Converter(offset_v=5.0)), loop, frequency, 55.0)
    assert plain.level_db_sl - shifted.level_db_sl == pytest.approx([6.02], abs=0.01)


def test_headroom__little_travel__binds_at_low_frequencies() -> None:
    found = headroom(channel(travel_mm=0.5), paper_loop(), np.array([0.5, 100.0]), 55.0)
    assert found.binding == ("travel", "comfort")


def test_report__keys_and_types__as_the_command_prints_them() -> None:
    report = three_finger_controller().channels[0].report
    assert {"crossover_hz", "phase_margin_deg", "gain_margin_db", "sensitivity_peak", "disk_margin"} <= set(
        report["margins"]
    )
    assert report["margins"]["delay_margin_samples"] > 1.0
    assert list(report["rejection_db"]) == ["mean", "1", "5", "10"]
    assert list(report["mains_db"]) == ["60", "120", "180"]
    assert {"poles", "max_error_db", "rms_error_db"} <= set(report["prefilter"])
    rooms = report["headroom_db_sl"]
    assert len(rooms["frequency_hz"]) == len(rooms["level"]) == len(rooms["binding"])
    assert set(rooms["binding"]) <= {"travel", "command", "comfort"}


def test_design__poles_and_error_both__refused() -> None:
    with pytest.raises(BadInput, match="one of them"):
        design_controller(paper_alone(), 4, 0.3)


def test_design__error_given__fewest_poles() -> None:
    own = design_controller(with_structure(paper_alone(), "paper"), None, 0.35).channels[0]
    assert own.report["prefilter"]["poles"] == 6


def test_design__no_loop__prefilter_to_volts_of_command() -> None:
    display = with_structure(paper_alone(), "none")
    own = design_controller(display, 8).channels[0]
    assert own.feedback_sos is None
    frequency = np.geomspace(0.4, 300.0, 50)
    response = own.prefilter(RATE_HZ).response(frequency) * zero_order_hold(paper.PLANT, RATE_HZ, 1).response(frequency)
    error = 20.0 * np.log10(np.abs(response) / display.channels[0].threshold_voltage(frequency))
    assert np.abs(error).max() <= 0.5
    assert "margins" not in own.report


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (ContinuousSystem.from_polynomials([1.0], [1.0, -94.0, 290.0]), "nothing satisfies the requirements"),
        (ContinuousSystem.from_polynomials([1.0, 1.0, 1.0, 3.0], [1.0, 94.0, 290.0]), "is improper"),
        (ContinuousSystem.from_polynomials([1.0, -3.0], [1.0, 94.0, 290.0]), "negative gain at rest"),
        (ContinuousSystem([], [-1.0, -2.0], 0.0), "has zero gain"),
        (ContinuousSystem.from_polynomials([-1.0], [1.0, 94.0, 290.0]), "negate one of the record"),
        (ContinuousSystem([], [-500.0 + 15_000.0j, -500.0 - 15_000.0j], 1e9), "above half the rate"),
        (ContinuousSystem.from_polynomials([5.0, 0.0], [1.0, 94.0, 290.0]), "gives nothing at rest"),
    ],
    ids=["unstable", "improper", "non-minimum-phase", "zero gain", "negative", "above Nyquist", "nothing at rest"],
)
def test_design__unsuitable_plant__each_its_own_sentence(plant: ContinuousSystem, words: str) -> None:
    with pytest.raises((BadInput, NoDesign), match=words) as caught:
        design_controller(of(plant))
    assert "allowed:" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_design__plant_that_grows_of_a_model_not_to_be_trusted__is_refused_at_once() -> None:
    """It was searched for minutes."""
    display = of(ContinuousSystem.from_polynomials([1.0], [1.0, -94.0, 290.0]))
    (channel,) = display.channels
    channel = replace(channel, recorded=Recorded(distrust=("poles that grow, where no feedback is seen",)))
    with pytest.raises(BadInput, match=r"not to be trusted: poles that grow.*the plant grows by itself"):
        design_controller(replace(display, channels=(channel,)))


def test_dahl_harmonic__great_motion__that_of_a_square_wave() -> None:
    """Coulomb friction against x = Y cos: 4 F/pi, a quarter of a period ahead."""
    (found,) = dahl_harmonic(np.array([1000.0]), 4e-3, 10e-3)
    assert abs(found) == pytest.approx(4.0 / np.pi * 4e-3, rel=1e-2)
    assert np.degrees(np.angle(found)) == pytest.approx(90.0, abs=1.0)


def test_dahl_harmonic__small_motion__that_of_a_spring() -> None:
    """Well within presliding: F/x0 volts of command per volt of position, in phase."""
    (found,) = dahl_harmonic(np.array([1e-5]), 4e-3, 10e-3)
    assert found.real == pytest.approx(4e-3 / 10e-3 * 1e-5, rel=1e-2)
    assert abs(found.imag) < 0.01 * found.real


def felt_error_db(controller: Controller, frequency_hz: float, level_db_sl: float) -> dict[str, float]:
    """What a finger feels against the curve, by lock-in at the finger ports, friction and all."""
    rig = SimulatedRig(controller.display, 5)
    rig.load(controller)
    felt: dict[str, list[np.ndarray]] = {name: [] for name in rig.channels}
    for name in rig.channels:
        rig.finger(name).attach(felt[name].append)
    settle = round(RATE_HZ * max(2.0 / frequency_hz, 1.5))
    count = settle + round(RATE_HZ * max(10.0 / frequency_hz, 0.5))
    phase = 2.0 * np.pi * frequency_hz * np.arange(count) / RATE_HZ
    ramp = np.minimum(np.arange(count) / (0.6 * settle), 1.0)
    wave = 10.0 ** (level_db_sl / 20.0) * ramp * np.sin(phase)
    rig.play(np.repeat(wave[:, None], len(rig.channels), axis=1))
    hum = 2.0 * np.pi * 60.0 * np.arange(count) / RATE_HZ
    shapes = [np.sin(phase), np.cos(phase), np.ones(count), np.sin(hum), np.cos(hum)]
    columns = np.column_stack(shapes)[settle:]
    errors = {}
    for one in controller.display.channels:
        moved = np.concatenate(felt[one.name])[settle:]
        sine, cosine, *_ = np.linalg.lstsq(columns, moved, rcond=None)[0]
        wanted = float(one.threshold.curve.displacement_mm(frequency_hz)) * 10.0 ** (level_db_sl / 20.0)
        errors[one.name] = float(20.0 * np.log10(np.hypot(sine, cosine) / wanted))
    return errors


@pytest.mark.parametrize(("level_db_sl", "most_db"), [(10.0, 0.8), (20.0, 0.5), (50.0, 0.5)])
@pytest.mark.parametrize("frequency_hz", [4.5, 10.0, 28.0, 200.0])
def test_felt_response__eight_poles_unloaded__follows_the_curve(
    frequency_hz: float, level_db_sl: float, most_db: float
) -> None:
    errors = felt_error_db(three_finger_controller(8), frequency_hz, level_db_sl)
    assert max(abs(error) for error in errors.values()) <= most_db


MODELS = tuple(
    ContinuousSystem.from_polynomials([gain], [1.0, damping, 0.0])
    for gain, damping in ((1.5545, 1.0575), (1.5534, 1.0648), (1.5555, 1.0502))
)


def display(noise_gain: float) -> Display:
    """A display to 30 Hz around the motor, for the models that its record does not exclude."""
    limits = FeedbackRequirements(command_noise_gain_max=noise_gain)
    made = channel(plant=MODELS[0], loads=(), sensor_gain_v_per_mm=0.05, feedback=limits)
    made = replace(made, family=MODELS[1:], threshold=Threshold(curve("bolanowski-1988"), (0.4, 30.0)))
    return Display("motor", 4000.0, 1, (made,))


@pytest.mark.slow
def test_design__motor_without_a_spring__finds_a_loop() -> None:
    margins = design_controller(display(3000.0)).channels[0].report["margins"]
    assert margins["phase_margin_deg"] >= 50.0
    assert margins["command_noise_gain"] <= 3000.0


@pytest.mark.soak
def test_design__noise_gain_that_the_motor_cannot_keep__is_told_with_one_that_it_can() -> None:
    with pytest.raises(NoDesign, match="command_noise_gain_max 30") as refused:
        design_controller(display(30.0))
    possible = re.search(r"all others kept: command_noise_gain_max (\S+)", str(refused.value))
    assert possible is not None
    assert design_controller(display(float(possible.group(1)))).channels


def test_design__model_that_ends_below_the_band__is_told_before_the_loops_limits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "synthesise", lambda *_: iter(()))  # what is told of the limits has tests of its own
    monkeypatch.setattr(module, "diagnosis", lambda _: "nothing satisfies the requirements")
    ends = "band_hz is [0.4, 300], but the plant is known from 0.2 to {} Hz only (valid_hz)"
    for last, then in ((9.0, "; allowed: a model that is valid at 10 Hz"), (100.0, "; nothing satisfies")):
        one = replace(paper_alone().channels[0], valid_hz=(0.2, last))
        with pytest.raises((BadInput, NoDesign), match=re.escape(ends.format(f"{last:g}") + then)):
            design_controller(replace(paper_alone(), channels=(one,)), 4)
