"""An adaptive controller on a board gives, bit for bit, what the simulated rig gives; its guard allows less."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.display.controller import Controller
from tactuator.display.description import Display
from tactuator.display.touch import Touch
from tactuator.rig.board.commissioning import ADAPTIVE_DB, safety_table
from tactuator.rig.board_rigs import in_process_rig
from tactuator.signals.decibels import db
from tests.runtime.paper_display import channel, display
from tests.runtime.test_touch import SECOND, adaptive, tones


def adaptive_display() -> Display:
    return replace(display(channel()), touch=Touch(adaptive=True))


def played(number_format: str, is_adaptive: bool = True) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    own = adaptive() if is_adaptive else replace(adaptive(), feed_forward=None)
    rig = in_process_rig(adaptive_display(), 5, number_format)
    try:
        rig.load(Controller(adaptive_display(), (own,)))
        rig.finger("index").touch("finger")
        trace = rig.play(tones(2 * SECOND)[:, None])
    finally:
        rig.close()
    return np.hstack([trace.command_v, trace.position_v])


def test_board__adaptive_in_both_formats__learns_alike() -> None:
    single, q31, fixed = played("float32"), played("q31"), played("float32", is_adaptive=False)
    last = slice(-SECOND, None)
    apart = np.std(single[last, 0] - q31[last, 0])
    assert apart < 0.02 * np.std(single[last, 0] - fixed[last, 0]) + 1e-3
    assert np.std(single[last, 0] - fixed[last, 0]) > 0.05


def test_safety_table__adaptive_display__limits_the_reference_further() -> None:
    limits = [safety_table(own).channels[0].reference_max for own in (display(channel()), adaptive_display())]
    assert db(np.array(limits[0] / limits[1])) == pytest.approx(ADAPTIVE_DB)
