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
FORMATS = {"float32": "float32", "Q31": "q31"}
DOCS = Path(__file__).resolve().parents[2] / "docs" / "porting.md"
BEGIN, END = "<!-- cost: begin -->\n", "<!-- cost: end -->\n"


def row(name: str, controller: Controller, number_format: str) -> str:
    return f"| {name} | " + " | ".join(map(str, counted(controller, number_format).values())) + " |\n"


def counted(controller: Controller, number_format: str) -> dict[str, int]:
    return count_instructions(BOARD, controller, number_format).cases


def table() -> str:
    cases = list(counted(designed(), "float32"))
    lines = ["| | " + " | ".join(cases) + " |\n", "|---|" + "---|" * len(cases) + "\n"]
    lines += [row(name, designed(), code) for name, code in FORMATS.items()]
    lines += [row(f"{name}, finger fed forward", adaptive(), code) for name, code in FORMATS.items()]
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


def is_kept(usual: int, *others: int) -> bool:
    """Whether these counts are what a period in float32 may cost."""
    return usual <= 672 and max(others) <= 2500


def test_cost_table__as_documented__keeps_what_a_period_may_cost() -> None:
    assert is_kept(*COUNTS[0])


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
def test_cost_table__float32_as_designed__is_near_what_a_run_gives_and_reshaping_takes_no_more() -> None:
    run, of_reshaped = (list(counted(each, "float32").values()) for each in (designed(), reshaped(designed())))
    assert run == pytest.approx(COUNTS[0], rel=NEAR)
    assert is_kept(*run)
    assert all(np.array(of_reshaped) <= (1.0 + NEAR) * np.array(run))


@pytest.mark.soak
def test_cost_table__whole__is_near_what_a_run_gives() -> None:
    anew = table()
    assert re.sub(r"\d+ ", "", anew) == re.sub(r"\d+ ", "", documented())
    assert np.array(counts(anew)) == pytest.approx(np.array(COUNTS), rel=NEAR)


if __name__ == "__main__":
    main()
