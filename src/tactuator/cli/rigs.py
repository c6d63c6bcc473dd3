"""How a verb is told which rig to use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

from tactuator.digital.controller import Controller
from tactuator.errors import BadInput
from tactuator.rig.protocol import Rig
from tactuator.rig.simulated import SimulatedRig

RIGS = ("simulated",)

RigOption = Annotated[str, typer.Option("--rig", help=f"Rig to use: {', '.join(RIGS)}.")]


@contextmanager
def opened_rig(name: str, controller: Controller, seed: int) -> Iterator[Rig]:
    """The rig of that name for the controller's display, open for the length of the context; BadInput if unknown."""
    if name not in RIGS:
        raise BadInput(f"rig {name!r}; allowed: {', '.join(RIGS)}")
    yield SimulatedRig(controller.display, seed)
