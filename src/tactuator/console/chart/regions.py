"""The ground of a Nichols chart, drawn once: the closed loop's grid, and the regions that limits forbid."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.console.chart.bench import Bench
from tactuator.signals.decibels import db

_LEVELS_DB = (-40.0, -30.0, -20.0, -12.0, -6.0, -3.0, -1.0, 0.0, 1.0, 3.0, 6.0)
_TURN = np.linspace(0.0, 2.0 * np.pi, 361)


def ground(bench: Bench) -> dict[str, Any]:
    """Return contours of |T| (dB), and the regions around the critical point, as points (phase in degrees from -360 to
    0, gain in dB): `sensitivity`, in which |S| passes its limit, `resonance`, in which |T| does; `phase`, the margin
    asked for in degrees; and limits of |S| and |T| by frequency.
    """
    asked = bench.channel.feedback
    peak_s = asked.sensitivity_peak
    peak_t = bench.display.objectives.resonance_peak
    return {
        "contours": [{"level_db": level, "points": _contour(10.0 ** (level / 20.0))} for level in _LEVELS_DB],
        "sensitivity": None
        if asked.sensitivity_peak is None
        else _around(-1.0 + np.exp(1j * _TURN) / asked.sensitivity_peak),
        "resonance": _around(_circle_t(peak_t)) if peak_t > 1.0 else None,
        "phase": asked.phase_margin_deg,
        "limits": {
            "s_db": [list(pair) for pair in zip(asked.rejection_hz, asked.rejection_max_db, strict=True)],
            "t_db": [list(pair) for pair in zip(asked.mains_hz, asked.mains_max_db, strict=True)],
            "s_peak_db": None if peak_s is None else float(db(peak_s)),
            "t_peak_db": float(db(peak_t)),
        },
    }


def _circle_t(peak: float) -> ComplexArray:
    """Return L on which |T| has one value."""
    closed = peak * np.exp(1j * _TURN)
    return np.asarray(closed / (1.0 - closed))


def _contour(value: float) -> list[list[float]]:
    """Return the contour |T| = value between -360 and 0 degrees, from its left end on."""
    turn = np.linspace(1e-3, 2.0 * np.pi - 1e-3, 241)
    closed = value * np.exp(1j * turn)
    with np.errstate(all="ignore"):
        points = _points(np.asarray(closed / (1.0 - closed)))
    if value < 1.0:  # it runs from 0 to -360 degrees; above, around the critical point
        points = points[np.argsort(points[:, 0])]
    return _rounded(points)


def _around(loop: ComplexArray) -> list[list[float]]:
    return _rounded(_points(loop))


def _points(loop: ComplexArray) -> FloatArray:
    phase = np.degrees(np.angle(loop))
    points = np.column_stack([np.where(phase > 0.0, phase - 360.0, phase), db(loop)])
    return np.asarray(points[np.isfinite(points[:, 1]) & (np.abs(points[:, 1]) < 120.0)])


def _rounded(points: FloatArray) -> list[list[float]]:
    found: list[list[float]] = np.round(points, 1).tolist()
    return found
