"""The station that experiment commands use: a rig with a controller loaded."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tactuator.cli.rigs import opened_rig
from tactuator.digital.controller import Controller
from tactuator.errors import BadInput
from tactuator.experiment.station import Station
from tactuator.files.controller import read_controller
from tactuator.rig.protocol import Rig
from tactuator.study.controllers import paper_controller
from tactuator.study.plan import paper_display
from tactuator.web.paced import PacedRig


@contextmanager
def opened_station(rig: str, controller: Path | None, seed: int, speed: float | None) -> Iterator[Station]:
    """The rig of that name with a controller loaded, for the length of the context; left at rest.

    Without a controller file: the paper's display and C. speed: of presentation on a rig that could go faster, None: as
    fast as it can. Raises BadInput for a speed that is none, and as `opened_rig` does.
    """
    if speed is not None and not speed > 0.0:
        raise BadInput(f"speed {speed:g}; allowed: a positive number, 1 being real time")
    loaded = _loaded(controller)
    with opened_rig(rig, loaded, seed) as opened:
        opened.load(loaded)
        played: Rig = opened if speed is None else PacedRig(opened, speed)
        yield Station(played, loaded, rig)


def _loaded(controller: Path | None) -> Controller:
    return paper_controller(paper_display()) if controller is None else read_controller(controller)
