"""What docs/porting.md says that a period costs, against a count."""

import struct

import numpy as np
import pytest

from tactuator.rig.board.link import Request
from tactuator.rig.open import emulated_rig
from tactuator.rig.period_cost import COUNTING
from tests.rig.cost_table import counted, documented, row, table
from tests.rig.guard.guarded import designed
from tests.strength import reshaped

COUNTS = [int(cell) for cell in documented().splitlines()[2].split("|")[2:-1]]


def test_cost_table__as_documented__keeps_what_a_period_may_cost() -> None:
    assert COUNTS[0] <= 672
    assert max(COUNTS) <= 2500


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
def test_cost_table__float32_as_designed__is_what_a_run_gives_and_reshaping_takes_no_more() -> None:
    assert row("float32", designed(), "float32") in documented()
    assert all(np.array(list(counted(reshaped(designed()), "float32").values())) <= COUNTS)


@pytest.mark.soak
def test_cost_table__whole__is_what_a_run_gives() -> None:
    assert table() == documented()
