"""The program, with a simulated exciter on a card that is turned by hand in place of a sound card."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import tactuator.rig.open
from tactuator.cli import main
from tests.measure.open_loop.exciters import drawn_exciter, exciter_rig


@contextmanager
def turned(name: str, display: Any, seed: int = 0) -> Iterator[Any]:
    assert name == "sound:turned"
    yield exciter_rig([drawn_exciter(3)])


vars(tactuator.rig.open)["open_rig"] = turned
sys.exit(main(sys.argv[1:]))
