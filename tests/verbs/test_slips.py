"""Files with one slip in them, and right ones, as a person would bring them (`witnesses.slips`, which prints both)."""

from pathlib import Path

import pytest

from witnesses.slips.said import alarms, faults, said_of
from witnesses.slips.setups import RIGHT, SLIPS, Slip


def test_slips__as_many_as_were_promised__are_tried_and_as_many_right_files() -> None:
    assert len(SLIPS) >= 40
    assert len(RIGHT) >= 40


@pytest.mark.parametrize("slip", SLIPS, ids=lambda slip: slip.name)
def test_verbs__files_with_a_slip__name_it_and_none_ends_in_met(slip: Slip, tmp_path: Path) -> None:
    assert faults(slip, list(said_of(slip, tmp_path))) == []


def test_measure__with_a_slip_in_the_display__doubts_its_numbers_too(tmp_path: Path) -> None:
    slip = next(each for each in SLIPS if each.name == "travel in m")
    said = {each.verb: each for each in said_of(slip, tmp_path, measured=True)}
    assert said["measure"].doubts
    assert said["noise"].doubts
    assert said["measure"].status == said["noise"].status == 1


_LONG = [pytest.mark.slow]  # a model is made first, which takes its second


@pytest.mark.parametrize(
    "slip", [pytest.param(each, id=each.name, marks=_LONG if each.written.plant != "inline" else []) for each in RIGHT]
)
def test_verbs__right_files__raise_no_alarm(slip: Slip, tmp_path: Path) -> None:
    assert alarms(list(said_of(slip, tmp_path))) == []
