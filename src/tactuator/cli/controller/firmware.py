"""The verb `firmware`: programs for boards, their bits and their cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import cast

import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress, shown, working, written
from tactuator.errors import BadInput
from tactuator.experiment.result.confusion import ResultTable
from tactuator.io.controller import read_controller
from tactuator.model.controller import Controller
from tactuator.paper.plan import paper_display
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.board_check.period_check import check_period
from tactuator.rig.board_check.period_cost import count_cycles, count_instructions
from tactuator.rig.board_check.streaming_check import StreamingCheck, check_streaming
from tactuator.rig.boards import BOARDS, build_firmware, find_board, form_of, memory_used, write_program
from tactuator.rig.open import acknowledge_faults, open_rig
from tactuator.runtime.image import FORMATS
from tactuator.synthesis.design import design_controller


def program(board: str, out: Path, emulated: bool, crystal_mhz: int | None, as_json: bool) -> None:
    """Compile a board's program from core/ and firmware/."""
    found, form = find_board(board), form_of(out)
    flags = () if crystal_mhz is None else (f"-DTACT_CRYSTAL_MHZ={crystal_mhz}",)
    with working("compiling"):
        built = build_firmware(board, emulated or not found.is_real, flags)
    write_program(built, out, form)
    flash, ram = memory_used(built)
    result = {"board": board, "processor": found.describes, "program": str(out)}
    text = f"{found.describes}: {flash} bytes of flash, {ram} bytes of RAM"
    answer({**result, "flash_bytes": flash, "ram_bytes": ram}, as_json, Group(text, *written(out)))


def verify(board: str, rig: str | None, ticks: int, controller: Path | None, as_json: bool) -> None:
    """Compare what a board's interrupt does with this machine's, bit for bit; exit status 1 if they differ."""
    if rig is not None:
        _require_board(rig)
    made = _controller(controller)
    name = rig or f"emulated:{find_board(board).name}"
    with working(f"comparing {ticks} ticks"), cast(BoardRig, open_rig(name, made.display)) as target:
        found = check_period(target, made, ticks)
    word = "bit for bit the same" if found.bit_exact else f"DIFFERENT ({found.first_difference})"
    shown = (
        f"{found.board}: {found.ticks} ticks, {found.channels} channels, {', '.join(found.formats)}: {word}; "
        f"{found.starts} runs, {found.played} samples played, faults: {', '.join(found.faults)}"
    )
    answer(asdict(found), as_json, shown)
    if not found.bit_exact:
        raise typer.Exit(1)


def stream(board: str, seconds: float, instruction_ns: int, controller: Path | None, as_json: bool) -> None:
    """Stream a reference to a board whose time goes on; exit status 1 if an interrupt was late or a row missing."""
    made = _controller(controller)
    with working(f"streaming {seconds:g} s"):
        found = check_streaming(board, made, seconds, instruction_ns)
    answer({**asdict(found), "holds": found.holds}, as_json, _streaming_table(found))
    if not found.holds:
        raise typer.Exit(1)


def bench(controller: Path | None, rig: str | None, as_json: bool) -> None:
    """Count the instructions of one period on every board, in every format, in the usual run and in others.

    With --rig, the processor's cycles on a connected board, at rest, in silence and with tones of 26 dB SL.
    """
    if rig is not None:
        _require_board(rig)
    made = _controller(controller)
    if rig is not None:
        _count_cycles(rig, made, as_json)
        return
    pairs = list(product(BOARDS, FORMATS))
    with progress() as bars:
        counted = bars.track(pairs, description="boards and formats")
        costs = [count_instructions(board, made, number_format) for board, number_format in counted]
    cases = list(costs[0].cases)
    lines = []
    for cost in costs:
        share = f"{100.0 * cost.worst_share_of_period['168 MHz']:.1f} %"
        lines.append((cost.board, cost.format, *(str(cost.cases[case]) for case in cases), share))
    table = ResultTable(
        "Instructions of a period, the most of any", ("board", "format", *cases, "worst at 168 MHz"), tuple(lines)
    )
    rows = [asdict(cost) for cost in costs]
    answer(cast(Mapping[str, object], rows), as_json, shown(table))  # a list, one object for each


def _count_cycles(rig: str, controller: Controller, as_json: bool) -> None:
    with working("counting cycles"), cast(BoardRig, open_rig(rig, controller.display)) as board:
        found = count_cycles(board, controller)
    table = Table("", "periods", "least", "mean", "most", "of the period", "instructions")
    table.title = f"{found.board}: cycles of a step, {found.channels} channels, {found.format}"
    for name, case in found.cases.items():
        known = "" if case.instructions is None else str(case.instructions)
        counts = (str(case.periods), str(case.least), f"{case.mean:.0f}", str(case.most))
        table.add_row(name, *counts, f"{100.0 * case.share_of_period:.1f} %", known)
    answer(asdict(found), as_json, table)


def acknowledge(rig: str, as_json: bool) -> None:
    """Tell a board that its sensor faults are known: after three of them it stays off until then."""
    _require_board(rig)
    count = acknowledge_faults(rig.removeprefix("board:"))
    answer({"rig": rig, "sensor_faults": count}, as_json, f"{rig}: {count} sensor and travel faults acknowledged")


def _require_board(rig: str) -> None:
    if not rig.startswith("board:"):
        raise BadInput(f"rig {rig!r} is no connected board", "board:PORT or board:URL")


def _streaming_table(found: StreamingCheck) -> Table:
    clock = f"{found.instructions_per_s / 1e6:g} million instructions a second"
    table = Table("", "", title=f"{found.board}: {found.channels} channels at {found.rate_hz:g} Hz, {clock}")
    for words, value in (
        ("samples sent", f"{found.samples}"),
        ("samples played", f"{found.played}"),
        (f"interrupts late by {100.0 * found.lateness_max:g} % of a period", f"{found.late}"),
        ("ticks without a row", f"{found.dry}"),
        ("frames dropped", f"{found.dropped}"),
        ("commands and readings", "bit for bit this machine's" if found.bit_exact else "DIFFERENT"),
        ("fault", found.fault),
        ("link, to the board", f"{found.to_board_bytes_per_s:.0f} bytes/s"),
        ("link, from the board", f"{found.from_board_bytes_per_s:.0f} bytes/s"),
        ("time of the board, of the host", f"{found.board_s:.2f} s, {found.host_s:.1f} s"),
    ):
        table.add_row(words, value)
    return table


def _controller(path: Path | None) -> Controller:
    """Return the controller of a file, or the one that `design` makes for the example display."""
    if path is not None:
        return read_controller(path)
    with working("designing a controller"):
        return design_controller(paper_display())
