"""The C controller against NumPy's float32, bit for bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import signal

from tactuator.errors import BadInput
from tactuator.model.controller import AntiWindup, ChannelController, Limits
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.coefficients import delta_coefficients_single
from tactuator.runtime.image import conditioning
from tactuator.runtime.tables import controller_table
from tests.core.single_precision import ReferenceController, Single, sections
from tests.runtime.paper_display import controller, display, feedback_sections, prefilter_sections

PAPER = controller(display()).channels[0]

hostile = hnp.arrays(np.float32, st.integers(1, 60), elements=st.floats(width=32))
sos_row = st.tuples(*[st.floats(-3.0, 3.0, width=32)] * 3, st.just(1.0), *[st.floats(-2.5, 2.5, width=32)] * 2)
cascade = st.lists(sos_row, min_size=1, max_size=4).map(np.array)


def run_core(
    of: ChannelController, reference: NDArray[np.float32], position: NDArray[np.float32], state: Any = None
) -> NDArray[np.uint32]:
    table, state = controller_table(of), state or ffi.new("tact_controller_state *")
    lib.tact_controller_reset(state)
    command = np.empty(reference.size, dtype=np.float32)
    arrays = [ffi.from_buffer("float[]", np.ascontiguousarray(each)) for each in (reference, position, command)]
    lib.tact_controller_run(table, state, *arrays, reference.size)
    return command.view(np.uint32)


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
def test_controller__any_bits_in_or_a_long_ordinary_run__agrees_with_numpy_bit_for_bit(reference, position) -> None:
    count = min(reference.size, position.size)
    for of in (PAPER, replace(PAPER, anti_windup=AntiWindup((0.03, 0.001))), replace(PAPER, feedback_sos=None)):
        ours = run_core(of, reference[:count], position[:count])
        assert np.array_equal(ours, run_numpy(of, reference[:count], position[:count]))


@settings(max_examples=100)
@given(cascade, cascade, hostile, st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)))
def test_controller__any_sections_even_unstable__agrees_with_numpy_bit_for_bit_within_its_limits(
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
        ({"limits": Limits(0.0, 2.0)}, "allowed: a positive number of volts"),
        ({"limits": Limits(-1.0, 2.0)}, "allowed: a positive number of volts"),
        (
            {"feedback_sos": np.tile(feedback_sections(), (5, 1))},
            "'index': feedback has 5 sections; allowed: at most 4",
        ),
    ],
)
def test_controller_table__what_no_board_runs__is_refused(changes, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        controller_table(replace(PAPER, **changes))


@given(first=st.floats(width=32), second=st.floats(width=32), at=st.integers(0, 3))
def test_pair__any_two_floats__are_read_as_they_lie(first, second, at):
    floats = ffi.new("float[8]", [7.0] * 8)
    floats[2 * at], floats[2 * at + 1] = first, second
    pair = lib.tact_float_pair_get(floats + 2 * at)
    assert np.array_equal([pair.first, pair.second], [first, second], equal_nan=True)
    assert [np.signbit(pair.first), np.signbit(pair.second)] == [np.signbit(first), np.signbit(second)]


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
