"""How a verb is told which rig to use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

from tactuator.digital.controller import Controller
from tactuator.rig.open import open_rig
from tactuator.rig.protocol import Rig

RigOption = Annotated[str, typer.Option("--rig", help="simulated, emulated:BOARD, board:URL.")]


@contextmanager
def opened_rig(name: str, controller: Controller, seed: int) -> Iterator[Rig]:
    """The rig of that name for the controller's display, open for the length of the context; BadInput if unknown."""
    rig = open_rig(name, controller.display, seed)
    try:
        yield rig
    finally:
        close = getattr(rig, "close", None)
        if close is not None:
            close()
