"""Rigs of other packages: the page's example is found by its name, and what is no rig is refused."""

import pytest

from tactuator.errors import BadInput
from tactuator.paper.plan import paper_display
from tactuator.rig.open import RIGS, open_rig
from tests.rig.own_rig import installed_example

DISPLAY = paper_display()


def test_open_rig__example_installed__is_found_by_its_name() -> None:
    with installed_example() as name:
        assert type(open_rig(name, DISPLAY)).__name__ == "ComputedRig"
        with pytest.raises(BadInput, match=f"allowed: board, emulated, in-process, {name}, simulated, sound"):
            open_rig("toaster", DISPLAY)


def test_open_rig__own_rig_that_is_none__is_refused(install) -> None:
    install(RIGS, "own", "def opened(rest, display, seed):\n    return 3\n", "opened")
    with pytest.raises(BadInput, match=r"rig 'own:x' is a int; allowed: what has all that tactuator"):
        open_rig("own:x", DISPLAY)
