"""The guard against an adversary: references made to be felt hard, images made to misbehave, sensors that fail.

Everything is drawn from one seed; `make soak` draws hundreds. The judge is the truth (felt_reference), not the guard.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tactuator.model.controller import ChannelController, Controller
from tactuator.rig.board.link import Mode
from tests.rig.guard.felt_reference import FeltReference
from tests.rig.guard.guarded import SENSORS, Guarded, adaptive, designed

TRAVEL_MM = 12.5
LOUDEST_DB_SL = 55.0 + 1.0
QUARTER_S = 1000
FEW = [*((designed, seed) for seed in range(5)), (adaptive, 5)]
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
    guarded = Guarded(of(), seed=seed, number_format=("float32", "q31")[seed % 2])
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
