"""Emulated boards compute what this machine does, bit for bit, in drawn cases."""

from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from firmware.build import build
from tactuator.errors import TactuatorError
from tactuator.rig.board.link import LinkClient
from tactuator.runtime.safety_table import Fault
from tests.firmware.drawn import Expected
from tests.firmware.emulator import MACHINES, Emulator
from tests.rig.guard.guarded import adaptive, designed

FEW_CASES, CASES = 20, 2_000
BOARDS = [name for name, machine in MACHINES.items() if machine.has_fifos]
"""The STM32F405 is a Cortex-M4F as one of these; what it has besides is in test_verify.py."""


@cache
def expected(is_adaptive: bool) -> Expected:
    return Expected(adaptive() if is_adaptive else designed())


def differs(board: str, program: Path | None, cases: int, is_adaptive: bool = False) -> str:
    """Where a program differs first; "" nowhere. One that ends or does not answer differs."""
    with closing(LinkClient(Emulator(MACHINES[board], program=program), 10.0, tries=2)) as target:
        try:
            return expected(is_adaptive).difference(target, cases)
        except TactuatorError as error:
            return f"it ends: {error}"


@pytest.mark.parametrize("is_adaptive", [False, True])
@pytest.mark.parametrize(
    ("board", "cases"),
    [
        ("mps2-an500", FEW_CASES),
        pytest.param("mps2-an386", FEW_CASES, marks=pytest.mark.slow),
        *(pytest.param(board, 10 * CASES, marks=pytest.mark.soak) for board in BOARDS),
    ],
)
def test_board__drawn_cases__answers_as_this_machine(board: str, cases: int, is_adaptive: bool) -> None:
    assert differs(board, None, cases, is_adaptive) == ""
    if cases >= CASES:
        assert expected(is_adaptive).faults() == set(Fault) - {Fault.LATE}


@pytest.mark.soak
def test_board__optimised_at_link_time__answers_as_this_machine() -> None:
    """What interrupt and main loop share is read and written where it stands, although the compiler sees both."""
    board = MACHINES["mps2-an386"].board
    program = build(replace(board, flags=(*board.flags, "-flto")))
    assert differs("mps2-an386", program, FEW_CASES) == ""
