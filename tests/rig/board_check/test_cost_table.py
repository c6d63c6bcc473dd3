"""What docs/porting.md says that a period costs, against a count."""

import struct

import pytest

from tactuator.rig.board.link import Request
from tactuator.rig.board_check.period_cost import COUNTING
from tactuator.rig.open import emulated_rig
from tests.rig.board_check.cost_table import documented, row, table
from tests.rig.guard.guarded import designed


def test_cost_table__as_documented__keeps_what_a_period_may_cost() -> None:
    counts = [int(cell) for cell in documented().splitlines()[2].split("|")[2:-1]]
    assert counts[0] <= 672
    assert max(counts) <= 2500


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
def test_cost_table__float32_as_designed__is_what_a_run_gives() -> None:
    assert row("float32", designed(), "float32") in documented()


@pytest.mark.soak
def test_cost_table__whole__is_what_a_run_gives() -> None:
    assert table() == documented()
