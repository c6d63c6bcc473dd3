"""Synthesised loops: every limit kept on every plant; prefilters: the least error there is, stable, bounded above."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController
from tactuator.model.description import Channel, Display, Threshold
from tactuator.perception.curve import ThresholdCurve, curve
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import FeedbackLoop, TwoDegreeLoop, UnstableLoop
from tactuator.signals.magnitude import MagnitudeGoal, fit_magnitude
from tactuator.signals.systems import ContinuousSystem, SampledSystem, sections_response
from tactuator.synthesis import paper
from tactuator.synthesis import prefilter as fit
from tactuator.synthesis.assessment import all_kept, assess, command_noise_gain
from tactuator.synthesis.candidates import COUNT
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.family import plant_family
from tactuator.synthesis.limits import Limit, Task, loop_limits
from tactuator.synthesis.prefilter import PrefilterFit, fit_prefilter, response_error_db
from tactuator.synthesis.problem import LoopProblem
from tests.synthesis.displays import channel, of, paper_alone, three_finger_controller, three_fingers
from witnesses.loops.search import Judge, delivered, drawn, named

MOST_DB = {
    "LRA 175 Hz Q 15": -72.5,
    "voice coil": -56.4,
    "piezo 250 Hz Q 50": -74.5,
    "3 ms of dead time": -25.8,
    "90/80 Hz pair": -38.3,
    "drawn 7: with a mode": -20.1,
    "drawn 14: no spring": -40.7,
    "drawn 15: with a mode": -23.5,
    "drawn 25: motor": -41.4,
}
"""What a search from outside knows at best (witnesses.loops.search), less 1 dB; less 0.1 dB for slow modes."""
PLANTS = {plant.name: plant for plant in [*named(), *drawn(26)]}


SLOW = ("90/80 Hz pair", "drawn 14: no spring", "drawn 15: with a mode", "drawn 25: motor")
MARKS = dict.fromkeys(SLOW, pytest.mark.slow)


@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, ())) for name in MOST_DB])
def test_synthesise__plants_of_the_list__within_1_db_of_the_best_known(name) -> None:
    found, _ = delivered(PLANTS[name])
    assert found is not None
    zeros, poles, gain = found.zeros, found.poles, found.gain
    judge = Judge(PLANTS[name])
    mean, excess = judge.figures(zeros, poles, gain)
    assert excess < 2e-3
    assert judge.is_stable(zeros, poles, gain)
    assert mean <= MOST_DB[name]
    assert judge.figures(zeros, poles, 2.0 * gain)[1] > 0.02


RATE_HZ = 4000.0


def kept(own: ChannelController, one: Channel, rate_hz: float = RATE_HZ) -> bool:
    feedback = own.feedback(rate_hz)
    assessments = assess(feedback, plant_family(one, rate_hz, 1), one.feedback.rejection_band_hz)
    return all_kept(assessments, loop_limits(one.feedback))


def test_assess__paper_c__keeps_its_own_limits_with_the_mean_of_the_facts() -> None:
    """facts, section 1: mean |S| of -22.51 dB over 0.4-10 Hz, noise gain 12, every limit of paper.toml kept."""
    one = paper_alone().channels[0]
    band_hz = one.feedback.rejection_band_hz
    (assessment,) = assess(discretise(paper.FEEDBACK, RATE_HZ, "bilinear"), plant_family(one, RATE_HZ, 1), band_hz)
    assert assessment.mean_rejection_db == pytest.approx(-22.51, abs=0.005)
    assert assessment.noise_gain == pytest.approx(12.0, abs=0.3)
    assert all_kept((assessment,), loop_limits(one.feedback))


def test_synthesise__paper_limits__18_db_better_than_the_papers_c() -> None:
    display = paper_alone()
    own = design_controller(display, 4).channels[0]
    assert kept(own, display.channels[0])
    assert own.report["rejection_db"]["mean"] <= -22.51 - 1.8
    assert len(own.feedback_sos) <= 3
    assert own.report["prefilter"]["max_error_db"] <= 0.70


def test_synthesise__three_fingers__every_limit_on_every_load() -> None:
    for own, one in zip(three_finger_controller().channels, three_fingers().channels, strict=True):
        assert kept(own, one)
        assert own.designed_for == ("none", "finger")
        assert own.report["margins"]["complementary_peak"] <= 1.15 + 1e-6
        assert own.report["prefilter"]["max_error_db"] <= 0.25


def test_synthesise__identified_family__held_too() -> None:
    """The models that identification cannot tell apart count like loads."""
    family = tuple(
        ContinuousSystem.from_polynomials([2875.0 * gain], [1.0, 94.0 * damping, 290.0])
        for gain, damping in ((0.95, 1.05), (1.05, 0.95))
    )
    one = channel(family=family)
    display = Display(RATE_HZ, (one,), 1, "uncertain")
    own = design_controller(display, 4).channels[0]
    assert len(own.designed_for) == 6
    assert kept(own, one)


@pytest.mark.parametrize(
    "plant",
    [
        ContinuousSystem.from_polynomials([200.0], [1.0, 20.0]),
        ContinuousSystem.from_polynomials([2875.0 * 2000.0], np.polymul([1.0, 94.0, 290.0], [1.0, 2000.0])),
        ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0], 5e-4),
        ContinuousSystem.from_polynomials([10.0 * 942.0**2], [1.0, 2 * 0.1 * 942.0, 942.0**2]),
    ],
    ids=["first order", "third order", "dead time", "resonant at 150 Hz"],
)
def test_synthesise__other_plants__limits_kept_and_prefilter_within_05_db(plant: ContinuousSystem) -> None:
    display = of(plant)
    own = design_controller(display).channels[0]
    assert kept(own, display.channels[0])
    assert own.report["prefilter"]["max_error_db"] <= 0.5


@pytest.mark.parametrize("rate_hz", [2e3, 64e3])
def test_synthesise__other_rates__limits_kept(rate_hz: float) -> None:
    display = replace(three_fingers(), rate_hz=rate_hz, channels=(channel(),))
    assert kept(design_controller(display, 8).channels[0], display.channels[0], rate_hz)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"sensitivity_peak": 0.9}, "sensitivity_peak is 0.9; expected above 1"),
        ({"phase_margin_deg": 95.0}, "phase_margin_deg is 95; expected below 90"),
        ({"mains_hz": (10.0,), "mains_max_db": (-11.0,)}, "S \\+ T = 1"),
        ({"mains_hz": (1900.0,), "mains_max_db": (-11.0,)}, "mains_hz has 1900 Hz; expected below 1800"),
    ],
)
def test_synthesise__contradictory_requirements__each_its_own_sentence(limits: dict[str, object], words: str) -> None:
    one = channel(feedback=replace(three_fingers().channels[0].feedback, **limits))
    with pytest.raises(BadInput, match=words):
        design_controller(Display(RATE_HZ, (one,), 1, "contradiction"), 4)


def test_loop_problem__slopes__are_those_of_finite_differences() -> None:
    one = channel()
    problem = LoopProblem(Task.of(plant_family(one, RATE_HZ, 1), one.feedback, RATE_HZ, 1.15))
    values = [1.0, 17.0 / RATE_HZ, 2.7, 0.06, 0.05, 1.0, 0.1, 1.0, 0.09, 0.8, 0.09, 1.0]
    parameters = np.log(values)
    parameters[0] -= np.log(abs(problem.structure.system(parameters).response(20.0) * one.plant.response(20.0)))
    here = problem.at(parameters)
    for index in range(COUNT):
        step = np.zeros(COUNT)
        step[index] = 1e-6
        up, down = problem.at(parameters + step), problem.at(parameters - step)
        assert (up.mean_db - down.mean_db) / 2e-6 == pytest.approx(here.mean_slope[:, index], rel=1e-6, abs=1e-6)
        assert (up.excess - down.excess) / 2e-6 == pytest.approx(here.excess_slope[:, index], rel=1e-4, abs=1e-4)


def test_command_noise_gain__simulated_white_noise__agrees() -> None:
    """Against the impulse response of C S: the root of the sum of its squares."""
    one = channel()
    loop = FeedbackLoop(discretise(paper.FEEDBACK, RATE_HZ, "bilinear"), plant_family(one, RATE_HZ, 1)[0].sampled)
    frequency = np.arange(0, 2**15 + 1) * RATE_HZ / 2**16
    frequency[0] = 1e-6
    impulse = np.fft.irfft(loop.command_sensitivity(frequency))
    assert command_noise_gain(loop) == pytest.approx(np.sqrt(np.sum(impulse**2)), rel=1e-4)


@pytest.mark.parametrize(
    ("limit", "name", "unit", "kept", "missed", "excess", "excess_db"),
    [
        (Limit("|T|", -11.0, 60.0), "|T| dB at 60 Hz", "dB", -11.0, -9.5, 1.5, 1.5),
        (Limit("sensitivity_peak", 1.5), "sensitivity_peak", "1", 1.5, 3.0, 1.5, 6.0206),
        (Limit("phase_margin_deg", 50.0), "phase_margin_deg", "deg", 50.0, 40.0, 10.0, 2.0),
    ],
)
def test_limit__figures__kept_or_so_far_off_in_its_unit_and_on_the_common_scale(
    limit: Limit, name: str, unit: str, kept: float, missed: float, excess: float, excess_db: float
) -> None:
    assert (limit.name, limit.unit) == (name, unit)
    assert limit.kept(kept)
    assert not limit.kept(missed)
    assert limit.excess(missed) == pytest.approx(excess)
    assert limit.excess_db(missed) == pytest.approx(excess_db, abs=1e-4)
    assert limit.figure_at(float(limit.excess_db(missed))) == pytest.approx(missed)
    looser = limit.loosened(excess_db)
    assert looser.kept(missed)
    assert limit.loosened(-1.0) is None
    assert limit.under("finger").under(None) == limit


MORIOKA = Threshold(curve("morioka-griffin-2006"), (8.0, 315.0))


def fitted(one: Channel, poles: int, rate_hz: float = 4000.0) -> PrefilterFit:
    return fit_prefilter(one, discretise(paper.FEEDBACK, rate_hz, "bilinear"), rate_hz, 1, poles)


LIBRARY = Threshold(curve("bolanowski-1988"))


@pytest.mark.parametrize(
    ("finger", "threshold", "poles", "most_db"),
    [
        *((name, LIBRARY, *of) for name in ("index", "thumb", "middle") for of in ((4, 0.70), (6, 0.40), (8, 0.25))),
        ("index", MORIOKA, 5, 2.0),
        ("index", MORIOKA, 10, 0.35),
    ],
)
def test_fit_prefilter__paper_loop__near_the_least_possible_and_minimum_phase(
    finger: str, threshold: Threshold, poles: int, most_db: float
) -> None:
    fit = fitted(channel(finger, threshold=threshold), poles)
    assert fit.max_error_db <= most_db
    assert is_modest(fit, threshold, 1.0001)


def is_modest(fit: PrefilterFit, threshold: Threshold, most: float) -> bool:
    """Whether it is stable, of minimum phase, and passes nothing above its band harder than what is in it."""
    system = SampledSystem.from_sections(fit.sections, 4000.0)
    inside = np.abs(sections_response(fit.sections, np.geomspace(*threshold.band_hz, 3000), 4000.0))
    above = np.abs(sections_response(fit.sections, np.linspace(400.0, 2000.0, 5000), 4000.0))
    roots = np.concatenate([system.poles, system.zeros])
    return bool(np.abs(roots).max() < 1.0 and above.max() <= inside.max() * most)


def test_fit_prefilter__report__is_what_the_sections_do() -> None:
    """The error told is that of the sections on the sampled loop, at frequencies of its own."""
    one = channel()
    c = discretise(paper.FEEDBACK, 4000.0, "bilinear")
    fit = fit_prefilter(one, c, 4000.0, 1, 8)
    loop = TwoDegreeLoop(SampledSystem.from_sections(fit.sections, 4000.0), c, discretise(one.plant, 4000.0, "zoh", 1))
    error = response_error_db(one, loop, np.geomspace(0.4, 300.0, 777))
    assert np.abs(error).max() <= fit.max_error_db + 1e-3  # other frequencies than those of the report
    assert np.abs(error).max() >= fit.max_error_db - 0.02
    assert 0.3 * fit.max_error_db < fit.rms_error_db < fit.max_error_db


def test_fit_prefilter__no_poles_given__fewest_that_keep_the_tolerance() -> None:
    assert (
        fit_prefilter(
            channel(), discretise(paper.FEEDBACK, 4000.0, "bilinear"), 4000.0, 1, None, tolerance_db=0.35
        ).poles
        == 6
    )


def test_fit_prefilter__tolerance_beyond_reach__says_what_is_possible(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit, "MOST_POLES", 6)
    rough = ThresholdCurve("rough", [0.4, 3, 5, 20, 30, 60, 90, 300], [0, 0, 15, 15, 0, 0, 15, 0], "synthetic", "test")
    with pytest.raises(BadInput, match="6 poles leave a prefilter error of"):
        fit_prefilter(
            channel(threshold=Threshold(rough)), discretise(paper.FEEDBACK, 4e3, "bilinear"), 4e3, 1, None, 0.05
        )


def test_fit_prefilter__unstable_loop_or_undamped_zero_in_the_band__refused() -> None:
    c = discretise(paper.FEEDBACK, 4000.0, "bilinear")
    with pytest.raises(UnstableLoop):
        fit_prefilter(channel(), SampledSystem(c.zeros, c.poles, 50.0 * c.gain, 4000.0), 4000.0, 1, 4)
    plant = ContinuousSystem([100j, -100j], [-10.0, -2000.0, -30.0], 1e5)
    with pytest.raises(BadInput, match="more poles"):
        fit_prefilter(channel(plant=plant, loads=()), None, 4000.0, 1, 4)


EIGHT_HZ = [0.4, 1, 3, 10, 30, 100, 250, 300]
AT_HZ = np.geomspace(0.4, 300, 18)
CURVES = {
    "library": curve("bolanowski-1988"),
    "u": ThresholdCurve("u", EIGHT_HZ, [20, 19, 16, 8, -4, -14, -18, -17.5], "synthetic", "u"),
    "deep": ThresholdCurve("u", EIGHT_HZ, [20, 20, 19, 10, -5, -16, -20, -18], "synthetic", "u"),
    "broad": ThresholdCurve("u", AT_HZ, -18 + 36 * (np.log2(AT_HZ / 167) / 9) ** 2, "synthetic", "u"),
}
COIL = 2.0 * np.pi * 150.0
MOTOR = [1.0, 94.0, 290.0]


@pytest.mark.parametrize(
    ("plant", "felt", "most_db"),
    [
        (ContinuousSystem.from_polynomials([200.0], [1.0, 20.0]), "u", 0.5),
        (ContinuousSystem.from_polynomials([2e6], [1.0, 700.0, 1e6]), "library", 0.5),
        (ContinuousSystem.from_polynomials([2875.0 * 3000.0], np.polymul(MOTOR, [1.0, 3000.0])), "u", 0.5),
        (ContinuousSystem.from_polynomials([5e5], [1.0, 2 * 0.03 * 400.0, 400.0**2]), "library", 0.5),
        # hard for the solver, found in a survey: a root all but infinite, slender pairs, D over many decades
        (ContinuousSystem.from_polynomials([2875.0], MOTOR), "deep", 0.35),
        (ContinuousSystem.from_polynomials([2875.0 * 300], np.polymul(MOTOR, [1.0, 300.0])), "deep", 0.35),
        (ContinuousSystem.from_polynomials([1.2 * COIL**2], [1.0, 0.2 * COIL, COIL**2]), "library", 0.35),
        (ContinuousSystem.from_polynomials([5e5], [1.0, 24.0, 400.0**2]), "deep", 0.5),
        (ContinuousSystem([], [-5.0, -996.0, -4153.0], 50.0 * 996.0 * 4153.0), "broad", 0.2),
        # an accelerometer gives nothing at rest, which the prefilter does not try to mend
        (ContinuousSystem.from_polynomials([2.0, 0.0, 0.0], [1.0, 2 * 0.1 * 377.0, 377.0**2]), "library", 0.5),
    ],
)
def test_fit_prefilter__open_loop_on_other_plants__eight_poles_within_the_bound(plant, felt, most_db) -> None:
    threshold = Threshold(CURVES[felt])
    quantity = "acceleration" if plant.zeros.size else "displacement"
    fit = fit_prefilter(channel(plant=plant, quantity=quantity, threshold=threshold, loads=()), None, 4000.0, 1, 8)
    assert fit.max_error_db <= most_db
    assert is_modest(fit, threshold, 1.01)


@settings(max_examples=6)
@given(st.integers(0, 10_000), st.sampled_from([4, 6]))
def test_fit_magnitude__what_a_filter_of_that_order_does__recovered(seed: int, order: int) -> None:
    rng = np.random.default_rng(seed)
    middles = np.geomspace(1.5, 150.0, order)
    zeros, corners = (2.0 * np.pi * middles * np.exp(rng.uniform(-0.7, 0.7, order)) for _ in range(2))
    truth = SampledSystem(np.exp(-zeros / 4e3), np.exp(-corners / 4e3), 1.0, 4e3)
    frequency = np.geomspace(0.4, 300.0, 150)
    level = db(truth.response(frequency))
    above = np.geomspace(310.0, 1990.0, 30)
    ceiling = float(np.max(db(truth.response(np.append(frequency, above))))) + 3.0
    found = fit_magnitude(MagnitudeGoal(frequency, level, np.zeros(150), above, ceiling), 4e3, order)
    assert np.abs(db(found.response(frequency)) - level).max() < 0.02


def test_fit_magnitude__kink_of_one_slope__equiripple() -> None:
    """The extreme errors of a minimax fit alternate and are equal: more of them than twice the order."""
    frequency = np.geomspace(1.0, 300.0, 400)
    level = -20.0 * np.log10(np.sqrt(frequency))
    goal = MagnitudeGoal(frequency, level, np.zeros(400), np.geomspace(310.0, 1990.0, 30), 0.0)
    error = db(fit_magnitude(goal, 4e3, 4).response(frequency)) - level
    inner = np.flatnonzero(np.diff(np.sign(np.diff(error)))) + 1
    peaks = error[np.concatenate([[0], inner, [error.size - 1]])]
    great = peaks[np.abs(peaks) > 0.8 * np.abs(error).max()]
    assert great.size >= 2 * 4
    assert np.all(np.diff(np.sign(great)) != 0.0)
