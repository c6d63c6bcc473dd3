"""The load that touches where nobody names one."""

from types import SimpleNamespace

import pytest

from tactuator.errors import BadInput
from tactuator.rig.rig import usual_load


def channels(*names):
    return [SimpleNamespace(loads=[SimpleNamespace(name=name) for name in own]) for own in names]


@pytest.mark.parametrize(
    ("described", "load"),
    [
        ([["fingertip"]], "fingertip"),
        ([["palm", "finger"]], "finger"),
        ([["palm", "tip"], ["tip", "palm"]], "palm"),
        ([["finger", "tip"], ["tip"]], "tip"),
        ([[], []], "none"),
    ],
)
def test_usual_load__nobody_names_one__finger_or_the_first_that_all_have(described, load):
    assert usual_load(channels(*described)) == load


def test_usual_load__none_in_common__is_refused():
    with pytest.raises(BadInput, match="--load"):
        usual_load(channels(["palm"], ["tip"]))
