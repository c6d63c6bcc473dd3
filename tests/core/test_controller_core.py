"""The C controller, and references reshaped by their level, against NumPy's float32 bit for bit; their responses."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import signal

from tactuator.errors import BadInput
from tactuator.model.controller import AntiWindup, ChannelController, Limits, StrengthShaping
from tactuator.parameters import SMALLEST
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.image import conditioning, delta_coefficients_single
from tactuator.runtime.tables import controller_table
from tactuator.signals.decibels import db
from tests.core.single_precision import TINY, ReferenceController, Single, finite, sections
from tests.runtime.paper_display import RATE_HZ, channel, controller, display, feedback_sections, prefilter_sections
from tests.strength import core, reshaped

PAPER = controller(display()).channels[0]

hostile = hnp.arrays(np.float32, st.integers(1, 60), elements=st.floats(width=32))
sos_row = st.tuples(*[st.floats(-3.0, 3.0, width=32)] * 3, st.just(1.0), *[st.floats(-2.5, 2.5, width=32)] * 2)
cascade = st.lists(sos_row, min_size=1, max_size=4).map(np.array)


def run_core(
    of: ChannelController, reference: NDArray[np.float32], position: NDArray[np.float32], state: Any = None
) -> NDArray[np.uint32]:
    (table, _), state = controller_table(of, 4000.0, 0), state or ffi.new("tact_controller_state *")
    lib.tact_controller_reset(table, state)
    read = [finite(y, 1e3) for y in position]  # a converter gives nothing else
    asked = [finite(r, 1e6) for r in reference]
    commands = [lib.tact_controller_step(table, state, r, y) for r, y in zip(asked, read, strict=True)]
    return np.array(commands, dtype=np.float32).view(np.uint32)


def run_numpy(
    of: ChannelController, reference: NDArray[np.float32], position: NDArray[np.float32]
) -> NDArray[np.uint32]:
    feedback = [] if of.feedback_sos is None else sections(delta_coefficients_single(of.feedback_sos, 4, "C"))
    gains = (Single(of.anti_windup.gains[0]), Single(of.anti_windup.gains[1]))
    prefilter = sections(delta_coefficients_single(of.prefilter_sos, 8, "F"))
    worth = Single(conditioning(of))
    model = ReferenceController(prefilter, feedback, gains, Single(of.limits.command_v), worth)
    return np.array([model.step(r, y) for r, y in zip(reference, position, strict=True)], np.float32).view(np.uint32)


ORDINARY = (300.0 * np.random.default_rng(5).standard_normal(6000)).astype(np.float32)


@settings(max_examples=80)
@given(hostile, hostile)
@example(np.append(ORDINARY[:4000], np.zeros(2000, np.float32)), ORDINARY[::-1] / 600.0)
def test_controller__any_bits_in_or_a_long_run__agrees_with_numpy_bit_for_bit(reference, position) -> None:
    count = min(reference.size, position.size)
    for of in (PAPER, replace(PAPER, anti_windup=AntiWindup((0.03, 0.001))), replace(PAPER, feedback_sos=None)):
        ours = run_core(of, reference[:count], position[:count])
        assert np.array_equal(ours, run_numpy(of, reference[:count], position[:count]))


gain = st.just(0.0) | st.floats(SMALLEST, 1.0) | st.floats(-1.0, -SMALLEST)


@settings(max_examples=100)
@given(cascade, cascade, hostile, st.tuples(gain, gain))
def test_controller__any_sections_even_unstable__agrees_with_numpy_bit_for_bit(
    prefilter: NDArray[np.float64],
    feedback: NDArray[np.float64],
    reference: NDArray[np.float32],
    gains: tuple[float, float],
) -> None:
    of = ChannelController("x", 1.0, prefilter, feedback, AntiWindup(gains), Limits(3.0, 2.0))
    ours = run_core(of, reference, reference[::-1])
    assert np.array_equal(ours, run_numpy(of, reference, reference[::-1]))
    assert np.all(np.abs(ours.view(np.float32)) <= 3.0)


def test_controller__small_signals__agrees_with_scipy_in_double() -> None:
    rng = np.random.default_rng(6)
    reference, position = rng.standard_normal(4000), 0.01 * rng.standard_normal(4000)
    double = signal.sosfilt(
        feedback_sections(), signal.sosfilt(prefilter_sections(PAPER.threshold_voltage_dc), reference) - position
    )
    ours = run_core(PAPER, reference.astype(np.float32), position.astype(np.float32)).view(np.float32)
    assert np.max(np.abs(ours - double)) < 2e-6 * np.max(np.abs(double))


def test_controller__silence_after_sound__comes_to_rest_exactly() -> None:
    state, reference = ffi.new("tact_controller_state *"), np.zeros(60 * 4000, dtype=np.float32)
    reference[:4000] = 100.0
    command = run_core(replace(PAPER, feedback_sos=None), reference, 0.0 * reference, state).view(np.float32)
    assert command[-1] == 0.0
    assert all(section.s1 == 0.0 and section.s2 == 0.0 for section in state.prefilter)
    assert np.min(np.abs(command[command != 0.0])) > np.finfo(np.float32).tiny  # never a subnormal


def test_controller__saturated_by_its_reference__conditioning_frees_it_at_once() -> None:
    hold = np.concatenate([np.full(8000, 1e4), np.zeros(4000)]).astype(np.float32)
    command = run_core(replace(PAPER, anti_windup=AntiWindup()), hold, np.zeros_like(hold)).view(np.float32)
    assert np.mean(command[:8000] == 10.0) > 0.99
    assert np.flatnonzero(np.abs(command[8000:]) < 9.99)[0] <= 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"limits": Limits(0.0, 2.0)}, "its command limit is out of range"),
        ({"limits": Limits(-1.0, 2.0)}, "its command limit is out of range"),
        (
            {"feedback_sos": np.tile(feedback_sections(), (5, 1))},
            "'index': feedback has 5 sections; expected at most 4",
        ),
    ],
)
def test_controller_table__what_no_board_runs__is_refused(changes, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        controller_table(replace(PAPER, **changes), 4000.0, 0)


def test_controller__saturated_by_a_force__back_calculation_frees_it() -> None:
    """What the reference within comfort cannot account for: the position is held 8 V away for two seconds."""
    held = np.concatenate([np.full(8000, -8.0), np.zeros(4000)]).astype(np.float32)
    silent = np.zeros_like(held)
    back = []
    for gains in ((0.0, 0.0), (0.05, 0.0005)):
        command = run_core(replace(PAPER, anti_windup=AntiWindup(gains)), silent, held).view(np.float32)
        below = np.flatnonzero(command[8000:] < 9.99)
        back.append(below[0] if below.size else 4000)
    assert back[0] == 4000
    assert back[1] < 400


@cache
def shaping():
    return reshaped(controller(display(channel()))).channels[0].strength


def run_strength(reference, of=None):
    step, _ = core(of or shaping(), RATE_HZ)
    return np.array([step(r) for r in reference], dtype=np.float32)


def run_strength_numpy(reference):
    """The same from the description in strength.h; rows by NumPy's frexp, not by the bits."""
    follow = Single(-np.expm1(-1.0 / (shaping().follow_s * RATE_HZ)))
    turns = (2.0 * np.sin(np.pi * shaping().pairs_hz / RATE_HZ)).astype(np.float32)
    gains, damping = shaping().gains.astype(np.float32), Single(shaping().damping)
    power = level = Single(0.0)
    pairs = np.zeros((4, 2), dtype=np.float32)
    out = []
    for each in reference:
        r = finite(Single(each), 1e6)
        power = power + follow * (r * r - power)
        felt = max(level, Single(0.5))
        level = min(level + follow * (power - level), felt + Single(6.0) * follow * felt)
        mantissa, exponent = np.frexp(level)
        row = int(exponent) - 1 + 1 if level > 0.0 else -1
        low, high, share = gains[0], gains[0], Single(0.0)
        if row >= 20:
            low = high = gains[20]
        elif row >= 0:
            low, high, share = gains[row], gains[row + 1], Single(2.0) * mantissa - Single(1.0)
        gain = low + share * (high - low)
        total = gain[0] * r
        for i in range(4):
            band = pairs[i, 0] + turns[i] * ((r - pairs[i, 1]) - damping * pairs[i, 0])
            band = band if band >= TINY or band <= -TINY else Single(0.0)
            pairs[i] = band, pairs[i, 1] + turns[i] * band
            total = total + (gain[2 * i + 1] * band + gain[2 * i + 2] * pairs[i, 1])
        if level < Single(1e-12):
            power, level = finite(power, 1e12), finite(level, 1e12)
            pairs[np.abs(pairs) < Single(1e-20)] = 0.0
        out.append(total)
    return np.array(out, dtype=np.float32)


LEVELS_DB = np.repeat(np.random.default_rng(3).uniform(-80.0, 60.0, 20), 100)
LIKE_SPEECH = np.random.default_rng(4).standard_normal(2000) * 10.0 ** (LEVELS_DB / 20.0)


@settings(max_examples=30)
@given(hnp.arrays(np.float32, st.integers(1, 40), elements=st.floats(width=32)))
@example(LIKE_SPEECH.astype(np.float32))
def test_strength__any_bits_or_noise_of_every_level__agrees_with_numpy_bit_for_bit(reference) -> None:
    with np.errstate(all="ignore"):
        expected = run_strength_numpy(reference)
    assert np.array_equal(run_strength(reference).view(np.uint32), expected.view(np.uint32))


@pytest.mark.parametrize(("level", "hertz"), [(3.0, 250.0), (20.0, 16.0), (20.0, 100.0), (37.0, 100.0)])
def test_strength__steady_tone__is_raised_by_its_response(hertz: float, level: float) -> None:
    time_s = np.arange(6000) / RATE_HZ
    turned = np.exp(-2j * np.pi * hertz * time_s[2000:])
    out = run_strength(10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * hertz * time_s))[2000:]
    felt = db(2.0 * np.abs(np.mean(out * turned))) - level
    assert felt == pytest.approx(db(np.abs(shaping().response(level, hertz, RATE_HZ))), abs=0.05)


TIME_S = np.arange(8000) / RATE_HZ
SWELL = 10.0 ** (np.interp(TIME_S, [0.0, 0.5, 1.0, 1.001], [0.0, 50.0, 50.0, 10.0]) / 20.0)
SWEEP = np.sin(2.0 * np.pi * 5.0 * 2.0 / np.log(60.0) * (60.0 ** (TIME_S / 2.0) - 1.0))
SOUNDS = {
    "swell": SWELL * np.sin(2.0 * np.pi * 60.0 * TIME_S),
    "sweep that begins at 40 dB SL": np.r_[np.zeros(400), 100.0 * SWEEP],
}


@pytest.mark.parametrize(("name", "hertz"), [(name, hertz) for name in SOUNDS for hertz in (30.0, 250.0)])
def test_strength__any_sound__moves_its_gain_without_a_step(name: str, hertz: float) -> None:
    """The core's own gain: what comes out over what goes in, where every row gains alike what it gains at a tone."""
    levels = 10.0 * np.log10(2.0) * np.arange(21)
    gains = np.zeros((21, 9))
    gains[:, 0] = np.abs([shaping().response(level, hertz, RATE_HZ) for level in levels])
    sound = (SOUNDS[name] + 1e-9).astype(np.float32)  # nowhere 0
    gain_db = db(run_strength(sound, replace(shaping(), gains=gains)) / sound)
    assert np.abs(np.diff(gain_db)).max() < 0.1
    assert np.abs(gain_db[80:] - gain_db[:-80]).max() < 5.0
    assert np.ptp(gain_db) > 3.0


def test_strength__silence__comes_to_rest_without_subnormal_numbers() -> None:
    step, state = core(shaping(), RATE_HZ)
    for sample, r in enumerate(np.concatenate((1e3 * np.ones(4000), np.zeros(60000)))):
        step(r)
        if sample % 200:
            continue
        values = np.abs([state.power, state.level, *(value for pair in state.pair for value in pair)])
        assert np.all((values == 0.0) | (values > float(TINY) * 1e-6))
    assert not np.any(values)


@pytest.mark.parametrize("changes", [{"damping": 1e9}, {"gains": np.full((21, 9), 1e5)}, {"gains": np.zeros((20, 9))}])
def test_strength_table__figures_that_cannot_run__are_refused(changes) -> None:
    figures = {"pairs_hz": shaping().pairs_hz, "damping": 1.2, "gains": shaping().gains, "follow_s": 0.05} | changes
    with pytest.raises(BadInput, match=r"strength|a coefficient is not a number or out of range"):
        run_strength([0.0], StrengthShaping(**figures))
