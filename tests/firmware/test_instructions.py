"""What a step of the interrupt takes, in instructions of an emulated Cortex-M4F, with its supervisor."""

import numpy as np
import pytest

from tactuator.errors import DeviceFault
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.board.stream import TONES_MAX, BoardTone
from tests.firmware.emulator import MACHINES, emulated_rig
from tests.rig.every_rig import tones
from tests.rig.guard.guarded import adaptive, designed

BOARD = "mps2-an386"
INSTRUCTION_NS = 32
COUNTS = 1e-9 * INSTRUCTION_NS * MACHINES[BOARD].board.clock_hz


def instructions(rig: BoardRig) -> float:
    """The most of any step since a finger was touched, or the run began."""
    return rig.status().cycles / COUNTS


def counted(controller) -> dict[str, float]:
    rows, kinds = tones(700)[100:], {}  # of which none is zero: silence takes more
    with emulated_rig(BOARD, controller.display, 0, f"shift={INSTRUCTION_NS.bit_length() - 1},sleep=off") as rig:
        rig.load(controller)
        for name, played in (("usual", rows), ("silent", 0.0 * rows), ("limited", 1000.0 * np.sign(rows))):
            rig.play(played[:10])  # the soft start is over, and what comes after silence
            rig.finger("index").touch(None)
            rig.play(played[10:])
            kinds[name] = instructions(rig)
            rig.rest()
        eight = [BoardTone(180.0 + 23.0 * n, 150.0, 0.0, 0.2, 0.1) for n in range(TONES_MAX)]
        rig.play_tones(dict.fromkeys(rig.channels, eight), 0.2)
        kinds["on-board tones"] = instructions(rig)
        rig.play(rows[:50])
        for channel in rig.channels:
            rig.break_sensor(channel, "open")
        with pytest.raises(DeviceFault):
            rig.play(rows)
        kinds["faults"] = instructions(rig)
    return kinds


@pytest.mark.parametrize(("controller", "usual", "most"), [(designed, 1200, 3000), (adaptive, 2000, 3800)])
def test_step__usual_and_worst__keep_what_they_may_take(controller, usual: int, most: int) -> None:
    taken = counted(controller())
    assert 500 < taken["usual"] <= usual
    assert max(taken.values()) <= most
