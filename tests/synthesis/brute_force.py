"""An oracle for loop synthesis that shares nothing with it: C = k/s, PI, and PI with lead and notch, tried one by one.

Plants are sampled by scipy, controllers by Tustin's rule; stability is told by the eigenvalues of the closed loop in
state space, every other figure by a dense grid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy import signal

from tactuator.model.requirements import FeedbackRequirements
from tactuator.signals.systems import ContinuousSystem

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Best:
    """The best controller of the grid: its kind, and its mean |S| over 0.4-10 Hz, dB."""

    kind: str
    mean_db: float


def best_simple_loop(
    plant: ContinuousSystem, rate_hz: float, delay_samples: int, asked: FeedbackRequirements, peak: float
) -> Best | None:
    """Return the best of the grid that keeps `asked` and a greatest |T| of `peak`, or None."""
    whole = delay_samples + round(plant.delay_s * rate_hz)
    held = signal.cont2discrete(_companion(plant), 1.0 / rate_hz, "zoh")[:4]
    grid = _grid_hz(plant, rate_hz)
    z = np.exp(2j * np.pi * grid / rate_hz)
    response = _response(held, z) * z ** (-float(whole))
    best: Best | None = None
    for kind, numerator, denominator in _controllers(plant, rate_hz):
        shape = np.polyval(numerator, (z - 1) / (z + 1)) / np.polyval(denominator, (z - 1) / (z + 1)) * response
        command = shape / response
        for gain in 1.0 / np.interp(np.geomspace(0.5, 0.05 * rate_hz, 70), grid, np.abs(shape)):
            mean = _mean_if_kept(gain * shape, gain * command, grid, rate_hz, asked, peak)
            if mean is None or (best is not None and mean >= best.mean_db):
                continue
            if _is_stable(held, numerator, denominator, gain, whole):
                best = Best(kind, mean)
    return best


def _controllers(plant: ContinuousSystem, rate_hz: float) -> Iterator[tuple[str, Array, Array]]:
    """(kind, numerator, denominator) in p = (z - 1)/(z + 1), s = 2 rate p, of unit gain."""
    scale = 2.0 * rate_hz
    corners = 2.0 * np.pi * np.array([1.5, 5.0, 15.0, 50.0])
    soft = [p for p in plant.poles if p.imag > 0.0 and -p.real < 0.5 * abs(p)]
    notches: list[tuple[list[float], list[float]]] = [([1.0], [1.0])]
    notches += [
        ([1.0, -2.0 * p.real, abs(p) ** 2], [1.0, 2.0 * abs(p), abs(p) ** 2]) for p in sorted(soft, key=abs)[:2]
    ]
    leads: list[tuple[list[float], list[float]]] = [([1.0], [1.0])]
    leads += [([1.0 / w, 1.0], [0.2 / w, 1.0]) for w in 2.0 * np.pi * np.array([8.0, 25.0, 80.0])]
    fronts = [("k/s", [1.0]), *(("PI", [1.0 / w, 1.0]) for w in corners)]
    for (kind, front), lead, notch in product(fronts, leads, notches):
        extra = (" with lead" if len(lead[0]) > 1 else "") + (" and notch" if len(notch[0]) > 1 else "")
        numerator = np.polymul(np.polymul(front, lead[0]), notch[0])
        denominator = np.polymul(np.polymul([1.0, 0.0], lead[1]), notch[1])
        yield kind + extra, _scaled(numerator, scale), _scaled(denominator, scale)


def _scaled(polynomial: Array, scale: float) -> Array:
    return np.asarray(polynomial * scale ** np.arange(polynomial.size - 1, -1, -1.0))


def _companion(plant: ContinuousSystem) -> tuple[Any, ...]:
    return signal.zpk2ss(plant.zeros, plant.poles, plant.gain)


def _grid_hz(plant: ContinuousSystem, rate_hz: float) -> Array:
    parts = [np.geomspace(0.4, 10.0, 40), np.geomspace(10.0, 0.499 * rate_hz, 260)]
    for root in np.append(plant.poles, plant.zeros):
        if root.imag > 0.0:
            parts.append((root.imag + abs(root.real) * np.linspace(-3.0, 3.0, 25)) / (2.0 * np.pi))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid >= 0.4) & (grid < 0.5 * rate_hz)]


def _response(system: tuple[Any, ...], z: Any) -> Any:
    a, b, c, d = system
    eye = np.eye(a.shape[0])
    return np.array([(c @ np.linalg.solve(one * eye - a, b) + d)[0, 0] for one in z])


def _mean_if_kept(
    loop: Any, command: Any, grid: Array, rate_hz: float, asked: FeedbackRequirements, peak: float
) -> float | None:
    """Mean |S| in dB where every limit is kept, None otherwise."""
    away = 1.0 + loop
    if np.min(np.abs(away)) * asked.sensitivity_peak < 1.0 or np.max(np.abs(loop / away)) > peak:
        return None
    level = np.abs(loop)
    near = np.abs(np.degrees(np.angle(-loop)))
    crossing = np.flatnonzero((level[1:] > 1.0) != (level[:-1] > 1.0))
    if crossing.size and np.min(np.minimum(near[crossing], near[crossing + 1])) < asked.phase_margin_deg:
        return None
    power = np.trapezoid(np.abs(command / away) ** 2, grid) / (0.5 * rate_hz)
    if np.sqrt(power) > asked.command_noise_gain_max:
        return None
    inside = grid <= 10.0
    logs = np.log(grid[inside])
    return float(np.trapezoid(-20.0 * np.log10(np.abs(away[inside])), logs) / (logs[-1] - logs[0]))


def _is_stable(plant: tuple[Any, ...], numerator: Array, denominator: Array, gain: float, whole: int) -> bool:
    """Eigenvalues of plant, delay and controller closed; at half and a twentieth of the gain as well."""
    order = denominator.size - 1
    up, down = np.zeros(order + 1), np.zeros(order + 1)
    for k, value in enumerate(numerator[::-1]):
        up += value * np.polymul(np.poly(np.ones(k)), np.poly(-np.ones(order - k)))
    for k, value in enumerate(denominator[::-1]):
        down += value * np.polymul(np.poly(np.ones(k)), np.poly(-np.ones(order - k)))
    controller = signal.tf2ss(up, down)
    a, b, c, d = _series(_series(controller, _delay(whole)) if whole else controller, plant)
    if abs(d[0, 0]) > 1e-9:
        return False
    return all(np.max(np.abs(np.linalg.eigvals(a - gain * f * b @ c))) < 1.0 for f in (1.0, 0.5, 0.05))


def _delay(samples: int) -> tuple[Any, ...]:
    a = np.eye(samples, k=-1)
    b, c = np.zeros((samples, 1)), np.zeros((1, samples))
    b[0, 0] = c[0, -1] = 1.0
    return a, b, c, np.zeros((1, 1))


def _series(first: tuple[Any, ...], second: tuple[Any, ...]) -> tuple[Any, ...]:
    (a, b, c, d), (a2, b2, c2, d2) = first, second
    top = np.hstack([a, np.zeros((a.shape[0], a2.shape[0]))])
    return np.vstack([top, np.hstack([b2 @ c, a2])]), np.vstack([b, b2 @ d]), np.hstack([d2 @ c, c2]), d2 @ d
