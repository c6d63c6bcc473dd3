"""An adaptive controller on a board gives, bit for bit, what the simulated rig gives; its guard allows less."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.measure.adaptive import settle_weights
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.requirements import Touch
from tactuator.rig.board.commissioning import ADAPTIVE_DB, safety_table
from tactuator.rig.open import in_process_rig, simulated_board_rig
from tactuator.rig.transport import InProcess
from tactuator.runtime._core import ffi
from tactuator.runtime.image import FORMATS
from tactuator.signals.decibels import db
from tests.rig.guard import guarded
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


def landed(short_way: bool) -> bytes:
    """All that comes of runs in which a finger lands and is lifted, a command is limited, and silence ends them."""
    controller, transport = guarded.adaptive(), InProcess()
    rig = simulated_board_rig(transport, controller.display, 5, "float32")
    rig.load(controller)
    assert transport.board.is_adaptive
    transport.board.is_adaptive = int(short_way)
    parts = []
    for load, level in (("finger", 1.0), (None, 6.0), ("finger", 0.0)):
        rig.finger("index").touch(load)
        trace = rig.play(level * np.repeat(tones(SECOND // 4)[:, None], 3, axis=1))
        parts.append(trace.command_v.tobytes() + trace.position_v.tobytes())
        parts += [bytes(ffi.buffer(ffi.addressof(transport.board.channel[c], "touch_state"))) for c in range(3)]
    assert transport.board.runs_adaptive == int(short_way)
    rig.close()
    return b"".join(parts)


def test_board__short_way_and_general_way__same_bits() -> None:
    assert landed(short_way=True) == landed(short_way=False)


@pytest.mark.parametrize("number_format", FORMATS)
def test_board__asked_for_its_weights__tells_what_it_has_learnt(number_format: str) -> None:
    transport = InProcess()
    rig = simulated_board_rig(transport, adaptive_display(), 5, number_format)
    own = Controller(adaptive_display(), (adaptive(),))
    assert np.array_equal(rig.weights(), np.zeros((1, 2)))
    rig.load(own)
    rig.finger("index").touch("finger")
    (learnt,) = settle_weights(rig, own, 30.0, np.random.default_rng(1))
    np.testing.assert_allclose(learnt.weight, [1.0, 1.0], atol=0.15)
    assert learnt.settled_s <= 0.3
    assert np.array_equal(rig.weights()[0], list(transport.board.channel[0].touch_state.weight))
    rig.load(Controller(adaptive_display(), (replace(adaptive(), feed_forward=None),)))
    assert np.array_equal(rig.weights(), np.zeros((1, 2)))
    rig.close()


def test_board__adaptive_in_both_formats__learns_alike() -> None:
    single, q31, fixed = played("float32"), played("q31"), played("float32", is_adaptive=False)
    last = slice(-SECOND, None)
    apart = np.std(single[last, 0] - q31[last, 0])
    assert apart < 0.02 * np.std(single[last, 0] - fixed[last, 0]) + 1e-3
    assert np.std(single[last, 0] - fixed[last, 0]) > 0.05


def test_safety_table__adaptive_display__limits_the_reference_further() -> None:
    limits = [safety_table(own).channels[0].reference_max for own in (display(channel()), adaptive_display())]
    assert db(np.array(limits[0] / limits[1])) == pytest.approx(ADAPTIVE_DB)
