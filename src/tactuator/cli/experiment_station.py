"""The station that experiment commands use: a rig with a controller loaded."""

from __future__ import annotations

from pathlib import Path

from tactuator.errors import BadInput
from tactuator.experiment.conduct import Station
from tactuator.files.controller import read_controller
from tactuator.rig.protocol import Rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.study.controllers import paper_controller
from tactuator.study.plan import paper_display
from tactuator.web.paced import PacedRig


def station(rig: str, controller: Path | None, seed: int, speed: float | None) -> Station:
    """rig: `simulated`. Without a controller file: the paper's display and C. speed: of presentation, None: at once."""
    if rig != "simulated":
        raise BadInput(f"rig {rig!r}; allowed: simulated")
    if speed is not None and not speed > 0.0:
        raise BadInput(f"speed {speed:g}; allowed: a positive number, 1 being real time")
    loaded = paper_controller(paper_display()) if controller is None else read_controller(controller)
    simulated = SimulatedRig(loaded.display, seed)
    simulated.load(loaded)
    played: Rig = simulated if speed is None else PacedRig(simulated, speed)
    return Station(played, loaded, rig)
