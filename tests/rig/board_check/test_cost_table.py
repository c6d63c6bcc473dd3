"""What docs/porting.md says that a period costs, against a count."""

import pytest

from tests.rig.board_check.cost_table import documented, row, table
from tests.rig.guard.guarded import designed


def test_cost_table__as_documented__keeps_what_a_period_may_cost() -> None:
    counts = [int(cell) for cell in documented().splitlines()[2].split("|")[2:-1]]
    assert counts[0] <= 672
    assert max(counts) <= 2500


@pytest.mark.slow
def test_cost_table__float32_as_designed__is_what_a_run_gives() -> None:
    assert row("float32", designed(), "float32") in documented()


@pytest.mark.soak
def test_cost_table__whole__is_what_a_run_gives() -> None:
    assert table() == documented()
