"""The parts of the verb `firmware`: programs for boards, their bits and their cost."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from tactuator.errors import BadInput
from tactuator.table import ResultTable
from tactuator.verbs.parameters import ControllerOption, Option, Place, constant, paper_display, read
from tactuator.verbs.result import Result, working

if TYPE_CHECKING:
    from tactuator.model.controller import Controller
    from tactuator.rig.board.rig import BoardRig
    from tactuator.rig.period_check import PeriodCheck
    from tactuator.rig.period_cost import PeriodCost, PeriodCycles
    from tactuator.rig.streaming_check import StreamingCheck

Board = Annotated[str, Option("Board: the name of its folder in firmware/.")]


@dataclass(frozen=True, eq=False, repr=False)
class ProgramResult(Result):
    """A program for a board, and the memory that it takes."""

    board: str
    processor: str
    program: Path
    flash_bytes: int
    ram_bytes: int

    def headline(self) -> Mapping[str, str]:
        return {self.processor: f"{self.flash_bytes} bytes of flash, {self.ram_bytes} bytes of RAM"}


def program(
    board: Board = "mps2-an500",
    out: Annotated[Place, Option("File to write: .elf, .bin or .hex.", writes=True, shell=Path("firmware.elf"))] = (
        "firmware.elf"
    ),
    emulated: Annotated[bool, Option("For the emulator, not the board itself.")] = False,
    crystal_mhz: Annotated[int | None, Option("Of the board itself: 12 if not given.", ge=4, le=26)] = None,
) -> ProgramResult:
    """Compile a board's program from core/ and firmware/.

    Raises BadInput for another board or ending, and where the compiler is missing.
    """
    from tactuator.rig.boards import build_firmware, find_board, form_of, memory_used, write_program

    target, form = find_board(board), form_of(Path(out))
    flags = () if crystal_mhz is None else (f"-DTACT_CRYSTAL_MHZ={crystal_mhz}",)
    with working("compiling"):
        compiled = build_firmware(board, emulated or not target.is_real, flags)
    write_program(compiled, Path(out), form)
    return ProgramResult(board, target.describes, Path(out), *memory_used(compiled))


@dataclass(frozen=True, eq=False, repr=False)
class CheckResult(Result):
    """A check of a board: its figures, what is printed of them, and whether it holds."""

    check: "PeriodCheck | StreamingCheck | PeriodCycles"
    shown: ResultTable | str
    is_held: bool = True

    @property
    def holds(self) -> bool:
        return self.is_held

    def headline(self) -> Mapping[str, str]:
        return {"board": self.check.board, "holds": "yes" if self.holds else "no"}

    def to_dict(self) -> dict[str, Any]:
        return asdict(self.check) | {"holds": self.holds}

    def tables(self) -> Sequence[ResultTable | str]:
        return [self.shown]


def verify(
    board: Board = "mps2-an500",
    rig: Annotated[str | None, Option("A board that is connected, instead: board:PORT or board:URL.")] = None,
    ticks: Annotated[int, Option("Ticks of the interrupt.")] = 100_000,
    controller: ControllerOption = None,
) -> CheckResult:
    """Compare a board's interrupt with this machine's. Every bit has to be the same; exit status 1 if one differs."""
    from tactuator.rig.boards import find_board
    from tactuator.rig.open import open_rig
    from tactuator.rig.period_check import check_period

    if rig is not None:
        _require_board(rig)
    loaded = _controller(controller)
    name = rig or f"emulated:{find_board(board).name}"
    with working(f"comparing {ticks} ticks"), cast("BoardRig", open_rig(name, loaded.display)) as target:
        check = check_period(target, loaded, ticks)
    word = "bit for bit the same" if check.bit_exact else f"DIFFERENT ({check.first_difference})"
    line = (
        f"{check.board}: {check.ticks} ticks, {check.channels} channels: {word}; "
        f"{check.starts} runs, {check.played} samples played, faults: {', '.join(check.faults)}"
    )
    return CheckResult(check, line, check.bit_exact)


def stream(
    board: Board = "mps2-an500",
    seconds: Annotated[float, Option("Seconds of the board's time.")] = 10.0,
    instruction_ns: Annotated[int, Option("What an instruction takes: 1, 2, 4, 8 (125 MIPS), ...")] = constant(
        "rig.streaming_check", "INSTRUCTION_NS"
    ),
    controller: ControllerOption = None,
) -> CheckResult:
    """Stream a reference to a board whose time goes on. Exit status 1 if an interrupt was late or a row missing."""
    from tactuator.rig.streaming_check import check_streaming

    loaded = _controller(controller)
    with working(f"streaming {seconds:g} s"):
        check = check_streaming(board, loaded, seconds, instruction_ns)
    rows = (
        ("samples sent", f"{check.samples}"),
        ("samples played", f"{check.played}"),
        (f"interrupts late by {100.0 * check.lateness_max:g} % of a period", f"{check.late}"),
        ("ticks without a row", f"{check.dry}"),
        ("frames dropped", f"{check.dropped}"),
        ("commands and readings", "bit for bit this machine's" if check.bit_exact else "DIFFERENT"),
        ("fault", check.fault),
        ("link, to the board", f"{check.to_board_bytes_per_s:.0f} bytes/s"),
        ("link, from the board", f"{check.from_board_bytes_per_s:.0f} bytes/s"),
        ("time of the board, of the host", f"{check.board_s:.2f} s, {check.host_s:.1f} s"),
    )
    clock = f"{check.instructions_per_s / 1e6:g} million instructions a second"
    title = f"{check.board}: {check.channels} channels at {check.rate_hz:g} Hz, {clock}"
    return CheckResult(check, ResultTable(title, ("", ""), rows), check.holds)


@dataclass(frozen=True, eq=False, repr=False)
class BenchResult(Result):
    """Instructions of one period on every board."""

    costs: "tuple[PeriodCost, ...]"

    def headline(self) -> Mapping[str, str]:
        return {cost.board: f"{cost.cases['usual']} instructions" for cost in self.costs}

    def to_dict(self) -> Any:
        return [asdict(cost) for cost in self.costs]

    def tables(self) -> Sequence[ResultTable | str]:
        cases = list(self.costs[0].cases)
        rows = []
        for cost in self.costs:
            share = f"{100.0 * cost.worst_share_of_period['168 MHz']:.1f} %"
            rows.append((cost.board, *(str(cost.cases[case]) for case in cases), share))
        columns = ("board", *cases, "worst at 168 MHz")
        return [ResultTable("Instructions of a period, the most of any", columns, tuple(rows))]


def bench(
    controller: ControllerOption = None,
    rig: Annotated[str | None, Option("A connected board with a counter of cycles, instead; it plays.")] = None,
) -> BenchResult | CheckResult:
    """Count the instructions of one period, on every board. With --rig, a connected board's cycles."""
    from tactuator.rig.boards import BOARDS
    from tactuator.rig.open import open_rig
    from tactuator.rig.period_cost import count_cycles, count_instructions

    if rig is not None:
        _require_board(rig)
    loaded = _controller(controller)
    if rig is not None:
        with working("counting cycles"), cast("BoardRig", open_rig(rig, loaded.display)) as board:
            cycles = count_cycles(board, loaded)
        return CheckResult(cycles, _cycles_table(cycles))
    costs: list[PeriodCost] = []
    with working("boards", len(BOARDS)) as step:
        for name in BOARDS:
            costs.append(count_instructions(name, loaded))
            step(len(costs))
    return BenchResult(tuple(costs))


def _cycles_table(cycles: "PeriodCycles") -> ResultTable:
    rows = tuple(
        (
            name,
            str(case.periods),
            str(case.least),
            f"{case.mean:.0f}",
            str(case.most),
            f"{100.0 * case.share_of_period:.1f} %",
            "" if case.instructions is None else str(case.instructions),
        )
        for name, case in cycles.cases.items()
    )
    columns = ("", "periods", "least", "mean", "most", "of the period", "instructions")
    title = f"{cycles.board}: cycles of a step, {cycles.channels} channels"
    return ResultTable(title, columns, rows)


@dataclass(frozen=True, eq=False, repr=False)
class AcknowledgedResult(Result):
    """Faults of a board that were acknowledged."""

    rig: str
    sensor_faults: int

    def headline(self) -> Mapping[str, str]:
        return {self.rig: f"{self.sensor_faults} sensor and travel faults acknowledged"}


def acknowledge(rig: Annotated[str, Option("The board: board:PORT or board:URL.")]) -> AcknowledgedResult:
    """Tell a board that its sensor faults are known. After three of them it stays off until then."""
    from tactuator.rig.open import acknowledge_faults

    _require_board(rig)
    return AcknowledgedResult(rig, acknowledge_faults(rig.removeprefix("board:")))


def _require_board(rig: str) -> None:
    if not rig.startswith("board:"):
        raise BadInput(f"rig {rig!r} is no connected board", "board:PORT or board:URL")


def _controller(controller: "Controller | Place | None") -> "Controller":
    from tactuator.synthesis.design import design_controller

    if controller is not None:
        return read(controller)
    with working("designing a controller"):
        return design_controller(paper_display())
