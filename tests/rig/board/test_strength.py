"""A board reshapes references as the host does, bit for bit, and only where the image says so."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.model.controller import Controller
from tactuator.rig.open import emulated_rig, in_process_rig, simulated_board_rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import InProcess
from tactuator.runtime.image import FORMATS, ImageRefusal, build_image, check_image
from tests.runtime.paper_display import RATE_HZ, controller, display
from tests.strength import core, reshaped

PLAIN = controller(display())
SHAPED = reshaped(PLAIN)
EMULATED = ("mps2-an386", "mps2-an500", "stm32f405")


def wave(samples: int = 3000) -> np.ndarray:
    rng = np.random.default_rng(2)
    level = np.repeat(rng.uniform(0.0, 40.0, samples // 100), 100)
    return 10.0 ** (level[:, None] / 20.0) * np.sin(
        2.0 * np.pi * np.outer(np.arange(samples), [20.0, 90.0, 250.0]) / RATE_HZ
    )


def by_hand(reference: np.ndarray) -> np.ndarray:
    steps = [core(channel.strength, RATE_HZ)[0] for channel in SHAPED.channels]
    return np.array([[step(r) for step, r in zip(steps, row, strict=True)] for row in reference])


def played(rig, of: Controller, reference: np.ndarray) -> bytes:
    try:
        rig.load(of)
        trace = rig.play(reference)
        return trace.command_v.tobytes() + trace.position_v.tobytes()
    finally:
        rig.close()


@pytest.mark.parametrize("number_format", FORMATS)
def test_board__that_reshapes__plays_what_the_reshaped_reference_would_play(number_format: str) -> None:
    there = played(in_process_rig(SHAPED.display, 5, number_format), SHAPED, wave())
    assert there == played(in_process_rig(PLAIN.display, 5, number_format), PLAIN, by_hand(wave()))
    assert there != played(in_process_rig(PLAIN.display, 5, number_format), PLAIN, wave())


@pytest.mark.parametrize(
    ("board", "number_format"),
    [("mps2-an500", "float32"), *(pytest.param(board, "q31", marks=pytest.mark.slow) for board in EMULATED)],
)
def test_emulated_board__that_reshapes__plays_the_hosts_bits(board: str, number_format: str) -> None:
    there = played(emulated_rig(board, SHAPED.display, 5, number_format), SHAPED, wave(1200))
    assert there == played(in_process_rig(SHAPED.display, 5, number_format), SHAPED, wave(1200))


def test_simulated_rig__that_reshapes__plays_what_the_reshaped_reference_would_play() -> None:
    there = played(SimulatedRig(SHAPED.display, seed=5), SHAPED, wave())
    assert there == played(SimulatedRig(PLAIN.display, seed=5), PLAIN, by_hand(wave()))


def test_board__a_stream_in_pieces_and_a_second_run__is_reshaped_alike() -> None:
    whole = played(in_process_rig(SHAPED.display, 5), SHAPED, wave())
    rig = in_process_rig(SHAPED.display, 5)
    rig.load(SHAPED)
    parts = [rig.play(part) for part in np.split(wave(), [7, 1000, 1001])]
    rig.close()
    joined = [np.concatenate([getattr(part, name) for part in parts]).tobytes() for name in ("command_v", "position_v")]
    assert b"".join(joined) == whole


def test_board__driven__is_not_reshaped() -> None:
    traces = []
    for of in (SHAPED, PLAIN):
        rig = simulated_board_rig(InProcess(), of.display, 5, "float32")
        rig.load(of)
        traces.append(rig.drive(0.1 * np.sin(np.arange(400.0))[:, None] * np.ones(3)).position_v.tobytes())
        rig.close()
    assert traces[0] == traces[1]


@pytest.mark.parametrize("number_format", FORMATS)
def test_image__that_reshapes__is_taken_whole_and_refused_in_pieces(number_format: str) -> None:
    image, bare = build_image(SHAPED, number_format), build_image(PLAIN, number_format)
    assert check_image(image, RATE_HZ, 1, 3) is ImageRefusal.GOOD
    assert len(image) - len(bare) == 3 * 4 * (2 + 4 + 21 * 9)
    spoilt = replace(SHAPED.channels[0].strength, damping=1e6)
    with pytest.raises(Exception, match="coefficient is not a number or out of range"):
        build_image(reshaped(PLAIN, spoilt), number_format)
