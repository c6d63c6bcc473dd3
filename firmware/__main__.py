"""`python -m firmware`: a program for a board, and whether a connected board computes what this machine does."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import cast

from firmware.build import build, find_board, memory_used, read_boards, write_program
from firmware.verify import verify
from tactuator.api.parameters import paper_display
from tactuator.errors import BadInput, TactuatorError
from tactuator.io.controller import read_controller
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.open import open_rig
from tactuator.rig.transport import BAUD
from tactuator.synthesis.design import design_controller


def _program(asked: argparse.Namespace) -> int:
    board = find_board(asked.board)
    flags = (*board.flags, f"-DTACT_CRYSTAL_MHZ={asked.crystal_mhz}")
    program = build(replace(board, baud=asked.baud, flags=flags))
    write_program(program, asked.out)
    flash, ram = memory_used(program)
    print(f"{asked.out}: {board.describes}, {flash} bytes of flash, {ram} bytes of RAM")
    port = "board:PORT" if asked.baud == BAUD else f"board:PORT@{asked.baud}"
    print(f"{asked.baud} baud: reach it as {port}")
    return 0


def _verify(asked: argparse.Namespace) -> int:
    if not asked.rig.startswith("board:"):
        raise BadInput(f"rig {asked.rig!r} is no connected board", "board:PORT or board:URL")
    controller = design_controller(paper_display()) if asked.controller is None else read_controller(asked.controller)
    with cast("BoardRig", open_rig(asked.rig, controller.display)) as rig:
        found = verify(rig, controller, asked.seconds, bare=asked.bare)
    word = "bit for bit this machine's"
    if found.first_difference is not None:
        word = f"NOT this machine's from tick {found.first_difference} on"
    print(f"{found.board}: commands of {found.ticks} ticks are {word}; {found.late} interrupts were late")
    if found.cycles:
        boards = read_boards()
        period = boards[found.board].clock_hz / controller.rate_hz if found.board in boards else float("nan")
        print(f"a step takes up to {found.cycles} cycles, {100.0 * found.cycles / period:.1f} % of a period")
    return 0 if found.holds else 1


def main(words: list[str] | None = None) -> int:
    """Do what the command line asks for; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m firmware", description=__doc__)
    verbs = parser.add_subparsers(required=True)
    program = verbs.add_parser("program", help="compile a board's program from core/ and firmware/")
    program.add_argument("--board", default="stm32f405", help="name of its folder here (%(default)s)")
    program.add_argument("--out", type=Path, default=Path("firmware.bin"), help="a .elf, .bin or .hex (%(default)s)")
    program.add_argument("--crystal-mhz", type=int, choices=range(4, 27), default=12, metavar="MHZ", help="(12)")
    program.add_argument("--baud", type=int, default=BAUD, help="of the link (%(default)s)")
    program.set_defaults(act=_program)
    check = verbs.add_parser("verify", help="compare a connected board's commands with this machine's; it plays")
    check.add_argument("--rig", required=True, help="board:PORT or board:URL")
    check.add_argument("--controller", type=Path, help="a controller.json (one is designed for the paper's display)")
    check.add_argument("--seconds", type=float, default=10.0, help="(%(default)s)")
    check.add_argument("--bare", action="store_true", help="without converters: it computes, its outputs stay off")
    check.set_defaults(act=_verify)
    asked = parser.parse_args(words)
    try:
        return int(asked.act(asked))
    except TactuatorError as error:
        print(f"firmware: {error}", file=sys.stderr)
        return error.exit_status


if __name__ == "__main__":
    sys.exit(main())
