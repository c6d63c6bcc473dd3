"""`firmware verify` where it is not usual: over a port, of a program that was optimised as a whole, on an STM32F405."""

from __future__ import annotations

from typing import cast

import pytest

from tactuator.rig.board.rig import BoardRig
from tactuator.rig.board_check.period_check import check_period
from tactuator.rig.boards import build_firmware
from tactuator.rig.emulator import Emulator
from tactuator.rig.open import emulated_rig, open_rig, simulated_board_rig
from tests.rig.board.emulated_ports import serial_board
from tests.rig.guard.guarded import designed


@pytest.mark.slow
def test_check_period__board_at_a_serial_port__bit_exact() -> None:
    """As `firmware verify --rig board:PORT` does, in one of the formats."""
    with serial_board() as (name, _), open_rig(f"board:{name}@921600", designed().display) as rig:
        found = check_period(cast(BoardRig, rig), designed(), 1000, formats=("q31",))
    assert (found.board, found.first_difference) == ("mps2-an500", "")
    assert found.played > 5_000


@pytest.mark.slow
def test_check_period__program_optimised_at_link_time__is_the_same() -> None:
    """What interrupt and main loop share is read and written where it stands, although the compiler sees both."""
    board = "mps2-an386"
    program = build_firmware(board, flags=("-flto",))
    assert program != build_firmware(board)
    with simulated_board_rig(Emulator(board, program=program), designed().display, 0, "float32") as rig:
        found = check_period(rig, designed(), 10_000, formats=("float32",))
    assert found.first_difference == ""
    assert found.played > 5_000


@pytest.mark.soak
def test_check_period__million_ticks_on_an_stm32f405__are_the_same() -> None:
    with emulated_rig("stm32f405", designed().display) as rig:
        found = check_period(rig, designed(), 1_000_000)
    assert found.first_difference == ""
    assert len(found.faults) == 12
