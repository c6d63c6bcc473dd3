"""A board reshapes references as the host does, bit for bit, and only where the image says so."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from tactuator.model.controller import Controller
from tactuator.rig.open import emulated_rig, in_process_rig
from tactuator.rig.rig import Rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.runtime.image import FORMATS
from tests.runtime.paper_display import RATE_HZ, controller, display
from tests.strength import core, reshaped

PLAIN = controller(display())


@cache
def shaped() -> Controller:
    return reshaped(PLAIN)


def wave(samples: int = 3000) -> np.ndarray:
    rng = np.random.default_rng(2)
    level = np.repeat(rng.uniform(0.0, 40.0, samples // 100), 100)
    return 10.0 ** (level[:, None] / 20.0) * np.sin(
        2.0 * np.pi * np.outer(np.arange(samples), [20.0, 90.0, 250.0]) / RATE_HZ
    )


def by_hand(reference: np.ndarray) -> np.ndarray:
    steps = [core(channel.strength, RATE_HZ)[0] for channel in shaped().channels]
    return np.array([[step(r) for step, r in zip(steps, row, strict=True)] for row in reference])


def played(rig: Rig, of: Controller, *references: np.ndarray) -> bytes:
    with rig:
        rig.load(of)
        traces = [rig.play(reference) for reference in references]
    return b"".join(
        np.concatenate([getattr(trace, name) for trace in traces]).tobytes() for name in ("command_v", "position_v")
    )


RIGS = {"simulated": lambda: SimulatedRig(PLAIN.display, seed=5)} | {
    name: lambda name=name: in_process_rig(PLAIN.display, 5, name) for name in FORMATS
}


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_rig__that_reshapes__plays_what_the_reshaped_reference_would_play_however_cut(rig: Callable[[], Rig]) -> None:
    there = played(rig(), shaped(), *np.split(wave(), [7, 1000, 1001]))
    assert there == played(rig(), PLAIN, by_hand(wave()))
    assert there != played(rig(), PLAIN, wave())


def test_board__driven__is_not_reshaped() -> None:
    traces = []
    for of in (shaped(), PLAIN):
        with in_process_rig(of.display, 5) as rig:
            rig.load(of)
            traces.append(rig.drive(0.1 * np.sin(np.arange(400.0))[:, None] * np.ones(3)))
    assert np.array_equal(traces[0].position_v, traces[1].position_v)


@pytest.mark.parametrize(
    ("board", "number_format"),
    [("mps2-an500", "float32"), pytest.param("stm32f405", "q31", marks=pytest.mark.slow)],
)
def test_emulated_board__that_reshapes__plays_the_hosts_bits(board: str, number_format: str) -> None:
    there = played(emulated_rig(board, shaped().display, 5, number_format), shaped(), wave(500))
    assert there == played(in_process_rig(shaped().display, 5, number_format), shaped(), wave(500))
