"""The check of a board's interrupt is checked: one altered line of its program, and it must say so."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tactuator.errors import DeviceFault, TactuatorError
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.board_check.period_check import check_period
from tactuator.rig.board_rigs import simulated_board_rig
from tactuator.rig.boards import BOARDS
from tactuator.rig.transport.emulator import Emulator
from tactuator.rig.transport.transport import LinkDown
from tactuator.runtime.image import FORMATS
from tests.rig.board_check.mutants import FEW, MANY, Bench, Mutant
from tests.rig.guard.guarded import designed

ENOUGH_TICKS, TICKS = 30_000, 200_000
EMULATED = [name for name, board in BOARDS.items() if board.has_fifos]
"""The STM32F405 is a Cortex-M4F as one of these; what it has besides is in test_verified_boards.py."""


@contextmanager
def running(board: str, program: Path) -> Iterator[BoardRig]:
    rig = simulated_board_rig(Emulator(board, program=program), designed().display, 0, "float32")
    try:
        yield rig
    finally:
        rig.client.close()


def differs(board: str, program: Path, number_format: str, ticks: int) -> str:
    """Where a program differs; "" nowhere. A board whose guard ends the run, or that will not load, does; one that does
    not answer says nothing, since the emulator may be starved."""
    try:
        with running(board, program) as rig:
            return check_period(rig, designed(), ticks, formats=(number_format,)).first_difference
    except LinkDown:
        raise
    except (DeviceFault, TactuatorError) as error:
        return f"it ends: {error}"


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Bench]:
    """One for each board, made when it is first asked for."""
    return _Benches(tmp_path_factory)


class _Benches(dict[str, Bench]):
    def __init__(self, folders: pytest.TempPathFactory) -> None:
        super().__init__()
        self._folders = folders

    def __missing__(self, board: str) -> Bench:
        self[board] = Bench(board, self._folders.mktemp(board))
        return self[board]


@pytest.mark.parametrize("mutant", FEW, ids=lambda mutant: mutant.name)
def test_check_period__altered_line__is_noticed(mutant: Mutant, benches: dict[str, Bench]) -> None:
    program = benches["mps2-an500"].program(mutant)
    assert differs("mps2-an500", program, mutant.only or "float32", ENOUGH_TICKS)


def test_check_period__unaltered__is_the_same_in_both_formats(benches: dict[str, Bench]) -> None:
    program = benches["mps2-an500"].unaltered()
    for number_format in FORMATS:
        assert differs("mps2-an500", program, number_format, ENOUGH_TICKS) == ""


@pytest.mark.soak
@pytest.mark.parametrize("board", EMULATED)
@pytest.mark.parametrize("mutant", [*FEW, *MANY], ids=lambda mutant: mutant.name)
def test_check_period__any_altered_line_on_any_board__is_noticed(
    mutant: Mutant, board: str, benches: dict[str, Bench]
) -> None:
    program = benches[board].program(mutant)
    for number_format in [mutant.only] if mutant.only else FORMATS:
        assert differs(board, program, number_format, TICKS)


@pytest.mark.soak
@pytest.mark.parametrize("board", EMULATED)
@pytest.mark.parametrize("number_format", FORMATS)
def test_check_period__ten_million_ticks__are_the_same(
    board: str, number_format: str, benches: dict[str, Bench]
) -> None:
    assert differs(board, benches[board].unaltered(), number_format, 10_000_000) == ""
