"""The check of a board's interrupt is checked: one altered line of its program, and it must say so."""

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import pytest

from tactuator.errors import BadInput, DeviceFault
from tactuator.model.controller import Controller
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.boards import BOARDS, ROOT, build_firmware
from tactuator.rig.emulator import Emulator
from tactuator.rig.open import emulated_rig, simulated_board_rig
from tactuator.rig.period_check import STRETCH_TICKS, check_period
from tactuator.rig.transport import LinkDown
from tests.rig.guard.guarded import adaptive, designed
from tests.rig.mutants import FEW, MANY, Bench, Mutant

ENOUGH_TICKS, TICKS, MORE_TICKS = 30_000, 200_000, 1_000_000
"""More, for what depends on a table that is seldom drawn: commands of more than 23 bits."""
HANGS_S = 1.0
"""Of a processor, without an answer: a stretch takes the emulator a tenth of a second."""
EMULATED = [name for name, board in BOARDS.items() if board.has_fifos]
"""The STM32F405 is a Cortex-M4F as one of these; what it has besides is in the last test."""


@contextmanager
def running(board: str, program: Path, answer_s: float, controller: Controller) -> Iterator[tuple[BoardRig, Emulator]]:
    emulator = Emulator(board, program=program)
    rig = simulated_board_rig(emulator, controller.display, 0, answer_s)
    try:
        yield rig, emulator
    finally:
        rig.client.close()


def processor_s(emulator: Emulator) -> float:
    """Processor time of the emulator so far: of its group of processes."""
    ticks = 0
    for entry in Path("/proc").iterdir():
        with suppress(OSError):
            words = (entry / "stat").read_text().rsplit(")", 1)[1].split() if entry.name.isdigit() else []
            if words and emulator._process is not None and int(words[2]) == emulator._process.pid:
                ticks += int(words[11]) + int(words[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def differs(
    board: str,
    program: Path,
    ticks: int,
    answer_s: float = 10.0,
    locates: bool = False,
    controller: Controller | None = None,
) -> str:
    """Where a program differs; "" nowhere. A board whose guard ends the run, that breaks down, or that will not load,
    does. So does one that does not answer although it had its processor; if it had not, the emulator is starved, and
    that is told as an error. So is what the unaltered program refuses too: then what was asked for is wrong."""
    of = controller or designed()

    def differs_first(rig: BoardRig) -> str:
        return check_period(rig, of, ticks, locates).first_difference

    with running(board, program, answer_s, of) as (rig, emulator):
        before_s = processor_s(emulator)
        try:
            return differs_first(rig)
        except LinkDown:
            spent_s = processor_s(emulator) - before_s
            if spent_s < HANGS_S + ticks / STRETCH_TICKS:
                raise
            return f"it hangs: no answer in {spent_s:.0f} s of its processor"
        except DeviceFault as error:
            return f"it ends: {error}"
        except BadInput as error:
            refusal = f"it ends: {error}"
    with running(board, build_firmware(board), answer_s, of) as (rig, _):
        differs_first(rig)
    return refusal


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Bench]:
    """One for each board, made when it is first asked for."""
    return cache(lambda board: Bench(board, tmp_path_factory.mktemp(board)))


ALWAYS = [  # every file reads the arithmetic: to alter it takes as long as all others together
    pytest.param(each, id=each.name, marks=[pytest.mark.slow] * each.path.startswith("core/arithmetic/"))
    for each in FEW
]


@pytest.mark.parametrize("mutant", ALWAYS)
def test_check_period__altered_line__is_noticed(mutant: Mutant, bench: Callable[[str], Bench]) -> None:
    program, of = bench("mps2-an500").program(mutant), adaptive() if mutant.adaptive else designed()
    assert differs("mps2-an500", program, ENOUGH_TICKS, controller=of)


@pytest.mark.parametrize("mutant", [*FEW, *MANY], ids=lambda mutant: mutant.name)
def test_mutant__line_that_it_alters__stands_once_in_the_sources(mutant: Mutant) -> None:
    assert (ROOT / mutant.path).read_text().count(mutant.old) == 1


def test_check_period__altered_line__is_told_by_its_tick(bench: Callable[[str], Bench]) -> None:
    """A digest over fewer ticks is the same before that tick, and another from it on."""
    program = bench("mps2-an500").program(FEW[0])
    told = differs("mps2-an500", program, ENOUGH_TICKS, locates=True)
    found = re.fullmatch(r"seed 1, tick (\d+) of a stretch", told)
    assert found
    at = int(found[1])
    assert differs("mps2-an500", program, at).startswith("played")
    assert differs("mps2-an500", program, at + 1) == "seed 1"


@pytest.mark.parametrize(
    ("board", "ticks"),
    [("mps2-an500", ENOUGH_TICKS), *(pytest.param(board, 10_000_000, marks=pytest.mark.soak) for board in EMULATED)],
)
def test_check_period__unaltered__is_the_same(board: str, ticks: int) -> None:
    for of in (designed(), adaptive()):
        assert differs(board, build_firmware(board), ticks, controller=of) == ""


BROKEN = {
    "it hangs": Mutant(
        "check never ends", "core/board/period_check.c", "    return check->result;", "    for (;;) {\n    }"),
    "it ends: the board began anew": Mutant(
        "check breaks down", "core/board/period_check.c", "    return check->result;",
        "    *(volatile uint32_t *)0xE000ED0C = 0x05FA0004u;\n    for (;;) {\n    }"),
}  # fmt: skip


@pytest.mark.parametrize("how", [pytest.param("it hangs", marks=pytest.mark.soak), "it ends: the board began anew"])
def test_check_period__program_that_breaks_down__is_told(how: str, bench: Callable[[str], Bench]) -> None:
    program = bench("mps2-an500").program(BROKEN[how])
    assert differs("mps2-an500", program, 100, 0.3).startswith(how)
    with pytest.raises(BadInput, match="ticks is 0"):  # what no program is asked is not taken for an alteration
        differs("mps2-an500", program, 0)


@pytest.mark.soak
@pytest.mark.parametrize("board", EMULATED)
@pytest.mark.parametrize("mutant", [*FEW, *MANY], ids=lambda mutant: mutant.name)
def test_check_period__any_altered_line_on_any_board__is_noticed(mutant, board, bench) -> None:
    program, of = bench(board).program(mutant), adaptive() if mutant.adaptive else designed()
    reports = (differs(board, program, ticks, controller=of) for ticks in (TICKS, MORE_TICKS))
    noticed = next(filter(None, reports), "")
    sys.stdout.write(f"{mutant.name}: {noticed}\n")  # shown by -rP
    assert noticed


@pytest.mark.slow
def test_check_period__program_optimised_at_link_time__is_the_same() -> None:
    """What interrupt and main loop share is read and written where it stands, although the compiler sees both."""
    board = "mps2-an386"
    program = build_firmware(board, flags=("-flto",))
    assert program != build_firmware(board)
    with simulated_board_rig(Emulator(board, program=program), designed().display, 0) as rig:
        found = check_period(rig, designed(), 10_000)
    assert found.first_difference == ""
    assert found.played > 5_000


@pytest.mark.soak
def test_check_period__million_ticks_on_an_stm32f405__are_the_same() -> None:
    with emulated_rig("stm32f405", designed().display) as rig:
        found = check_period(rig, designed(), 1_000_000)
    assert found.first_difference == ""
    assert len(found.faults) == 12
