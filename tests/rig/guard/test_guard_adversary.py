"""The guard against an adversary: references made to be felt hard, images made to misbehave, sensors that fail.

Everything is drawn from one seed; `make soak` draws hundreds. The judge is the truth (felt_reference), not the guard.

The worst that a reference can do to the finger when it knows everything, even the tick at which that is lifted.

The loop with its soft start, its restarts and its changing load is linear in the reference, so the reference that makes
what is felt at one tick the greatest is the answer of a linear program: samples within what the board lets through, the
command within its range, and the guard (comfort, stopping distance, disagreement) not yet tripped before that tick.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, signal

from tactuator.model.controller import ChannelController, Controller
from tactuator.rig.board.commissioning import safety_table
from tactuator.rig.board.link import Mode
from tests.rig.guard.felt_reference import SIZE, FeltReference
from tests.rig.guard.guarded import SENSORS, Guarded, adaptive, designed

TRAVEL_MM = 12.5
LOUDEST_DB_SL = 55.0 + 1.0
QUARTER_S = 1000
FEW = [*((designed, seed) for seed in range(3)), (adaptive, 5)]
MANY = ((of, seed) for of in (designed, adaptive) for seed in range(6, 300))
OF_EACH = [*FEW, *(pytest.param(*each, marks=pytest.mark.soak) for each in MANY)]
Rows = NDArray[np.float64]
Made = Callable[[], Controller]


@cache
def felt(channel: int, of: Made = designed) -> FeltReference:
    return FeltReference(of(), channel)


def signs(rng: np.random.Generator, count: int, channel: int) -> Rows:
    """Samples within +/- 1 or so: telegraph, noise, the worst there is under the finger, sweep, clicks, steps."""
    kind = rng.integers(6)
    if kind == 0:
        lengths = 1 + rng.poisson(rng.choice([1, 2, 4, 7, 14, 60, 300]), count)
        return np.repeat(rng.choice([-1.0, 1.0], count), lengths)[:count]
    if kind == 1:
        return rng.normal(size=count)
    if kind == 2:
        return np.roll(np.resize(felt(channel).worst_reference("finger"), count), rng.integers(1500))
    if kind == 3:
        return np.sign(np.sin(2.0 * np.pi * np.cumsum(np.linspace(0.3, rng.uniform(1.0, 1900.0), count)) / 4000.0))
    moments = np.zeros(count)
    moments[rng.integers(0, count, 5)] = rng.choice([-1.0, 1.0], 5)
    return moments if kind == 4 else np.clip(np.cumsum(moments), -1.0, 1.0)


def adversary(rng: np.random.Generator, count: int) -> Rows:
    """Rows (count, 3) far beyond what is allowed, a waveform of its own for each channel."""
    return np.stack([rng.choice([562.0, 1e3, 5e3, 1e6]) * signs(rng, count, c) for c in range(3)], axis=1)


def judge_comfort(seed: int, of: Made) -> None:
    rng = np.random.default_rng(seed)
    guarded = Guarded(of(), seed=seed)
    moved = []
    stretches = int(rng.integers(2, 5))
    for stretch in range(stretches):
        ends = stretch == stretches - 1
        late, silent = (ends and rng.random() < 0.3 for _ in range(2))
        rows = adversary(rng, int(rng.integers(500, 1800)))
        for piece in np.split(rows, np.sort(rng.integers(0, len(rows), rng.integers(0, 3)))):
            if rng.random() < 0.5:
                guarded.touch(bool(rng.integers(2)))
            moved.append(guarded.run(piece, lateness=100 * late, heard=not silent).displacement_mm)
        if not ends and guarded.mode is Mode.RUNNING and rng.random() < 0.3:
            moved.append(guarded.restart(rows))
    displacement = np.concatenate(moved)
    assert np.max(np.abs(displacement)) < TRAVEL_MM
    for channel in range(3):
        loudest = np.max(np.abs(felt(channel, of).of(displacement[:, channel])))
        assert 20.0 * np.log10(loudest) < LOUDEST_DB_SL, f"channel {channel}"


def sections(rng: np.random.Generator, count: int, gain: float) -> Rows:
    """Sections that are stable one by one, as an image has to have them, and otherwise anything."""
    rows = []
    for _ in range(count):
        radius = 1.0 - abs(rng.normal()) * rng.choice([1e-4, 1e-2, 0.1]) - 1e-6
        other, angle = 1.0 - 10.0 ** rng.uniform(-5.0, 0.0), np.pi * 10.0 ** rng.uniform(-4.0, 0.0)
        pair = [-2.0 * radius * np.cos(angle), radius**2] if rng.random() < 0.6 else [-radius - other, radius * other]
        rows.append([*(rng.normal(size=3) * 10.0 ** rng.uniform(-3.0, 1.0)), 1.0, *pair])
    rows[0][:3] = [gain * each for each in rows[0][:3]]
    return np.array(rows)


def fed_wrongly(channel: ChannelController, rng: np.random.Generator) -> ChannelController:
    """The channel with a finger of any size fed forward, by a model of another motor, as hastily as can be."""
    if channel.feed_forward is None:
        return channel
    hasty = {"slew_s": 1e-4, "forgetting_s": 1e-3, "weight_max": 10.0 ** rng.uniform(0.0, 3.0), "push_max_v": 10.0}
    gain = channel.feed_forward.gain * 10.0 ** rng.uniform(-1.0, 1.0)
    return replace(channel, feed_forward=replace(channel.feed_forward, gain=gain, **hasty))


def misbehaving(rng: np.random.Generator, of: Made) -> Controller:
    """An image's controller: feedback of the wrong size or sign, or sections of chance in F, in C or in both."""
    channels = []
    for channel in of().channels:
        channel = fed_wrongly(channel, rng)
        kind = rng.integers(4)
        if kind == 0:
            wrong = np.array(channel.feedback_sos)
            wrong[0, :3] *= rng.choice([-10.0, -1.0, -0.1, 0.1, 3.0, 30.0, 1000.0])
            channels.append(replace(channel, feedback_sos=wrong))
            continue
        for bit, name, gains in ((1, "feedback_sos", (-2.0, 3.0)), (2, "prefilter_sos", (-5.0, 0.0))):
            if kind & bit:
                count, gain = int(rng.integers(1, 4)), 10.0 ** rng.uniform(*gains)
                changed: dict[str, Any] = {name: sections(rng, count, gain)}
                channel = replace(channel, **changed)
        channels.append(channel)
    return replace(of(), channels=tuple(channels))


def judge_travel(seed: int, of: Made) -> None:
    rng = np.random.default_rng(seed)
    drives = rng.random() < 0.25
    guarded = Guarded(of() if drives else misbehaving(rng, of), drives=drives, seed=seed)
    guarded.touch(bool(rng.integers(2)))
    when = int(rng.integers(1, 1500))
    loud = rng.uniform(0.1, 10.0) if drives else rng.choice([1.0, 10.0, 300.0, 1e5])
    rows = loud * np.stack([signs(rng, when + 1800, c) for c in range(3)], axis=1)
    before = guarded.run(rows[:when])
    for channel in range(3):
        if rng.random() < 0.5:
            guarded.break_sensor(SENSORS[rng.integers(1, len(SENSORS))], channel)
    if rng.random() < 0.2:
        guarded.touch(bool(rng.integers(2)))
    after = guarded.run(rows[when:])
    assert max(np.max(np.abs(run.displacement_mm)) for run in (before, after)) < TRAVEL_MM
    command = np.concatenate([before.command_v, after.command_v])
    first = before.fault_at if before.fault_at is not None or after.fault_at is None else when + after.fault_at
    if first is not None:
        assert np.max(np.abs(command[first + QUARTER_S :]), initial=0.0) < 1e-3


@pytest.mark.parametrize(("of", "seed"), OF_EACH)
def test_comfort__adversary_finger_on_and_off_link_faults__is_not_passed_by_1_db(of: Made, seed: int) -> None:
    judge_comfort(seed, of)


@pytest.mark.parametrize(("of", "seed"), OF_EACH)
def test_travel__misbehaving_image_and_failing_sensors__is_never_reached(of: Made, seed: int) -> None:
    judge_travel(seed, of)


def test_felt_reference__tones_and_rest__are_what_was_asked() -> None:
    guarded = Guarded(designed())
    assert np.max(np.abs(felt(0).of(guarded.run(np.zeros((2400, 3))).displacement_mm[:, 0]))) < 3.0
    time_s = np.arange(2400) / 4000.0
    rows = 300.0 * np.stack([np.sin(2.0 * np.pi * f * time_s) for f in (3.0, 20.0, 100.0)], axis=1)
    displacement = guarded.run(rows).displacement_mm
    for channel in range(3):
        assert np.max(np.abs(felt(channel).of(displacement[:, channel]))) == pytest.approx(300.0, rel=0.03)


RATE_HZ, HALF_SOFT, ENDING = 4000.0, 200, 200
CHANNEL, HISTORY, AFTER = 1, 300, 300


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


@pytest.mark.parametrize(
    ("lifted", "stopped", "tick"),
    [
        pytest.param(710, None, 716, id="lifted"),
        pytest.param(702, 700, 705, id="stopped and lifted", marks=pytest.mark.soak),
        pytest.param(1500, 700, 1505, id="restarted and lifted", marks=pytest.mark.soak),
    ],
)
def test_comfort__worst_reference_there_is__is_not_passed_by_1_db(
    lifted: int | None, stopped: int | None, tick: int
) -> None:
    course = Course(tick + AFTER, lifted, stopped)
    reference, expected_db_sl = worst_reference(course, tick)
    guarded = Guarded(designed())
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
