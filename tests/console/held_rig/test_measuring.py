"""What a page is told of a measurement, in numbers that it can read."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tactuator.console.held_rig.measuring import measured, points_of
from tactuator.console.held_rig.orders import MeasureOrder
from tactuator.errors import BadInput
from tactuator.rig.simulated import SimulatedRig


def order_of(controller, level_db_sl: float) -> MeasureOrder:
    return MeasureOrder(controller, ("index",), (100.0,), level_db_sl, "none", 1.0, 0.5, 0.0, (0.4, 300.0))


def loaded(controller) -> SimulatedRig:
    rig = SimulatedRig(controller.display, 3)
    rig.load(controller)
    return rig


def test_points__of_a_sensor_that_stands_still__have_no_level(controller, tmp_path) -> None:
    order = order_of(controller, 30.0)
    (found,) = measured(loaded(controller), order, lambda _: None)
    still = replace(found, amplitude_v=np.zeros(1, dtype=complex))
    shown = points_of((still,), order, tmp_path, over=True).document
    assert json.loads(json.dumps(shown, allow_nan=False))["responses"][0]["level_db_sl"] == [None]


def test_measured__level_of_nothing__refused(controller) -> None:
    """Its amplitude is zero in double precision, and a page was sent Infinity."""
    with pytest.raises(BadInput, match="-60 to 55 dB SL"):
        measured(loaded(controller), order_of(controller, -(2.0**63)), lambda _: None)
