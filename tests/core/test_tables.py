"""Tables in memory, checked in turn: any bit that turns over is found; what changes by right is taken for none."""

import shlex
import subprocess
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.runtime._core import ffi, lib
from tests.rig.guard.guarded import Guarded, designed

ROUND = 4096
"""Words: more than all tables have."""


@pytest.fixture(scope="module")
def guarded() -> Guarded:
    return Guarded(designed())


def learnt(guarded: Guarded):
    tables = ffi.new("tact_tables *")
    lib.tact_tables_learn(tables, guarded.board)
    return tables


def is_whole(tables, guarded: Guarded) -> bool:
    """Whether two rounds, in stretches, find nothing."""
    return all(lib.tact_tables_check(tables, guarded.board, 60) for _ in range(2 * ROUND // 60))


def places(board) -> list[tuple[int, int]]:
    """Where tables lie in a board, from the declarations: offset and size."""
    return [(ffi.offsetof("tact_board", name), ffi.sizeof(f"tact_{name}")) for name in ("safety", "image")]


@given(data=st.data())
@settings(max_examples=50)
def test_tables__any_bit_turned_over__is_found_within_a_round(guarded, data):
    spans = places(guarded.board)
    offset, size = data.draw(st.sampled_from(spans))
    at = offset + data.draw(st.integers(0, size - 1))
    bit = 1 << data.draw(st.integers(0, 7))
    tables, memory = learnt(guarded), ffi.buffer(guarded.board)
    memory[at] = bytes([memory[at][0] ^ bit])
    try:
        assert not is_whole(tables, guarded)
    finally:
        memory[at] = bytes([memory[at][0] ^ bit])
    assert is_whole(learnt(guarded), guarded)


def test_tables__a_run_with_its_states_and_faults__changes_none():
    guarded = Guarded(designed())
    tables = learnt(guarded)
    before = bytes(ffi.buffer(guarded.board))
    rows = np.full((900, 3), 40.0)
    for row in rows.astype(np.float32):
        lib.tact_board_stream(guarded.board, guarded.board.tick, ffi.from_buffer("float[]", row), 1)
        lib.tact_simulated_board_period(guarded.simulated, guarded.board, 0)
        assert lib.tact_tables_check(tables, guarded.board, 200)
    assert bytes(ffi.buffer(guarded.board)) != before


def test_tables__two_words_changed_places__are_found_but_a_new_image_is_learnt_anew(guarded):
    tables, section = learnt(guarded), guarded.board.safety.channel[0]
    assert section.drive != section.damp
    section.drive, section.damp = section.damp, section.drive
    assert not is_whole(tables, guarded)
    section.drive, section.damp = section.damp, section.drive
    guarded.board.taken += 1
    guarded.board.image.crc ^= 1
    assert is_whole(tables, guarded)
    guarded.board.image.crc ^= 1
    assert not is_whole(tables, guarded)


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
def test_supervisor__main_loop_stuck__outputs_safe_after_8_ms_and_for_good(mode):
    board, supervisor = made(mode)
    for _ in range(1000):
        assert lib.tact_supervisor_tick(supervisor, board, 1) == ALL
        lib.tact_supervisor_heard(supervisor, board)
    said = [lib.tact_supervisor_tick(supervisor, board, 1) for _ in range(100)]
    assert said == [ALL] * DEAF_TICKS + [0] * (100 - DEAF_TICKS)
    lib.tact_supervisor_heard(supervisor, board)
    assert lib.tact_supervisor_tick(supervisor, board, 1) == 0
    assert supervisor.lost == lib.TACT_LOST_MAIN_LOOP


def test_supervisor__off__outputs_safe_and_watchdog_fed():
    board, supervisor = made(lib.TACT_OFF)
    assert {lib.tact_supervisor_tick(supervisor, board, 1) for _ in range(10_000)} == {lib.TACT_WATCHDOG_FED}
    board.mode = lib.TACT_ARMED
    assert lib.tact_supervisor_tick(supervisor, board, 1) == ALL


def test_supervisor__fault__brakes_then_the_amplifier_is_off():
    board, supervisor = made(lib.TACT_FAULT)
    board.command_fade = 0.5

    def told():
        lib.tact_supervisor_heard(supervisor, board)
        return lib.tact_supervisor_tick(supervisor, board, 1)

    assert [told() for _ in range(1200)] == [ALL] * 1200
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


ROOT = Path(__file__).resolve().parents[2]


def test_loops__hostile_numbers__nothing_undefined_and_nothing_out_of_bounds(tmp_path: Path) -> None:
    parts = ("arithmetic", "control", "touch", "strength")
    sources = [path for part in parts for path in sorted((ROOT / "core" / part).glob("*.c"))]
    sources += [ROOT / f"core/display/{name}.c" for name in ("display", "friction", "hum")]
    sources += [ROOT / "core/host/closed_loop.c"]
    compiler = shlex.split(sysconfig.get_config_var("CC") or "cc")[0]
    # not optimised: no undefined operation is optimised away
    flags = "-std=c99 -O0 -g1 -ffp-contract=off -Wall -Wextra -Werror -fno-sanitize-recover=all"
    sanitisers = "-fsanitize=address,undefined,float-cast-overflow"
    program = tmp_path / "sanitised"
    command = [compiler, *flags.split(), sanitisers, "-I", ROOT / "core", ROOT / "tests/core/sanitised.c", *sources]
    subprocess.run([*command, "-o", program], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "sound\n"), done.stderr
