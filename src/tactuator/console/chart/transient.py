"""Steps in time of many closed loops at once: a step of what is asked, and a push of what touches the display.

The loop is a cascade of second-order sections in state space, r -> (+) -> C -> (+ d) -> P -> y, closed without any
polynomial of the whole. The rows c A^k at every instant are made by doubling, so that hundreds of instants of dozens
of loops are a few matrix products.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.signals.systems import SampledSystem

_BEYOND = 1e6


@dataclass(frozen=True)
class States:
    """One system in state space, sampled: x' = a x + b u, y = c x + d u; shapes (n, n), (n,), (n,)."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: float


@dataclass(frozen=True)
class Steps:
    """Answers of closed loops, (loops, instants): `asked`, to a step of one volt at the loop's input; `pushed`, to one
    volt added to the command. stable: whether each loop's own poles lie inside the unit circle, (loops,)."""

    asked: FloatArray
    pushed: FloatArray
    stable: FloatArray


def states_of(system: SampledSystem) -> States:
    """Return the states of a system: its sections one behind the other, then its delay."""
    made = States(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0)
    for b0, b1, b2, a0, a1, a2 in system.sections() / 1.0:
        section = States(
            np.array([[-a1, 1.0], [-a2, 0.0]]) / np.array([[a0, 1.0], [a0, 1.0]]),
            np.array([b1 - a1 * b0 / a0, b2 - a2 * b0 / a0]) / a0,
            np.array([1.0, 0.0]),
            b0 / a0,
        )
        made = _behind(made, section)
    for _ in range(system.delay_samples):
        made = _behind(made, States(np.zeros((1, 1)), np.ones(1), np.ones(1), 0.0))
    return made


def padded(plants: Sequence[States]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return systems stacked, (loops, n, n), (loops, n), (loops, n), (loops,): smaller ones get states that rest."""
    order = max(one.b.size for one in plants)
    a, b, c = np.zeros((len(plants), order, order)), np.zeros((len(plants), order)), np.zeros((len(plants), order))
    for place, one in enumerate(plants):
        own = one.b.size
        a[place, :own, :own], b[place, :own], c[place, :own] = one.a, one.b, one.c
    return a, b, c, np.array([one.d for one in plants])


def steps(
    controller: States, plants: tuple[FloatArray, FloatArray, FloatArray, FloatArray], stride: int, instants: int
) -> Steps:
    """Return the steps of one controller around many plants, at every `stride`-th sample from 0 on."""
    ap, bp, cp, dp = plants
    loops, own, other = len(dp), controller.b.size, ap.shape[1]
    through = 1.0 / (1.0 + controller.d * dp)
    # u = by_controller xc + by_plant xp + by_input (r, d), the loop closed
    by_controller = controller.c[None] * through[:, None]
    by_plant = -controller.d * cp * through[:, None]
    by_input = np.stack([controller.d * through, through], axis=1)
    order = own + other
    a, b = np.zeros((loops, order, order)), np.zeros((loops, order, 2))
    bc = controller.b
    a[:, :own, :own] = controller.a - bc[:, None] * (dp[:, None] * by_controller)[:, None, :]
    a[:, :own, own:] = -bc[:, None] * (cp + dp[:, None] * by_plant)[:, None, :]
    a[:, own:, :own] = bp[:, :, None] * by_controller[:, None, :]
    a[:, own:, own:] = ap + bp[:, :, None] * by_plant[:, None, :]
    b[:, :own] = bc[:, None] * (np.array([1.0, 0.0]) - dp[:, None] * by_input)[:, None, :]
    b[:, own:] = bp[:, :, None] * by_input[:, None, :]
    rows = np.concatenate([dp[:, None] * by_controller, cp + dp[:, None] * by_plant], axis=1)
    with np.errstate(all="ignore"):
        asked, pushed = _outputs(a, b, rows, dp[:, None] * by_input, stride, instants)
    stable = np.max(np.abs(np.linalg.eigvals(a)), axis=1) < 1.0
    return Steps(_bounded(asked), _bounded(pushed), stable)


def _outputs(
    a: FloatArray, b: FloatArray, rows: FloatArray, direct: FloatArray, stride: int, instants: int
) -> tuple[FloatArray, FloatArray]:
    """Return y for a constant input of one, for each of both inputs: their values are states that never change."""
    loops, order, _ = b.shape
    whole = np.zeros((loops, order + 2, order + 2))
    whole[:, :order, :order], whole[:, :order, order:] = a, b
    whole[:, order:, order:] = np.eye(2)
    found = np.concatenate([rows, direct], axis=1)[:, None, :]
    power = np.linalg.matrix_power(whole, stride)
    while found.shape[1] < instants:
        found = np.concatenate([found, found @ power], axis=1)
        power = power @ power
    return found[:, :instants, order], found[:, :instants, order + 1]


def _behind(first: States, second: States) -> States:
    """Return two systems one behind the other."""
    a = np.block(
        [
            [first.a, np.zeros((first.b.size, second.b.size))],
            [np.outer(second.b, first.c), second.a],
        ]
    )
    return States(
        a,
        np.append(first.b, second.b * first.d),
        np.append(second.d * first.c, second.c),
        second.d * first.d,
    )


def _bounded(values: FloatArray) -> FloatArray:
    return np.clip(np.nan_to_num(values, nan=0.0, posinf=_BEYOND, neginf=-_BEYOND), -_BEYOND, _BEYOND)
