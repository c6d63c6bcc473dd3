"""The supervisor: both the interrupt and the main loop have to live, or the outputs go safe and the watchdog unfed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.runtime._core import ffi, lib

RATE_HZ = 4000.0
DEAF_TICKS = 32
BRAKE_TICKS = 1000
ALL = lib.TACT_OUTPUTS_ON | lib.TACT_WATCHDOG_FED


def made(mode: int):
    board, supervisor = ffi.new("tact_board *"), ffi.new("tact_supervisor *")
    board.mode, board.safety.rate_hz = mode, RATE_HZ
    lib.tact_supervisor_reset(supervisor)
    lib.tact_supervisor_heard(supervisor, board)
    return board, supervisor


@pytest.mark.parametrize("mode", [lib.TACT_ARMED, lib.TACT_RUNNING])
def test_supervisor__main_loop_heard__outputs_are_on_and_the_watchdog_is_fed(mode):
    board, supervisor = made(mode)
    for _ in range(3000):
        assert lib.tact_supervisor_tick(supervisor, board, 1) == ALL
        lib.tact_supervisor_heard(supervisor, board)


@pytest.mark.parametrize("mode", [lib.TACT_ARMED, lib.TACT_RUNNING])
def test_supervisor__main_loop_stuck__outputs_safe_after_8_ms_and_for_good(mode):
    board, supervisor = made(mode)
    said = [lib.tact_supervisor_tick(supervisor, board, 1) for _ in range(100)]
    assert said == [ALL] * DEAF_TICKS + [0] * (100 - DEAF_TICKS)
    lib.tact_supervisor_heard(supervisor, board)
    assert lib.tact_supervisor_tick(supervisor, board, 1) == 0
    assert supervisor.lost == lib.TACT_LOST_MAIN_LOOP


def test_supervisor__off__outputs_safe_watchdog_fed_and_the_main_loop_may_take_its_time():
    board, supervisor = made(lib.TACT_OFF)
    assert {lib.tact_supervisor_tick(supervisor, board, 1) for _ in range(100_000)} == {lib.TACT_WATCHDOG_FED}
    board.mode = lib.TACT_ARMED
    assert lib.tact_supervisor_tick(supervisor, board, 1) == ALL


def test_supervisor__fault__brakes_for_a_quarter_of_a_second_then_the_amplifier_is_off():
    board, supervisor = made(lib.TACT_FAULT)
    board.command_fade = 0.5

    def told():
        lib.tact_supervisor_heard(supervisor, board)
        return lib.tact_supervisor_tick(supervisor, board, 1)

    assert [told() for _ in range(2000)] == [ALL] * 2000
    board.command_fade = 0.0
    said = [told() for _ in range(2000)]
    assert said == [ALL] * BRAKE_TICKS + [lib.TACT_WATCHDOG_FED] * (2000 - BRAKE_TICKS)


def test_supervisor__converters_fail__outputs_safe_at_once():
    board, supervisor = made(lib.TACT_RUNNING)
    assert lib.tact_supervisor_tick(supervisor, board, 1) == ALL
    assert lib.tact_supervisor_tick(supervisor, board, 0) == 0
    assert lib.tact_supervisor_tick(supervisor, board, 1) == 0
    assert supervisor.lost == lib.TACT_LOST_CONVERTERS


def test_supervisor__table_changed_in_memory__outputs_safe():
    board, supervisor = made(lib.TACT_RUNNING)
    board.taken = 1
    lib.tact_supervisor_heard(supervisor, board)
    board.safety.channel[1].comfort_max = 1.0
    for tick in range(200):
        board.ticks = tick
        lib.tact_supervisor_heard(supervisor, board)
        if lib.tact_supervisor_tick(supervisor, board, 1) == 0:
            break
    assert supervisor.lost == lib.TACT_LOST_TABLES
    assert tick < 0.02 * RATE_HZ


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.booleans(), st.floats(0.0, 1.0)), max_size=60))
def test_supervisor__whatever_happens__off_is_never_on_and_lost_stays_lost(events):
    board, supervisor = made(lib.TACT_OFF)
    lost = False
    for mode, hears, sound, command_fade in events:
        board.mode, board.command_fade = mode, command_fade
        if hears:
            lib.tact_supervisor_heard(supervisor, board)
        said = lib.tact_supervisor_tick(supervisor, board, sound)
        assert said in (0, lib.TACT_WATCHDOG_FED, ALL)
        assert not (mode == lib.TACT_OFF and said & lib.TACT_OUTPUTS_ON)
        assert not (lost and said)
        lost = said == 0
