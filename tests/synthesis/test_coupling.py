"""Coupled loops: stability against the whole loop's eigenvalues in state space, crosstalk against the simulation."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import linalg, signal

from tactuator.errors import BadInput
from tactuator.io.display import parse_display
from tactuator.model.controller import Controller
from tactuator.model.coupling import CoupledResponse, Coupling
from tactuator.model.description import Display
from tactuator.model.verdict import Finding, Outcome
from tactuator.runtime.simulation import Simulation
from tactuator.synthesis.coupling import CROSSTALK, TOGETHER, coupled_loops, judge_coupling, shares_at
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.verdict import judge
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
    for channel in names:  # plant, sampled under a hold
        num, den = (np.real(part) for part in channel.plant.polynomials())
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
