"""Coupled loops against the whole loop in state space and the simulation; Monte Carlo against the same plants."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import linalg, signal, stats

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.display import parse_display
from tactuator.model.controller import Controller
from tactuator.model.coupling import CoupledResponse, Coupling
from tactuator.model.description import Display
from tactuator.model.verdict import Finding, Outcome
from tactuator.runtime.simulation import Simulation
from tactuator.signals.loop import FeedbackLoop, margins
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.coupling import CROSSTALK, TOGETHER, coupled_loops, judge_coupling, shares_at
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.family import plant_family
from tactuator.synthesis.monte_carlo import QUANTILES, DrawnPlants, monte_carlo
from tactuator.synthesis.verdict import drawn_assumptions, judge, judge_drawn
from tests.synthesis.displays import channel, paper_alone, paper_controller
from tests.three_fingers import three_finger_display

RATE_HZ = 4000.0
QUIET = {"hum_hz": [], "hum_v_peak": [], "noise_v_rms": 0.0, "friction_v": 0.0}


def fingers(comfort_db_sl: float = 40.0, **coupling: float) -> Display:
    asked = {"environment": QUIET, "objectives": {"comfort_db_sl": comfort_db_sl}}
    document = three_finger_display() | {"converter": {"bits": 24}} | asked
    return parse_display(document | ({"coupling": coupling} if coupling else {}))


@cache
def controller() -> Controller:
    return design_controller(fingers())


def findings(display: Display, quantity: str, load: str = "none") -> list[Finding]:
    return [f for f in judge_coupling(controller(), display) if (f.quantity, f.load) == (quantity, load)]


def spectral_radius(display: Display) -> float:
    """The greatest eigenvalue of the coupled loops, written down in state space."""
    blocks, names = [], display.channels
    size = len(names)
    for one in names:  # plant, sampled under a hold
        num, den = (np.real(part) for part in one.plant.polynomials())
        blocks.append(signal.cont2discrete(signal.tf2ss(num, den), 1.0 / RATE_HZ)[:3])
    omega, damping = 2.0 * np.pi * display.coupling.resonance_hz, display.coupling.damping
    path = signal.cont2discrete(signal.tf2ss([omega**2], [1.0, 2.0 * damping * omega, omega**2]), 1.0 / RATE_HZ)[:3]
    control = [signal.sos2tf(part.feedback_sos) for part in controller().channels]
    control = [signal.tf2ss(*each) for each in control]
    plant, frame = (stacked(each) for each in (blocks, [path] * size))
    c = stacked([(a, b, row) for a, b, row, _ in control])
    direct = np.diag([float(each[3].item()) for each in control])
    mixing = 10.0 ** (display.coupling.level_db / 20.0) * (np.ones((size, size)) - np.eye(size))
    n, m, k = (part[0].shape[0] for part in (plant, frame, c))
    whole = np.zeros((n + m + k + size, n + m + k + size))  # the last states are the commands that are still computed
    at, u = np.cumsum([0, n, m, k]), slice(n + m + k, None)
    x, f, w = (slice(at[i], at[i + 1]) for i in range(3))
    whole[x, x], whole[x, f], whole[x, u] = plant[0], plant[1] @ mixing @ frame[2], plant[1]
    whole[f, f], whole[f, u] = frame[0], frame[1]
    whole[w, w], whole[w, x] = c[0], -c[1] @ plant[2]
    whole[u, w], whole[u, x] = c[2], -direct @ plant[2]
    return float(np.max(np.abs(np.linalg.eigvals(whole))))


def stacked(parts: list[tuple[NDArray[np.float64], ...]]) -> list[NDArray[np.float64]]:
    return [linalg.block_diag(*(part[i] for part in parts)) for i in range(3)]


def test_stability__of_coupled_loops__is_that_of_the_whole_loops_eigenvalues() -> None:
    """Stable by their small gain, stable beyond it, and unstable: each is among them."""
    ways = set()
    drawn = product((12.0, 25.0, 60.0), (-30.0, -20.0, -12.0, -6.0), (0.05,))
    for hertz, level_db, damping in (*drawn, (300.0, -1.0, 0.5)):
        display = fingers(level_db=level_db, resonance_hz=hertz, damping=damping)
        (finding,) = findings(display, TOGETHER)
        expected = Outcome.MET if spectral_radius(display) < 1.0 else Outcome.NOT_MET
        assert finding.outcome is expected, (hertz, level_db)
        assert ("unstable" in finding.remark) == (expected is Outcome.NOT_MET)
        ways.add((expected, (finding.value or 0.0) < 1.0))
    assert ways == {(Outcome.MET, True), (Outcome.MET, False), (Outcome.NOT_MET, False)}


@pytest.mark.parametrize("load", ["none", "finger"])
@pytest.mark.parametrize("level_db", [-20.0, -40.0])
def test_crosstalk__of_a_simulated_display__is_what_the_verdict_says(level_db: float, load: str) -> None:
    display = fingers(level_db=level_db)
    for finding in findings(display, CROSSTALK, load):
        driver = finding.remark.split()[1]
        simulation = Simulation(display)
        simulation.load(controller())
        names = [channel.name for channel in display.channels]
        for place in range(3 if load == "finger" else 0):
            simulation.touch(place, load)
        frequency_hz = finding.frequency_hz or 0.0
        time_s = np.arange(round(3.0 * RATE_HZ)) / RATE_HZ
        reference = np.zeros((time_s.size, 3))
        reference[:, names.index(driver)] = 100.0 * np.sin(2.0 * np.pi * frequency_hz * time_s)
        felt = simulation.play(reference).displacement_mm[time_s.size // 2 :, names.index(finding.channel)]
        late = time_s[time_s.size // 2 :]
        rows = np.stack([np.sin(2.0 * np.pi * frequency_hz * late), np.cos(2.0 * np.pi * frequency_hz * late)], axis=1)
        peak = float(np.linalg.norm(np.linalg.lstsq(rows, felt, rcond=None)[0]))
        threshold = float(display.channel(finding.channel).threshold.curve.displacement_mm(frequency_hz))
        assert finding.value == pytest.approx(20.0 * np.log10(peak / threshold), abs=0.1)
        assert (finding.outcome is Outcome.NOT_MET) == ((finding.value or 0.0) > 0.0)


def test_crosstalk__through_a_measured_coupling__is_that_of_its_mechanism_and_open_where_it_is_unsure() -> None:
    frame, rng = fingers(level_db=-30.0), np.random.default_rng(1)
    lines = np.geomspace(0.5, 290.0, 200)
    theirs = findings(frame, CROSSTALK)
    worst = max(finding.value or 0.0 for finding in theirs)
    for deviation, room_db, outcome in (
        (1e-6, 0.1, Outcome.MET),
        (1e-6, -0.1, Outcome.NOT_MET),
        (3e-3, 0.1, Outcome.NOT_JUDGED),
    ):
        noise = rng.normal(size=(2, 200, 3, 3)) * deviation / np.sqrt(2.0)
        value = np.eye(3) + shares_at(frame, lines)[0] + noise[0] + 1j * noise[1]
        unsure = np.full(value.shape, deviation)
        measured = CoupledResponse(("index", "thumb", "middle"), lines, value.real, value.imag, unsure)
        allowed = replace(frame.objectives, crosstalk_max_db_sl=worst + room_db)
        ours = findings(replace(frame, coupling=Coupling(measured=measured), objectives=allowed), CROSSTALK)
        close_db = 0.02 if deviation < 1e-3 else 0.5  # a tenth of the share is the noise of each line
        assert [f.value for f in ours] == pytest.approx([f.value for f in theirs], abs=close_db)
        loudest = max(ours, key=lambda finding: finding.value or 0.0)
        assert loudest.outcome is outcome


def test_verdict__without_a_coupling_or_with_one_ignored__has_no_objective_of_it() -> None:
    assert not list(judge_coupling(controller(), fingers()))
    assert "v" not in {objective.number for objective in judge(controller(), fingers()).objectives}
    assert "v" in {objective.number for objective in judge(controller(), fingers(level_db=-20.0)).objectives}
    for loops in coupled_loops(controller(), fingers(level_db=-20.0)):
        ignored = replace(loops, display=fingers())  # the coupling put away: nothing arrives, which is seen at once
        moved, _ = ignored.motion(0, 40.0, np.array([30.0]))
        assert np.max(moved[:, 1:]) == 0.0
        assert np.min(loops.motion(0, 40.0, np.array([30.0]))[0][:, 1:]) > 0.0


def test_measured_coupling__of_other_channels__is_refused() -> None:
    lines, square = np.geomspace(1.0, 200.0, 9), np.tile(np.eye(2), (9, 1, 1))
    measured = CoupledResponse(("a", "b"), lines, square, 0.0 * square, square)
    with pytest.raises(BadInput, match="index, thumb, middle"):
        replace(fingers(), coupling=Coupling(measured=measured))


def drawn(
    peaks: FloatArray,
    *,
    source: str = "covariance",
    load: str = "none",
    stable: int | None = None,
    mode_shift: float = 0.0,
) -> DrawnPlants:
    """Plants of these max|S|, of an error of |H| of 0.2 dB, without hum; all stable but the last few."""
    is_stable = np.arange(peaks.size) < (peaks.size if stable is None else stable)
    flat = np.where(is_stable, 0.2, np.nan)
    return DrawnPlants(
        "index", load, source, mode_shift, is_stable, np.where(is_stable, peaks, np.nan), flat, flat * np.nan
    )


def found(plants: DrawnPlants, quantity: str) -> Finding:
    display = paper_alone()
    return next(one for one in judge_drawn([plants], display) if one.quantity.startswith(quantity))


@pytest.mark.parametrize("count", [10, 58, 59, 200, 1000])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.05, 0.08, 0.2])
def test_judge_drawn__share_that_passes__as_exact_binomial_tests_tell(count: int, share: float) -> None:
    passing = round(share * count)
    limit = paper_alone().channels[0].feedback.sensitivity_peak
    peak = found(drawn(np.where(np.arange(count) < passing, limit + 0.1, limit - 0.1)), "max|S|")
    fewer = stats.binomtest(passing, count, 0.05, alternative="less").pvalue <= 0.05
    more = stats.binomtest(passing, count, 0.05, alternative="greater").pvalue <= 0.05
    assert peak.outcome is (Outcome.MET if fewer else Outcome.NOT_MET if more else Outcome.NOT_JUDGED)
    assert ("more plants" in peak.remark) == (peak.outcome is Outcome.NOT_JUDGED)


def test_judge_drawn__one_unstable_loop_of_a_thousand__not_met() -> None:
    plants = drawn(np.full(1000, 1.2), stable=999)
    assert found(plants, "unstable loops").outcome is Outcome.NOT_MET
    assert found(plants, "unstable loops").value == pytest.approx(0.1)
    assert found(plants, "felt minus asked").outcome is Outcome.MET
    assert found(drawn(np.full(1000, 1.2), stable=700), "felt minus asked").outcome is Outcome.NOT_MET


def test_judge_drawn__plant_of_which_nothing_is_known__not_judged() -> None:
    for one in judge_drawn([drawn(np.full(1000, 1.2), source="nominal")], paper_alone()):
        assert one.outcome is Outcome.NOT_JUDGED
        assert "nothing tells how the plant may differ" in one.remark


@pytest.mark.parametrize(
    ("known", "value", "words"),
    [
        ({"valid_hz": (0.3, 200.0)}, 0.2, "valid_hz"),
        ({"model_error_db": 0.9}, 1.1, "0.90 dB that the plant itself is unsure of"),
    ],
)
def test_judge_drawn__plant_not_known_everywhere_or_not_surely__flatness_not_judged(known, value, words) -> None:
    display = paper_alone()
    display = replace(display, channels=(replace(display.channels[0], **known),))
    flat = next(one for one in judge_drawn([drawn(np.full(1000, 1.2))], display) if one.objective == "i")
    assert flat.outcome is Outcome.NOT_JUDGED
    assert flat.value == pytest.approx(value)
    assert words in flat.remark


def test_drawn_assumptions__shifted_modes__told_once() -> None:
    plants = [drawn(np.ones(9), mode_shift=0.02, load=load) for load in ("none", "finger")]
    assert drawn_assumptions(plants) == ("modes of index: 2 % of standard deviation in frequency (--mode-shift)",)
    assert drawn_assumptions([drawn(np.ones(9))]) == ()


def test_judge_drawn__a_family_within_and_beyond_the_limit__met_and_not_met() -> None:
    """Three quarters of the plants are stiffer or softer than nominal: the peak that `margins` tells decides."""
    one = channel(family=MODELS, loads=())
    made = replace(paper_controller(), display=replace(paper_alone(), channels=(one,)))
    plants = monte_carlo(made, 500, np.random.default_rng(1))
    for limit, outcome in ((1.9, Outcome.MET), (1.3, Outcome.NOT_MET)):
        asked = replace(one.feedback, sensitivity_peak=limit)
        display = replace(made.display, channels=(replace(one, feedback=asked),))
        (peak,) = (finding for finding in judge_drawn(plants, display) if finding.quantity.startswith("max|S|"))
        assert peak.outcome is outcome


MODELS = tuple(
    ContinuousSystem.from_polynomials([2875.0 * gain], [1.0, 94.0 * damping, 290.0])
    for gain, damping in ((0.8, 1.2), (1.1, 0.9), (1.3, 0.8))
)


def test_monte_carlo__family_and_load__greatest_peak_is_that_of_the_sampled_loops() -> None:
    one = channel(family=MODELS)
    made = replace(paper_controller(), display=replace(paper_alone(), channels=(one,)))
    found = {trial.load: trial for trial in monte_carlo(made, 200, np.random.default_rng(1))}
    feedback = made.channels[0].feedback(4000.0)
    for load in ("none", "finger"):
        members = [member for member in plant_family(one, 4000.0, 1) if member.load == load]
        peaks = [margins(FeedbackLoop(feedback, member.sampled)).sensitivity_peak for member in members]
        assert np.nanmax(found[load].sensitivity_peak) == pytest.approx(max(peaks), rel=0.01)
        assert found[load].unstable == 0.0
        assert found[load].source == "family"


def test_monte_carlo__covariance__spread_of_the_gain_is_that_of_the_flatness() -> None:
    """Without a loop an error of the gain by its standard deviation of 5 % is one of 0.42 dB in |H|."""
    sigma = 0.05 * 2875.0
    covariance = np.zeros((4, 4))
    covariance[0, 0] = sigma**2
    display = paper_alone()
    one = replace(display.channels[0], covariance=tuple(map(tuple, covariance.tolist())))
    made = paper_controller()
    open_loop = replace(made.channels[0], feedback_sos=None)
    drawn = monte_carlo(
        replace(made, display=replace(display, channels=(one,)), channels=(open_loop,)), 4000, np.random.default_rng(2)
    )
    nominal = monte_carlo(replace(made, channels=(open_loop,)), 1, np.random.default_rng(2))
    assert drawn[0].mode_shift == 0.0  # its covariance says how well the modes are known
    spread = float(np.quantile(drawn[0].flatness_db, 0.95) - nominal[0].flatness_db[0])
    assert spread == pytest.approx(20.0 * np.log10(1.0 + 1.645 * 0.05), abs=0.15)
    assert np.all(np.isnan(drawn[0].sensitivity_peak))


def test_monte_carlo__plants_that_the_loop_cannot_hold__counted() -> None:
    wild = ContinuousSystem.from_polynomials([90_000.0], [1.0, 94.0, 290.0])
    one = channel(loads=(), family=(wild,))
    made = replace(paper_controller(), display=replace(paper_alone(), channels=(one,)))
    (found,) = monte_carlo(made, 1000, np.random.default_rng(3))
    assert found.unstable == pytest.approx(0.5, abs=0.06)
    assert found.quantiles(found.sensitivity_peak).size == len(QUANTILES)


@pytest.mark.parametrize(("count", "shift"), [(0, 0.02), (10_000_000, 0.02), (10, -0.1), (10, 0.5)])
def test_monte_carlo__counts_and_shifts_that_cannot_be__refused(count: int, shift: float) -> None:
    with pytest.raises(BadInput, match="allowed"):
        monte_carlo(paper_controller(), count, np.random.default_rng(0), shift)
