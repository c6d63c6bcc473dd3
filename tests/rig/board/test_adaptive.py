"""Adaptive and reshaping controllers on a board give, bit for bit, what the host gives; the guard allows less."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tactuator.measure.adaptive import settle_weights
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.requirements import Touch
from tactuator.rig.board.commissioning import ADAPTIVE_DB, safety_table
from tactuator.rig.open import in_process_rig
from tactuator.rig.rig import Rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import InProcess
from tactuator.signals.decibels import db
from tests.firmware.emulator import emulated_rig, rig_of
from tests.runtime.paper_display import RATE_HZ, channel, controller, display
from tests.runtime.test_touch import adaptive
from tests.strength import core, reshaped


def adaptive_display() -> Display:
    return replace(display(channel()), touch=Touch(adaptive=True))


def test_board__asked_for_its_weights__tells_what_it_has_learnt() -> None:
    transport = InProcess()
    rig = rig_of(transport, adaptive_display(), 5)
    own = Controller(adaptive_display(), (adaptive(),))
    assert np.array_equal(rig.weights(), np.zeros((1, 2)))
    rig.load(own)
    rig.finger("index").touch("finger")
    (learnt,) = settle_weights(rig, own, 30.0, np.random.default_rng(1))
    np.testing.assert_allclose(learnt.weight, [1.0, 1.0], atol=0.15)
    assert learnt.settled_s <= 0.3
    assert np.array_equal(rig.weights()[0], list(transport.board.channel[0].controller.touch.weight))
    rig.load(Controller(adaptive_display(), (replace(adaptive(), feed_forward=None),)))
    assert np.array_equal(rig.weights(), np.zeros((1, 2)))
    rig.close()


def test_safety_table__adaptive_display__limits_the_reference_further() -> None:
    limits = [safety_table(own).channels[0].reference_max for own in (display(channel()), adaptive_display())]
    assert db(np.array(limits[0] / limits[1])) == pytest.approx(ADAPTIVE_DB)


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


def heard_of(rig: Rig, of: Controller, *references: np.ndarray) -> bytes:
    with rig:
        rig.load(of)
        traces = [rig.play(reference) for reference in references]
    return b"".join(
        np.concatenate([getattr(trace, name) for trace in traces]).tobytes() for name in ("command_v", "position_v")
    )


RIGS = {
    "simulated": lambda: SimulatedRig(PLAIN.display, seed=5),
    "in-process": lambda: in_process_rig(PLAIN.display, 5),
}


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_rig__that_reshapes__plays_the_reshaped_reference_however_cut(rig: Callable[[], Rig]) -> None:
    there = heard_of(rig(), shaped(), *np.split(wave(), [7, 1000, 1001]))
    assert there == heard_of(rig(), PLAIN, by_hand(wave()))
    assert there != heard_of(rig(), PLAIN, wave())


def test_board__driven__is_not_reshaped() -> None:
    traces = []
    for of in (shaped(), PLAIN):
        with in_process_rig(of.display, 5) as rig:
            rig.load(of)
            traces.append(rig.drive(0.1 * np.sin(np.arange(400.0))[:, None] * np.ones(3)))
    assert np.array_equal(traces[0].position_v, traces[1].position_v)


@pytest.mark.parametrize("board", ["mps2-an500", pytest.param("stm32f405", marks=pytest.mark.slow)])
def test_emulated_board__that_reshapes__plays_the_hosts_bits(board: str) -> None:
    there = heard_of(emulated_rig(board, shaped().display, 5), shaped(), wave(500))
    assert there == heard_of(in_process_rig(shaped().display, 5), shaped(), wave(500))
