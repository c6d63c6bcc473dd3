"""The apparatus that experiment commands use: a rig with a controller loaded."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tactuator.cli.chosen import chosen_controller
from tactuator.errors import BadInput
from tactuator.experiment.session.task import Apparatus
from tactuator.paper.controllers import paper_controller
from tactuator.paper.plan import paper_display
from tactuator.rig.open import open_rig
from tactuator.rig.paced import PacedRig
from tactuator.rig.rig import Rig


@contextmanager
def opened_apparatus(
    rig: str, display: Path | None, controller: Path | None, seed: int, speed: float | None
) -> Iterator[Apparatus]:
    """Yield the rig of that name with a controller loaded, open for the length of the context and left at rest.

    Without a display or controller file: the paper's display and C. speed: of presentation on a rig that could go
    faster, None: as fast as it can. Raises BadInput for a speed that is none, and as `chosen_controller` and
    `open_rig` do.
    """
    if speed is not None and not speed > 0.0:
        raise BadInput(f"speed {speed:g}", "a positive number, 1 being real time")
    paper = display is None and controller is None
    loaded = paper_controller(paper_display()) if paper else chosen_controller(display, controller)
    with open_rig(rig, loaded.display, seed) as opened:
        opened.load(loaded)
        played: Rig = opened if speed is None else PacedRig(opened, speed)
        yield Apparatus(played, loaded, rig)
