"""Assembled controllers, on the simulated display too; to and from python-control, and back to continuous form."""

import re
import sys
from dataclasses import replace

import control
import numpy as np
import pytest
from scipy import signal

from tactuator.api.designed import ControllerResult
from tactuator.errors import BadInput, NoDesign
from tactuator.model.controller import AntiWindup, Controller
from tactuator.model.description import Converter, Recorded
from tactuator.model.requirements import Objectives
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.discretise import discretise
from tactuator.signals.exchange import from_control, to_control
from tactuator.signals.loop import FeedbackLoop, TwoDegreeLoop, UnstableLoop, step_response
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis import design as module
from tactuator.synthesis import paper
from tactuator.synthesis.design import design_controller, first_alike, headroom
from tactuator.synthesis.felt import dahl_harmonic
from tactuator.synthesis.sections import anti_windup, feedback_sections
from tests.synthesis import displays
from tests.synthesis.displays import channel, of, paper_alone, paper_controller, three_finger_controller, three_fingers

RATE_HZ = 4000.0


def paper_loop() -> TwoDegreeLoop:
    own = paper_controller().channels[0]
    plant = discretise(paper.PLANT, RATE_HZ, "zoh", 1)
    return TwoDegreeLoop(own.prefilter(RATE_HZ), own.feedback(RATE_HZ), plant)


def test_design__paper_structure__is_the_papers_c() -> None:
    system = paper_controller().channels[0].feedback(RATE_HZ)
    frequency = np.geomspace(0.1, 1900.0, 40)
    assert np.allclose(
        system.response(frequency), discretise(paper.FEEDBACK, RATE_HZ, "bilinear").response(frequency), rtol=1e-9
    )


def test_design__given_controller__taken_as_given() -> None:
    given = ContinuousSystem.from_polynomials([20.0, 400.0], [1.0, 300.0])
    limits = replace(paper_alone().channels[0].feedback, structure="paper", controller=given)
    own = design_controller(paper_alone(), 4).channels[0]
    other = design_controller(replace(paper_alone(), channels=(channel(loads=(), feedback=limits),)), 4).channels[0]
    assert own.anti_windup.gains != (0.0, 0.0)
    assert other.anti_windup == AntiWindup((0.0, 0.0))


FIVE = [0.93, 0.8 + 0.1j, 0.8 - 0.1j, 0.7, 0.6]


@pytest.mark.parametrize(
    ("zeros", "others"),
    [
        *(([], others) for others in ([], [0.9], [0.9, 0.8], [0.9 + 0.1j, 0.9 - 0.1j])),
        ([0.99], []),
        ([0.99, 0.9], [0.9, 0.8]),
        ([0.99 + 0.01j, 0.99 - 0.01j], [0.9]),
        ([0.99 + 0.01j, 0.99 - 0.01j], [0.9 + 0.1j, 0.9 - 0.1j]),
        ([0.99 + 0.01j, 0.99 - 0.01j, 0.97, 0.9, -0.2, 0.5], FIVE),
    ],
)
def test_feedback_sections__any_shape__same_response_and_integrator_last(zeros, others) -> None:
    system = SampledSystem(zeros, [1.0, *others], 2.0, RATE_HZ)
    sections = feedback_sections(system)
    assert sections[-1, 3:].sum() == 0.0
    frequency = np.geomspace(1.0, 1900.0, 30)
    found = SampledSystem.from_sections(sections, RATE_HZ).response(frequency)
    assert np.allclose(found, system.response(frequency), rtol=1e-9)


def test_anti_windup__rule__poles_of_the_saturated_section() -> None:
    """d^2 + (a1 + g1) d + g2 has its roots at the section's own pole and at exp(-2 pi crossover / rate) - 1."""
    sections = feedback_sections(discretise(paper.FEEDBACK, RATE_HZ, "bilinear"))
    g1, g2 = anti_windup(sections, 20.48, RATE_HZ).gains
    own = 2.0 + sections[-1, 4]
    wanted = sorted([-own, np.expm1(-2.0 * np.pi * 20.48 / RATE_HZ)])
    assert np.sort(np.roots([1.0, own + g1, g2])) == pytest.approx(wanted, rel=1e-9)


def test_anti_windup__force_beyond_the_command__does_not_swing_to_the_stop() -> None:
    """Without the correction the position swings to the other end of its range."""
    for designed, most_swing_v in ((paper_controller(), 0.1), (three_finger_controller(), 5.0)):
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


def test_headroom__paper_loop__ends_at_the_command_less_its_offset_or_at_the_travel() -> None:
    """facts, section 1: 50 dB SL asks 1.35 V at 10 Hz, 5.5 V at 100 Hz, 6.2 V at 200 Hz, 9.8 V at 300 Hz."""
    loop = paper_loop()
    frequency = np.array([10.0, 100.0, 200.0, 300.0])
    asked = 10.0 ** (50.0 / 20.0) * np.abs(loop.command_response(frequency))
    assert asked == pytest.approx([1.35, 5.5, 6.2, 9.8], rel=0.08)
    found = headroom(paper_alone().channels[0], loop, frequency, 55.0)
    assert found.binding == ("comfort", "comfort", "command", "command")
    assert 50.0 < found.level_db_sl[-1] < 51.0
    shifted = headroom(channel(converter=Converter(offset_v=5.0)), loop, frequency[-1:], 55.0)
    assert found.level_db_sl[-1:] - shifted.level_db_sl == pytest.approx([6.02], abs=0.01)
    felt_less = headroom(paper_alone().channels[0], loop, np.array([300.0]), 30.0)  # F is far too low there
    assert (felt_less.binding, felt_less.level_db_sl.tolist()) == (("comfort",), [30.0])  # no more may be asked
    short = headroom(channel(travel_mm=0.5), loop, np.array([0.5, 100.0]), 55.0)
    assert short.binding == ("travel", "comfort")


def test_design__three_fingers__report_as_the_command_prints_it() -> None:
    for own, one in zip(three_finger_controller().channels, three_fingers().channels, strict=True):
        wanted = float(one.threshold_voltage(0.0))
        assert 20.0 * np.log10(own.threshold_voltage_dc / wanted) == pytest.approx(0.0, abs=1.3)
        at_rest = own.prefilter_sos[:, :3].sum(axis=1) / own.prefilter_sos[:, 3:].sum(axis=1)
        assert at_rest[1:] == pytest.approx(np.ones(len(own.prefilter_sos) - 1), rel=1e-6)
    report = own.report
    margins = {"crossover_hz", "phase_margin_deg", "gain_margin_db", "sensitivity_peak", "disk_margin"}
    assert margins <= set(report["margins"])
    assert report["margins"]["delay_margin_samples"] > 1.0
    assert (list(report["rejection_db"]), list(report["mains_db"])) == (["mean", "1", "5", "10"], ["60", "120", "180"])
    assert {"poles", "max_error_db", "rms_error_db"} <= set(report["prefilter"])
    rooms = report["headroom_db_sl"]
    assert len(rooms["frequency_hz"]) == len(rooms["level"]) == len(rooms["binding"])
    assert set(rooms["binding"]) <= {"travel", "command", "comfort"}


def test_design__channels_alike__each_as_good_as_designed_alone() -> None:
    """The search starts from the first channel's loop where plants are near each other."""
    shown = three_fingers()
    first, *others = shown.channels
    assert [first_alike(shown, other) for other in shown.channels] == [None, first, first]
    for other in others:
        near = three_finger_controller().channel(other.name).report
        alone = design_controller(replace(shown, channels=(other,)), 8).channels[0].report
        assert near["rejection_db"]["mean"] < alone["rejection_db"]["mean"] + 0.05
        assert near["prefilter"]["max_error_db"] < 1.1 * alone["prefilter"]["max_error_db"]


def test_design__poles_and_error_both__refused() -> None:
    with pytest.raises(BadInput, match="one of them"):
        design_controller(paper_alone(), 4, 0.3)


def test_design__no_loop__prefilter_to_volts_of_command() -> None:
    display = displays.with_structure(paper_alone(), "none")
    own = design_controller(display, 8).channels[0]
    assert own.feedback_sos is None
    frequency = np.geomspace(0.4, 300.0, 50)
    response = own.prefilter(RATE_HZ).response(frequency) * discretise(paper.PLANT, RATE_HZ, "zoh", 1).response(
        frequency
    )
    error = 20.0 * np.log10(np.abs(response) / display.channels[0].threshold_voltage(frequency))
    assert np.abs(error).max() <= 0.5
    assert "margins" not in own.report


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (ContinuousSystem.from_polynomials([1.0, -3.0], [1.0, 94.0, 290.0]), "negative gain at rest"),
        (ContinuousSystem.from_polynomials([-1.0], [1.0, 94.0, 290.0]), "negate one of the record"),
        (ContinuousSystem([], [-500.0 + 15_000.0j, -500.0 - 15_000.0j], 1e9), "above half the rate"),
        (ContinuousSystem.from_polynomials([5.0, 0.0], [1.0, 94.0, 290.0]), "gives nothing at rest"),
    ],
    ids=["non-minimum-phase", "negative", "above Nyquist", "nothing at rest"],
)
def test_design__unsuitable_plant__each_its_own_sentence(plant: ContinuousSystem, words: str) -> None:
    with pytest.raises((BadInput, NoDesign), match=words) as caught:
        design_controller(of(plant))
    assert "; " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_design__plant_that_grows_of_a_model_not_to_be_trusted__is_refused_at_once() -> None:
    display = of(ContinuousSystem.from_polynomials([1.0], [1.0, -94.0, 290.0]))
    (channel,) = display.channels
    channel = replace(channel, recorded=Recorded(distrust=("unstable poles, but no feedback detected",)))
    with pytest.raises(
        BadInput, match=r"the plant grows by itself(.|\n)*likely why: .*not to be trusted: unstable poles"
    ):
        design_controller(replace(display, channels=(channel,)))


def test_dahl_harmonic__great_or_small_motion__that_of_a_square_wave_or_a_spring() -> None:
    """Coulomb friction against x = Y cos: 4 F/pi, a quarter of a period ahead; within presliding F/x0."""
    great, small = dahl_harmonic(np.array([1000.0, 1e-5]), 4e-3, 10e-3)
    assert great == pytest.approx(4.0 / np.pi * 4e-3 * 1j, rel=2e-2)
    assert small == pytest.approx(4e-3 / 10e-3 * 1e-5, rel=1e-2)


def test_design__model_that_ends_below_the_band__is_told_before_the_loops_limits(monkeypatch) -> None:
    monkeypatch.setattr(module, "synthesise", lambda *_: iter(()))  # what is told of the limits has tests of its own
    monkeypatch.setattr(module, "diagnosis", lambda _: ["binding: none"])
    ends = "band_hz is [0.4, 300], but the plant is known from 0.2 to {} Hz only (valid_hz)"
    for last, then in ((9.0, "; expected a model that is valid at 10 Hz"), (100.0, "\nbinding: none")):
        one = replace(paper_alone().channels[0], valid_hz=(0.2, last))
        with pytest.raises((BadInput, NoDesign), match=re.escape(ends.format(f"{last:g}") + then)):
            design_controller(replace(paper_alone(), channels=(one,)), 4)


def test_design__no_loop_found__a_sentence_and_a_short_line_for_each_thing_that_helps(monkeypatch) -> None:
    monkeypatch.setattr(module, "synthesise", lambda *_: iter(()))
    monkeypatch.setattr(module, "diagnosis", lambda _: ["binding: a", "works, all others kept: b"])
    one = replace(paper_alone().channels[0], travel_mm=12.4)  # no other test designs it, and keeps what comes
    with pytest.raises(NoDesign) as caught:
        design_controller(replace(paper_alone(), channels=(one,)), 4)
    sentence, *helps = caught.value.lines
    assert sentence == "channel 'index': the search, which is local, found no loop within the limits"
    assert helps == ["binding: a", "works, all others kept: b"]


def test_design__resonance_peak_below_that_at_rest__is_refused_by_its_key() -> None:
    asked = replace(paper_alone(), objectives=Objectives(resonance_peak=0.9))
    with pytest.raises(BadInput, match=r"^resonance_peak is 0\.9; it must be 1 or more"):
        design_controller(asked, 4)


FREQUENCY = np.geomspace(0.3, 1500.0, 25)


@pytest.mark.parametrize("system", [paper.PLANT, paper.FEEDBACK, paper.PREFILTER], ids=["P", "C", "F"])
def test_to_control__continuous__same_response_and_back(system: ContinuousSystem) -> None:
    made = to_control(system)
    assert made.dt == 0
    assert np.allclose(made(2j * np.pi * FREQUENCY), system.response(FREQUENCY), rtol=1e-9)
    back = from_control(made)
    assert isinstance(back, ContinuousSystem)
    assert np.allclose(back.response(FREQUENCY), system.response(FREQUENCY), rtol=1e-7)


def test_to_control__sampled_with_delay__same_response_and_back() -> None:
    own = three_finger_controller().channels[0]
    feedback = own.feedback(RATE_HZ)
    for system in (own.prefilter(RATE_HZ), feedback, discretise(paper.PLANT, RATE_HZ, "zoh", 1)):
        made = to_control(system)
        assert made.dt == pytest.approx(1.0 / RATE_HZ)
        response = np.array([made(np.exp(2j * np.pi * f / RATE_HZ)) for f in FREQUENCY])
        assert np.allclose(response, system.response(FREQUENCY), rtol=1e-7)
        back = from_control(made)
        assert isinstance(back, SampledSystem)
        assert np.allclose(back.response(FREQUENCY), system.response(FREQUENCY), rtol=1e-4)


@pytest.mark.parametrize(
    ("exchange", "system", "words"),
    [
        (from_control, control.ss(-np.eye(2), np.eye(2), np.ones((1, 2)), np.zeros((1, 2))), "2 inputs"),
        (from_control, control.tf([1.0], [1.0, 0.5], True), "sampling period is True"),
        (to_control, ContinuousSystem([], [-1.0], 1.0, 0.01), "no dead time"),
        (to_control, ContinuousSystem([-1.0, -2.0], [-3.0], 1.0), "no more zeros than poles"),
    ],
)
def test_exchange__what_the_other_does_not_have__refused(exchange, system, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        exchange(system)


def test_to_control__package_missing__says_how(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(BadInput, match="pip install control"):
        to_control(paper.PLANT)


def test_controller__margins_of_a_loop__are_python_control_s() -> None:
    controller = ControllerResult.of(design_controller(three_fingers(), 4))
    loop = controller.loop("index", "finger")
    hertz = np.geomspace(0.1, 1900.0, 20_000)
    data = control.frd(loop.open_response(hertz), 2.0 * np.pi * hertz, smooth=True)
    _, phase, *_, crossover, _ = control.stability_margins(data)
    mine = controller.margins("index", "finger")
    assert mine.phase_margin_deg == pytest.approx(phase, rel=1e-4)
    assert mine.crossover_hz == pytest.approx(crossover / (2.0 * np.pi), rel=1e-4)


def test_step__paper_loop__a_loop_run_sample_by_sample_gives_it() -> None:
    controller = ControllerResult.of(design_controller(three_fingers(), 4))
    loop = controller.loop("index", "finger")
    c, p = loop.controller.sections(), loop.plant.sections()
    c_state, p_state = np.zeros((len(c), 2)), np.zeros((len(p), 2))
    delayed = [0.0] * loop.plant.delay_samples
    position = []
    for _ in range(4000):
        position.append(delayed[-1])
        command, c_state = signal.sosfilt(c, [1.0 - position[-1]], zi=c_state)
        moved, p_state = signal.sosfilt(p, command, zi=p_state)
        delayed = [moved[0], *delayed[:-1]]
    assert step_response(loop, 1.0) == pytest.approx(position, abs=1e-8)
    with pytest.raises(UnstableLoop):
        step_response(FeedbackLoop(loop.controller, loop.plant * loop.plant), 1.0)
