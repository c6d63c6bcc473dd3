"""Candidate loops: a fixed, ordered set that depends on the plant and the rate alone, never on what is asked.

A search that only ever asks "which of these keeps every limit?" cannot turn a yes into a no when a limit is relaxed:
whatever kept the tighter limits is in the set again, and keeps the looser ones.

A candidate is a parameter vector of `LoopStructure` and a gain. Shapes are built from the plant's own roots: an
integrator alone, with one zero (PI), with two (PID); each with and without a lead or a roll-off, and a notch on each
lightly damped mode. Later blocks fill the parameters' space evenly (Sobol), or with finer grids. Gains put the
crossover of the nominal plant on a grid of 48 frequencies.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.stats import qmc

from tactuator.arrays import FloatArray
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.loop.structure import COUNT

LIGHT_DAMPING = 0.5
"""A pole pair of less damping counts as a mode, which a notch may stand on."""
_CROSSOVERS = 48
_LOWEST_CROSSOVER_HZ, _HIGHEST_CROSSOVER = 0.2, 0.06
_FAR = 2.0 * np.pi * 0.45
_OFF = (0.9 * _FAR, 1.0, 0.9 * _FAR, 1.0)
"""A pair that cancels: numerator's frequency and damping, then the denominator's."""
_MODES_MAX = 3
_SOBOL_LOG2 = (12, 14)


def modes(plant: ContinuousSystem) -> list[tuple[float, float]]:
    """Return (natural frequency in rad/s, damping) of the plant's lightly damped pole pairs, the slowest first."""
    pairs = plant.poles[plant.poles.imag > 0.0]
    found = [(float(abs(pole)), float(-pole.real / abs(pole))) for pole in pairs]
    return sorted(pair for pair in found if pair[1] < LIGHT_DAMPING)[:_MODES_MAX]


def crossovers_hz(rate_hz: float) -> FloatArray:
    """Return the frequencies at which a candidate's open loop is put to one, hertz, shape (48,)."""
    return np.geomspace(_LOWEST_CROSSOVER_HZ, _HIGHEST_CROSSOVER * rate_hz, _CROSSOVERS)


def shapes(plant: ContinuousSystem, rate_hz: float) -> Iterator[FloatArray]:
    """Yield blocks of shapes, each (n, COUNT) with a gain of one at index 0, the simplest first."""
    yield _simple(plant, rate_hz)
    yield _even(plant, rate_hz, 0)
    yield _structured(plant, rate_hz)
    yield _even(plant, rate_hz, 1)


def _simple(plant: ContinuousSystem, rate_hz: float) -> FloatArray:
    """Return integrator, PI and PID, each with and without a roll-off, and a notch on each mode."""
    fronts = [*_integrator_and_pi(rate_hz, 20), *_pid(plant, rate_hz, (1.0, 2.0), (None, 0.1))]
    seconds = [_OFF, *_roll_offs(rate_hz, 4), *_leads(rate_hz, 7, (5.0,))]
    return _combined(fronts, seconds, [_OFF, *_notches(plant, rate_hz, (1.0,), (1.0,))])


def _structured(plant: ContinuousSystem, rate_hz: float) -> FloatArray:
    """Return the same candidates with finer grids, detuned notches, and a second notch in place of the lead."""
    fronts = [*_integrator_and_pi(rate_hz, 24), *_pid(plant, rate_hz, (0.7, 1.0, 1.6), (None, 0.05, 0.2))]
    notches = _notches(plant, rate_hz, (0.92, 1.0, 1.08), (0.6, 1.0, 1.6))
    seconds = [_OFF, *_roll_offs(rate_hz, 6), *_leads(rate_hz, 6, (2.5, 6.0, 15.0))]
    if len(modes(plant)) > 1:
        seconds += _notches(plant, rate_hz, (1.0,), (1.0,))
    return _combined(fronts, seconds, [_OFF, *notches, *_hum_notches(rate_hz)])


Front = tuple[float, float, float]
Second = tuple[float, float, float, float]


def _combined(fronts: list[Front], seconds: list[Second], notches: list[Second]) -> FloatArray:
    rows = [(1.0, *front, *second, *notch) for front, second, notch in product(fronts, seconds, notches)]
    return np.asarray(np.log(np.array(rows)))


def _zeros(first: float, second: float) -> tuple[float, float]:
    """Return the natural frequency and damping of two real roots at `first` and `second` rad/sample."""
    own = float(np.sqrt(first * second))
    return own, max(1.0, (first + second) / (2.0 * own))


def _integrator_and_pi(rate_hz: float, count: int) -> list[Front]:
    """Return the fronts k/s and PI: the second zero cancels the single pole, or stands next to z = 0."""
    fast, slow = _FAR * (1.3 + np.sqrt(0.69)), _FAR * (1.3 - np.sqrt(0.69))
    corners = np.geomspace(1.0, 0.1 * rate_hz, count) * 2.0 * np.pi / rate_hz
    return [(*_zeros(fast, slow), slow), *((*_zeros(corner, _FAR), _FAR) for corner in corners.tolist())]


def _pid(
    plant: ContinuousSystem, rate_hz: float, scales: tuple[float, ...], poles: tuple[float | None, ...]
) -> list[Front]:
    """Return the PID fronts: two zeros near the plant's two slowest poles, or together; the pole far away or at a share
    of the rate (rad per sample).
    """
    own, damping = slow_pair(plant)
    pairs = [(own * scale / rate_hz, min(max(damping, 0.7) * more, 4.0)) for scale in scales for more in (0.7, 1.0)]
    step = 2.0 * np.pi / rate_hz
    pairs += [(corner * step, 1.0) for corner in np.geomspace(5.0, 0.02 * rate_hz, 2 + 2 * len(scales)).tolist()]
    return [
        (own, damping, _FAR if pole is None else pole) for (own, damping), pole in product(pairs, poles) if own < _FAR
    ]


def slow_pair(plant: ContinuousSystem) -> tuple[float, float]:
    """Return natural frequency (rad/s, at least 2 pi) and damping (0.01 to 3.9) of the plant's two slowest poles;
    10 Hz and 1 where it has fewer."""
    slow = plant.poles[np.argsort(np.abs(plant.poles), kind="stable")][:2]
    if slow.size < 2:
        return 2.0 * np.pi * 10.0, 1.0
    own = max(float(np.sqrt(np.abs(np.prod(slow)))), 2.0 * np.pi)
    return own, float(np.clip(np.abs(np.sum(slow).real) / 2.0 / own, 0.01, 3.9))


def _roll_offs(rate_hz: float, count: int) -> list[Second]:
    corners = np.geomspace(10.0, 0.2 * rate_hz, count) * 2.0 * np.pi / rate_hz
    return [(_FAR, 1.0, corner, 0.9) for corner in corners.tolist()]


def _leads(rate_hz: float, count: int, ratios: tuple[float, ...]) -> list[Second]:
    """Return the leads: one zero at a corner, one pole above it; the pair's other roots cancel near z = 0."""
    corners = np.geomspace(3.0, 0.1 * rate_hz, count) * 2.0 * np.pi / rate_hz
    return [
        (*_zeros(corner, _FAR), *_zeros(min(ratio * corner, _FAR), _FAR))
        for corner, ratio in product(corners.tolist(), ratios)
    ]


def _notches(
    plant: ContinuousSystem, rate_hz: float, detunings: tuple[float, ...], widths: tuple[float, ...]
) -> list[Second]:
    """Return a notch on each mode: zeros as soft as the mode or three times that, poles of damping 0.9."""
    return [
        (own / rate_hz * detuning, soft, own / rate_hz * detuning * width, 0.9)
        for own, damping in modes(plant)
        for detuning, width, soft in product(detunings, widths, (max(damping, 1e-3), max(3.0 * damping, 0.1)))
        if own / rate_hz * detuning * width < _FAR
    ]


def _hum_notches(rate_hz: float) -> list[Second]:
    corners = np.geomspace(30.0, 0.1 * rate_hz, 3) * 2.0 * np.pi / rate_hz
    return [(corner, 0.7, corner * width, 0.9) for corner, width in product(corners.tolist(), (0.7, 1.0))]


def _even(plant: ContinuousSystem, rate_hz: float, block: int) -> FloatArray:
    """Return Sobol points over all eleven parameters of a shape; the block's share of one sequence."""
    sequence = qmc.Sobol(COUNT - 1, scramble=False)
    skipped = 1 + sum(2**power for power in _SOBOL_LOG2[:block])
    sequence.fast_forward(skipped)
    share = sequence.random(2 ** _SOBOL_LOG2[block])
    own = slow_pair(plant)[0] / rate_hz
    step = 2.0 * np.pi / rate_hz
    soft = min([0.7, *(damping for _, damping in modes(plant))])
    top = 0.4 * rate_hz * step
    ranges = [
        (min(own * 0.5, 0.5 * top), min(own * 4.0, top)),
        (0.7, 4.0),
        (20.0 * step, top),
        (20.0 * step, 0.1 * rate_hz * step),
        (0.7, 2.0),
        (1.0, 8.0),
        (0.9, 1.5),
        (20.0 * step, 0.1 * rate_hz * step),
        (max(soft, 1e-3), 1.5),
        (0.5, 2.0),
        (0.9, 1.5),
    ]
    low, high = np.log(np.array(ranges)).T
    made = np.zeros((share.shape[0], COUNT))
    made[:, 1:] = low + (high - low) * share
    made[:, 6] += made[:, 4]
    made[:, 10] += made[:, 8]
    limit = np.log(_FAR)
    made[:, [1, 3, 4, 6, 8, 10]] = np.minimum(made[:, [1, 3, 4, 6, 8, 10]], limit)
    return made
