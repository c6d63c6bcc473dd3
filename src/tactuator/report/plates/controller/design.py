"""The figures of a design: for every channel Nichols, Bode, sensitivity, headroom and the equality of figure 2."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactuator.measure.finger.landing import landing
from tactuator.model.controller import Controller
from tactuator.report.plate import Plate, save_plates
from tactuator.report.plates.controller.bode import bode_plate
from tactuator.report.plates.controller.headroom import headroom_plate, lowest
from tactuator.report.plates.controller.landing import landing_plate
from tactuator.report.plates.controller.nichols import NicholsInput, nichols_plate
from tactuator.report.plates.controller.sensitivity import sensitivity_plate
from tactuator.report.plates.felt.equality import equality_plate
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.synthesis.design import headroom_grid_hz
from tactuator.synthesis.family import UNLOADED, plant_family
from tactuator.synthesis.headroom import headroom
from tactuator.synthesis.touch import fed_response


def design_plates(controller: Controller, channel_name: str) -> tuple[Plate, ...]:
    """Return the figures of one channel, each named KIND-CHANNEL; of an adaptive one, how a finger lands as well."""
    display = controller.display
    channel, own = display.channel(channel_name), controller.channel(channel_name)
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    prefilter, feedback = own.prefilter(display.rate_hz), own.feedback(display.rate_hz)
    loops = {one.name: TwoDegreeLoop(prefilter, feedback, one.sampled) for one in family}
    closed = {name: loop.feedback for name, loop in loops.items() if loop.feedback is not None}
    low, high = channel.threshold.band_hz
    wide = (low / 2.0, min(2.0 * high, 0.45 * display.rate_hz))
    plates = []
    if feedback is not None:
        nominal = closed[UNLOADED]
        others = [loop for name, loop in closed.items() if name != UNLOADED]
        shown = NicholsInput(nominal, channel.plant, None, others, wide)
        plates.append(nichols_plate(shown, f"nichols-{channel_name}", f"Nichols chart, {channel_name}"))
        systems = {"P": family[0].sampled, "C": feedback, "C P": nominal.open_loop, "F": prefilter}
        plates.append(bode_plate(systems, wide, f"bode-{channel_name}", f"Bode diagram, {channel_name}"))
        limits = channel.feedback
        title = f"Sensitivity, {channel_name}"
        plates.append(sensitivity_plate(closed, limits, wide, f"sensitivity-{channel_name}", title))
    else:
        open_systems = {"P": family[0].sampled, "F": prefilter}
        plates.append(bode_plate(open_systems, wide, f"bode-{channel_name}", f"Bode diagram, {channel_name}"))
    grid = headroom_grid_hz(channel)
    comfort = display.objectives.comfort_db_sl
    rooms = {}
    for one in family:
        loop = loops[one.name]
        answer = fed_response(own.feed_forward, channel, loops[UNLOADED], loop, one.load, grid, display.rate_hz)
        rooms[one.name] = headroom(channel, loop, grid, comfort, answer)
    plates.append(headroom_plate(lowest(rooms), f"headroom-{channel_name}", f"Headroom, {channel_name}"))
    fine = np.geomspace(low, high, 400)
    response = loops[UNLOADED].position_response(fine)
    title = f"Response + sensitivity = constant, {channel_name}"
    plates.append(equality_plate(channel, fine, response, name=f"equality-{channel_name}", title=title))
    if own.feed_forward is not None:
        shown_landing = landing(controller, channel_name)
        plates.append(landing_plate(shown_landing, f"landing-{channel_name}", f"A finger lands, {channel_name}"))
    return tuple(plates)


def save_design_plates(controller: Controller, folder: Path) -> None:
    """Write every channel's figures (SVG, with their numbers as CSV) into `folder`, whole or not at all.

    Raises BadInput for a folder that holds anything else.
    """
    save_plates([plate for one in controller.channels for plate in design_plates(controller, one.name)], folder)
