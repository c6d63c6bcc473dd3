"""`tactuator firmware`: programs for boards, their bits and their cost."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, cast

import typer
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.cli.controllers import ControllerOption
from tactuator.cli.options import AsJson
from tactuator.design.controller import design_controller
from tactuator.digital.controller import Controller
from tactuator.digital.image import FORMATS
from tactuator.files.atomic import atomic_path
from tactuator.files.controller import read_controller
from tactuator.rig.firmware import BOARDS, build_firmware, find_board
from tactuator.rig.trials import compare_bits, count_instructions
from tactuator.study.plan import paper_display

BoardOption = Annotated[str, typer.Option("--board", help=f"Board: {', '.join(BOARDS)}.")]


def register(app: typer.Typer) -> None:
    """Add the verb and what it can do."""
    firmware = typer.Typer(help="Programs for boards: build them, compare their bits, count their instructions.")
    app.add_typer(firmware, name="firmware")

    @firmware.command()
    def program(
        board: BoardOption = "mps2-an500",
        out: Annotated[Path, typer.Option("--out", help="ELF file to write.")] = Path("firmware.elf"),
        as_json: AsJson = False,
    ) -> None:
        """Compile a board's program from core/ and firmware/."""
        built = build_firmware(board)
        with atomic_path(out) as beside:
            shutil.copyfile(built, beside)
        result = {"board": board, "processor": find_board(board).describes, "program": str(out)}
        answer(result, as_json, f"{out}: {find_board(board).describes}")

    @firmware.command()
    def verify(
        board: BoardOption = "mps2-an500",
        samples: Annotated[
            int, typer.Option("--samples", help="Samples of every channel, in each format.")
        ] = 1_000_000,
        controller: ControllerOption = None,
        as_json: AsJson = False,
    ) -> None:
        """Compare a board's commands with this machine's, bit for bit; exit status 1 if they differ."""
        found = compare_bits(board, _controller(controller), samples)
        word = "bit for bit the same" if found.bit_exact else "DIFFERENT"
        shown = f"{board}: {found.samples} samples, {found.channels} channels, {', '.join(found.formats)}: {word}"
        answer(asdict(found), as_json, shown)
        if not found.bit_exact:
            raise typer.Exit(1)

    @firmware.command()
    def bench(controller: ControllerOption = None, as_json: AsJson = False) -> None:
        """Count the instructions of one period on every board and in every format."""
        made = _controller(controller)
        costs = [count_instructions(board, made, number_format) for board in BOARDS for number_format in FORMATS]
        table = Table("board", "format", "channels", "instructions a tick", "share of a period at", title="One period")
        for cost in costs:
            shares = ", ".join(f"{clock} {100.0 * share:.2f} %" for clock, share in cost.share_of_period.items())
            table.add_row(cost.board, cost.format, str(cost.channels), str(cost.instructions_per_tick), shares)
        rows = [asdict(cost) for cost in costs]
        answer(cast(Mapping[str, object], rows), as_json, table)  # a list, one object for each


def _controller(path: Path | None) -> Controller:
    """The controller of a file, or the one that `design` makes for the example display."""
    return design_controller(paper_display()) if path is None else read_controller(path)
