"""Files with one slip in them, and right ones, as a person would bring them.

Tried always: one slip of each field of a file, and a tenth of the right files; in the soak all of them.
Bounds are tried on both sides in `tests/model/test_description.py`.
"""

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.api.slips import RIGHT, SLIPS, Slip, Written, alarms, faults, said_of


def wrong_in(slip: Slip) -> dict[str, object]:
    """The fields that are wrong; one number is as good as another."""
    right = Written(slip.written.plant)
    wrong = {name: value for name, value in vars(slip.written).items() if value != getattr(right, name)}
    return {name: "number" if isinstance(value, float) else value for name, value in wrong.items()}


def tried(slips: Sequence[Slip], always: Sequence[Slip]) -> list[object]:
    return [pytest.param(each, id=each.name, marks=[] if each in always else pytest.mark.soak) for each in slips]


OF_EACH_FIELD = list({(*wrong_in(slip),): slip for slip in reversed(SLIPS)}.values())


def test_slips__as_many_as_were_promised__are_tried_and_as_many_right_files() -> None:
    assert len(SLIPS) >= 40
    assert len(RIGHT) >= 40
    assert len(OF_EACH_FIELD) >= 15


@pytest.mark.parametrize("slip", tried(SLIPS, OF_EACH_FIELD))
def test_verbs__files_with_a_slip__name_it_and_none_ends_in_met(slip: Slip, tmp_path: Path) -> None:
    assert faults(slip, list(said_of(slip, tmp_path))) == []


def test_measure__with_a_slip_in_the_display__doubts_its_numbers_too(tmp_path: Path) -> None:
    slip = next(each for each in SLIPS if each.name == "travel in m")
    said = {each.verb: each for each in said_of(slip, tmp_path, measured=True)}
    assert said["measure response"].doubts
    assert said["measure noise"].doubts
    assert said["measure response"].status == said["measure noise"].status == 1


@pytest.mark.parametrize("slip", tried(RIGHT, RIGHT[::10]))
def test_verbs__right_files__raise_no_alarm(slip: Slip, tmp_path: Path) -> None:
    assert alarms(list(said_of(slip, tmp_path))) == []
