"""What docs/porting.md says that a period costs, against a count, by which this program writes it anew."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest

from tactuator.model.controller import Controller
from tactuator.rig.board.link import Request
from tactuator.rig.open import emulated_rig
from tactuator.rig.period_cost import COUNTING, count_instructions
from tests.rig.guard.guarded import adaptive, designed
from tests.strength import reshaped

BOARD = "mps2-an386"
DOCS = Path(__file__).resolve().parents[2] / "docs" / "porting.md"
BEGIN, END = "<!-- cost: begin -->\n", "<!-- cost: end -->\n"


def row(name: str, controller: Controller) -> str:
    return f"| {name} | " + " | ".join(map(str, counted(controller).values())) + " |\n"


def counted(controller: Controller) -> dict[str, int]:
    return count_instructions(BOARD, controller).cases


def table() -> str:
    cases = list(counted(designed()))
    lines = ["| | " + " | ".join(cases) + " |\n", "|---|" + "---|" * len(cases) + "\n"]
    lines += [row("as designed", designed()), row("finger fed forward", adaptive())]
    return "".join(lines)


def documented() -> str:
    return DOCS.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0].strip() + "\n"


def main() -> None:
    before, rest = DOCS.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    DOCS.write_text(before + BEGIN + "\n" + table() + "\n" + END + after, encoding="utf-8")


def counts(of: str) -> list[list[int]]:
    return [[int(cell) for cell in line.split("|")[2:-1]] for line in of.splitlines()[2:]]


COUNTS = counts(documented())
NEAR = 0.02
"""The last bits of a design differ between processors, and with them which of a run's ticks takes the most."""


def is_kept(most: int, usual: int, *others: int) -> bool:
    """Whether the usual tick takes at most so many instructions, and any other at most a tenth of a period."""
    return usual <= most and max(others) <= 4200


def test_cost_table__as_documented__keeps_what_a_period_may_cost() -> None:
    assert is_kept(1200, *COUNTS[0])
    assert is_kept(2000, *COUNTS[1])


def test_count__asked_for_again__is_told_and_no_period_passes() -> None:
    with emulated_rig("mps2-an500", designed().display, 0, counting=COUNTING) as rig:
        rig.load(designed())

        def ask(periods: int) -> tuple[bytes, int]:
            return rig.client.must(Request.BENCH, struct.pack("<I", periods)), rig.status().ticks

        counted, begun = ask(7)
        assert ask(7) == (counted, begun)
        assert ask(0) == (bytes(16), begun)
        assert ask(7)[1] == begun + 7


@pytest.mark.slow
def test_cost_table__as_designed__is_near_what_a_run_gives() -> None:
    run, of_reshaped = (list(counted(each).values()) for each in (designed(), reshaped(designed())))
    assert run == pytest.approx(COUNTS[0], rel=NEAR)
    assert is_kept(1200, *run)
    assert all(np.array(of_reshaped) <= (1.0 + NEAR) * np.array(run))


@pytest.mark.soak
def test_cost_table__whole__is_near_what_a_run_gives() -> None:
    anew = table()
    assert re.sub(r"\d+ ", "", anew) == re.sub(r"\d+ ", "", documented())
    assert np.array(counts(anew)) == pytest.approx(np.array(COUNTS), rel=NEAR)


if __name__ == "__main__":
    main()
