"""Starts of the local search, and the bounds that it stays within."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from tactuator.arrays import FloatArray
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.family import Member
from tactuator.synthesis.loop.candidates import slow_pair
from tactuator.synthesis.loop.problem import LoopProblem
from tactuator.synthesis.loop.structure import COUNT, FREQUENCIES, POLE_DAMPINGS, ZERO_DAMPINGS

_SLOWEST_ZEROS_HZ = 1.0
_ZERO_DAMPING = (0.7, 4.0)
_POLE_DAMPING = (0.9, 2.0)
_STARTS = ((1.0, 1.0), (3.0, 1.0), (1.5, 0.5), (2.0, 0.35), (2.0, 2.0))
"""(crossover over the rejection band's upper edge, corner of the lead over the crossover)."""


def bounds(problem: LoopProblem, plant: ContinuousSystem) -> optimize.Bounds:
    """Return bounds on the parameters, the aim and the excess, shape (COUNT + 2,).

    Zeros of the integrator's section lie from 1 Hz, everything else from the rejection band's upper edge, up to just
    below half the rate; zeros are damped by 0.7 or more, poles by 0.9: nothing in the controller rings, and T stays
    smooth enough for a prefilter of few poles. Zeros may be as soft as the plant's own resonances, to cancel them.
    """
    to_radians = 2.0 * np.pi / problem.structure.rate_hz
    low, high = np.full(COUNT + 2, -np.inf), np.full(COUNT + 2, np.inf)
    fast = [*FREQUENCIES, 3]
    low[fast] = np.log(to_radians * problem.requirements.rejection_band_hz[1])
    low[1] = np.log(to_radians * _SLOWEST_ZEROS_HZ)
    high[fast] = np.log(2.0 * np.pi * 0.45)
    softest = min(_ZERO_DAMPING[0], 0.6 * max(_resonance(plant)[1], 1e-3))
    low[list(ZERO_DAMPINGS)], high[list(ZERO_DAMPINGS)] = np.log(softest), np.log(_ZERO_DAMPING[1])
    low[list(POLE_DAMPINGS)], high[list(POLE_DAMPINGS)] = np.log(_POLE_DAMPING[0]), np.log(_POLE_DAMPING[1])
    low[COUNT + 1] = 0.0
    return optimize.Bounds(low, high)


def _resonance(plant: ContinuousSystem) -> tuple[float, float]:
    """Return the natural frequency (rad/s) and damping of the plant's softest pole pair; (0, 1) if it has none."""
    pairs = plant.poles[plant.poles.imag > 0.0]
    if pairs.size == 0:
        return 0.0, 1.0
    damping = -pairs.real / np.abs(pairs)
    softest = int(np.argmin(damping))
    return float(np.abs(pairs[softest])), float(damping[softest])


def classical_starts(problem: LoopProblem, nominal: Member, rate_hz: float) -> list[FloatArray]:
    """Return starts with zeros on the plant's two slowest poles, the notch on its resonance, and several crossovers."""
    own, damping = slow_pair(nominal.continuous)
    resonance, softness = _resonance(nominal.continuous)
    upper = problem.requirements.rejection_band_hz[1]
    found = []
    for times, corner in _STARTS:
        crossover = min(times * upper, 0.05 * rate_hz)
        omega = 2.0 * np.pi * crossover / rate_hz
        lead = 2.0 * omega * corner
        notch, depth = (resonance / rate_hz, max(softness, 1e-3)) if resonance > 1.5 * own else (4.0 * omega, 0.8)
        values = [1.0, own / rate_hz, damping, 2.0 * omega, lead, 1.0, 2.0 * lead, 1.0, notch, depth, notch, 1.0]
        parameters = np.log(values)
        unit = problem.structure.system(parameters).response(crossover) * nominal.sampled.response(crossover)
        parameters[0] -= np.log(np.abs(unit))
        found.append(parameters)
    return found
