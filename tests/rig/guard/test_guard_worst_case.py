"""The worst that a reference can do to the finger when it knows everything, even the tick at which that is lifted.

The loop with its soft start, its restarts and its changing load is linear in the reference, so the reference that makes
what is felt at one tick the greatest is the answer of a linear program: samples within what the board lets through, the
command within its range, and the guard (comfort, stopping distance, disagreement) not yet tripped before that tick.
"""

from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, signal

from tactuator.rig.board.commissioning import safety_table
from tests.rig.guard.felt_reference import SIZE, FeltReference
from tests.rig.guard.guarded import Guarded, designed

RATE_HZ, HALF_SOFT, ENDING = 4000.0, 200, 200
LOUDEST_DB_SL, CHANNEL, HISTORY, AFTER = 56.0, 1, 600, 300
Rows = NDArray[np.float64]


class Course:
    """Of every tick: how much of the reference and of the command acts, whether a finger rests there; starts: ticks at
    which the controller begins at rest."""

    def __init__(self, length: int, lifted: int | None, stopped: int | None) -> None:
        self.length, self.lifted, self.stopped, self.starts = length, lifted, stopped, {0}
        tick = np.arange(self.length)
        command_fade, fade = self._soft(tick)
        if self.stopped is not None:
            leaves = tick - self.stopped
            begins = self.stopped + 2 * ENDING + 2
            fade = np.where(leaves > 0, np.clip(1.0 - leaves / ENDING, 0.0, 1.0), fade)
            command_fade = np.where(leaves > 0, np.clip(2.0 - leaves / ENDING, 0.0, 1.0), command_fade)
            again = self._soft(tick - begins)
            both = zip(again, (command_fade, fade), strict=True)
            command_fade, fade = (np.where(tick >= begins, *pair) for pair in both)
            self.starts.add(begins)
        self.command_fade, self.fade = command_fade, fade

    @staticmethod
    def _soft(tick: NDArray[np.int64]) -> tuple[Rows, Rows]:
        return np.clip(tick / HALF_SOFT, 0.0, 1.0), np.clip(tick / HALF_SOFT - 1.0, 0.0, 1.0)

    def touched(self, tick: int) -> bool:
        return self.lifted is None or tick < self.lifted


def held(touched: bool) -> tuple[Rows, Rows]:
    described = designed().display.channels[CHANNEL]
    plant = described.loaded_plant(described.loads[0] if touched else None)
    _, a1, a2 = np.real(np.poly(plant.poles))
    system = (np.array([[0.0, 1.0], [-a2, -a1]]), np.array([[0.0], [plant.gain]]), np.eye(2), np.zeros((2, 1)))
    a, b, *_ = signal.cont2discrete(system, 1.0 / RATE_HZ)
    return a, b


def answers(course: Course, ticks: range) -> tuple[Rows, Rows]:
    """y and the motor's volts at every tick, (length, len(ticks)), to a unit of the reference at each of `ticks`."""
    channel, plants = designed().channels[CHANNEL], {touched: held(touched) for touched in (False, True)}
    cascades = (np.array(channel.prefilter_sos), np.array(channel.feedback_sos))
    states = [np.zeros((len(sos), 2, len(ticks))) for sos in cascades]
    x, motor = np.zeros((2, len(ticks))), np.zeros(len(ticks))
    y, volts = np.zeros((course.length, len(ticks))), np.zeros((course.length, len(ticks)))
    for tick in range(course.length):
        if tick in course.starts:
            motor = np.zeros(len(ticks))
            for state in states:
                state[:] = 0.0
        y[tick], volts[tick] = x[0], motor
        value = np.zeros(len(ticks))
        if tick in ticks:
            value[ticks.index(tick)] = course.fade[tick]
        for sos, state in zip(cascades, states, strict=True):
            value = value if sos is cascades[0] else value - x[0]
            for (b0, b1, b2, _, a1, a2), s in zip(sos, state, strict=True):
                out = b0 * value + s[0]
                s[0], s[1], value = b1 * value - a1 * out + s[1], b2 * value - a2 * out, out
        a, b = plants[course.touched(tick)]
        x = a @ x + b * motor
        motor = course.command_fade[tick] * value
    return y, volts


def observed(y: Rows, volts: Rows) -> tuple[Rows, Rows]:
    """The guard's predicted place of rest, and its disagreement."""
    safety = safety_table(designed().display).channels[CHANNEL]
    model = safety.observer
    x, w, before = np.zeros(y.shape[1]), np.zeros(y.shape[1]), np.zeros(y.shape[1])
    place, apart = np.zeros_like(y), np.zeros_like(y)
    for tick in range(len(y)):
        nu = y[tick] - x
        w = w + model.drive * (volts[tick] + before) - model.damp * w - model.spring * x + model.correct_w * nu
        x = x + w + model.correct_x * nu
        before = volts[tick]
        place[tick], apart[tick] = x + safety.stop_lead * w, nu
    return place, apart


def slow_parts(course: Course, ticks: range) -> Rows:
    """The reference's slow part at every tick, (length, len(ticks)), to a unit of it at each of `ticks`."""
    slow, share = np.zeros((course.length, len(ticks))), safety_table(designed().display).travel_share
    state = np.zeros(len(ticks))
    for tick in range(course.length):
        state = np.zeros(len(ticks)) if tick in course.starts else (1.0 - share) * state
        if tick in ticks:
            state[ticks.index(tick)] += share
        slow[tick] = state
    return slow


def worst_reference(course: Course, tick: int) -> tuple[Rows, float]:
    """The reference (length,) and what is felt at `tick` by it, in dB SL, by the linear model."""
    table = safety_table(designed().display)
    safety, turns = table.channels[CHANNEL], table.turns
    ticks = range(max(0, tick - HISTORY), tick + 40)
    y, volts = answers(course, ticks)
    judge = FeltReference(designed(), CHANNEL)
    seen = np.fft.irfft(np.fft.rfft(y, SIZE, axis=0) * judge.inverse[:, None], SIZE, axis=0)
    place, apart = observed(y, volts)
    bounds = [(volts[: tick + 60], 9.9), (slow_parts(course, ticks), safety.travel_max)]
    bounds += [((place + sign * apart)[:tick], 0.98 * safety.stop_max_v) for sign in (1.0, -1.0)]
    bounds += [(apart[:tick], 0.93 * safety.disagreement_v)]
    for turn in range(turns):
        weighed = signal.sosfilt(safety.weighting_sos, y[turn:tick:turns], axis=0)
        bounds.append((weighed, 0.94 * safety.comfort_max))
    rows = np.concatenate([part / most for part, most in bounds]) * safety.reference_max
    rows = rows[np.abs(rows).sum(axis=1) > 1.0]
    found = optimize.linprog(
        -seen[tick], np.concatenate([rows, -rows]), np.ones(2 * len(rows)), bounds=(-1.0, 1.0), method="highs"
    )
    assert found.status == 0
    reference = np.zeros(course.length)
    reference[ticks.start : ticks.stop] = found.x * safety.reference_max
    return reference, float(20.0 * np.log10(-found.fun * safety.reference_max))


@lru_cache
def worst_case(lifted: int | None, stopped: int | None, tick: int) -> tuple[Course, Rows, float]:
    course = Course(tick + AFTER, lifted, stopped)
    return course, *worst_reference(course, tick)


@pytest.mark.parametrize(
    ("lifted", "stopped", "tick"),
    [
        pytest.param(1000, None, 1006, id="lifted"),
        pytest.param(702, 700, 705, id="stopped and lifted"),
        pytest.param(None, None, 500, id="finger", marks=pytest.mark.slow),
        pytest.param(400, None, 405, id="lifted as it begins", marks=pytest.mark.soak),
        pytest.param(None, 700, 1505, id="restarted", marks=pytest.mark.soak),
        pytest.param(1500, 700, 1505, id="restarted and lifted", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("number_format", ["float32", pytest.param("q31", marks=pytest.mark.soak)])
def test_comfort__worst_reference_there_is__is_not_passed_by_1_db(lifted, stopped, tick, number_format):
    course, reference, expected_db_sl = worst_case(lifted, stopped, tick)
    guarded = Guarded(designed(), number_format=number_format)
    rows = np.zeros((course.length, 3))
    rows[:, CHANNEL] = reference
    moved = []
    for at in range(course.length):
        if at in course.starts and at:
            guarded.start()
        if at == stopped:
            guarded.leave()
        guarded.touch(course.touched(at))
        moved.append(guarded.run(rows[at : at + 1]).displacement_mm[:, CHANNEL])
    felt = np.abs(FeltReference(designed(), CHANNEL).of(np.concatenate(moved)))
    loudest_db_sl = 20.0 * np.log10(np.max(felt))
    assert loudest_db_sl < LOUDEST_DB_SL
    assert 20.0 * np.log10(np.max(felt[tick - 3 : tick + 4])) == pytest.approx(expected_db_sl, abs=0.1)
