"""One frame of the loop view: every curve that changes while a controller is dragged."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.console.chart.bench import Bench
from tactuator.console.chart.transient import Steps, states_of, steps
from tactuator.report.envelope import hull
from tactuator.signals.decibels import db
from tactuator.signals.systems import SampledSystem

MARKS_HZ = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
"""Frequencies that are marked on the Nichols chart."""
_DRAWN_DB, _DRAWN_DEG = 0.02, 0.1
"""What the drawn frequencies leave open: a design that stands exactly at its limits does not pass them."""


def frame(bench: Bench, feedback: SampledSystem) -> dict[str, Any]:
    """Return the curves of a controller around every plant of a bench, as plain lists.

    curves: of the nominal model under each load, gain (dB) and phase (degrees) of L, and |S| and |T| in dB, at the
    bench's frequencies; envelope: least and greatest of |L|, |S| and |T| over the whole family; templates: at marked
    frequencies the hull of L over the family; steps: at the bench's instants; unstable: names of the plants on which
    the loop is unstable; crossed: names of the regions and limits that the family passes.
    """
    loop = np.asarray(feedback.response(bench.frequency_hz) * bench.plants)
    gain, phase = db(loop), continuous_phase_deg(loop)
    sense, complement = db(1.0 / (1.0 + loop)), db(loop / (1.0 + loop))
    moved = steps(states_of(feedback), bench.states, bench.stride, bench.time_s.size)
    curves = [
        {
            "load": bench.family[place].load,
            "gain_db": _plain(gain[place]),
            "phase_deg": _plain(phase[place]),
            "s_db": _plain(sense[place]),
            "t_db": _plain(complement[place]),
        }
        for place in bench.shown
    ]
    return {
        "curves": curves,
        "envelope": {
            name: [_plain(values.min(axis=0)), _plain(values.max(axis=0))]
            for name, values in (("gain_db", gain), ("s_db", sense), ("t_db", complement))
        }
        if len(bench.family) > 1
        else None,
        "templates": list(_templates(bench, phase, gain)) if len(bench.family) > 1 else [],
        "steps": _steps(bench, moved),
        "unstable": [
            member.name for member, stable in zip(bench.family, moved.stable.tolist(), strict=True) if not stable
        ],
        "crossed": list(_crossed(bench, gain, sense, complement, phase)),
    }


def continuous_phase_deg(response: ComplexArray) -> FloatArray:
    """Return the phase along the last axis without jumps, in degrees; it begins between -270 and 90."""
    phase = np.degrees(np.unwrap(np.angle(response), axis=-1))
    return np.asarray(phase - 360.0 * np.ceil((phase[..., :1] - 90.0) / 360.0))


def _templates(bench: Bench, phase: FloatArray, gain: FloatArray) -> Iterator[list[list[float]]]:
    logs = np.log(bench.frequency_hz)
    for mark in MARKS_HZ:
        if bench.frequency_hz[0] < mark < bench.frequency_hz[-1]:
            place = int(np.searchsorted(logs, np.log(mark)))
            share = (np.log(mark) - logs[place - 1]) / (logs[place] - logs[place - 1])
            points = [(1.0 - share) * one[:, place - 1] + share * one[:, place] for one in (phase, gain)]
            yield np.round(hull(np.array(points).T), 2).tolist()


def _steps(bench: Bench, moved: Steps) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, values in (("asked", moved.asked), ("pushed", moved.pushed)):
        found[name] = {"curves": [_plain(values[place], 4) for place in bench.shown]}
        if len(bench.family) > 1:
            found[name]["envelope"] = [_plain(values.min(axis=0), 4), _plain(values.max(axis=0), 4)]
    return found


def _crossed(
    bench: Bench, gain: FloatArray, sense: FloatArray, complement: FloatArray, phase: FloatArray
) -> Iterator[str]:
    """Yield what the family passes, as it shows on the drawn frequencies; the figures tell by how much."""
    asked = bench.channel.feedback
    if asked.sensitivity_peak is not None and np.max(sense) > db(asked.sensitivity_peak) + _DRAWN_DB:
        yield "sensitivity"
    if np.max(complement) > db(bench.display.objectives.resonance_peak) + _DRAWN_DB:
        yield "resonance"
    if asked.phase_margin_deg is not None and _within_margin(gain, phase, asked.phase_margin_deg):
        yield "phase"
    for name, levels, at, most in (
        ("rejection", sense, asked.rejection_hz, asked.rejection_max_db),
        ("mains", complement, asked.mains_hz, asked.mains_max_db),
    ):
        for frequency, limit in zip(at, most, strict=True):
            if any(np.interp(np.log(frequency), np.log(bench.frequency_hz), one) > limit + _DRAWN_DB for one in levels):
                yield f"{name} {frequency:g}"


def _within_margin(gain: FloatArray, phase: FloatArray, margin_deg: float) -> bool:
    """Return whether any curve passes 0 dB nearer to an odd half turn than the margin."""
    over = gain > 0.0
    for level, lag, above in zip(gain, phase, over, strict=True):
        for place in np.flatnonzero(above[1:] != above[:-1]):
            share = level[place] / (level[place] - level[place + 1])
            at = lag[place] + share * (lag[place + 1] - lag[place])
            if abs((at % 360.0) - 180.0) < margin_deg - _DRAWN_DEG:
                return True
    return False


def _plain(values: FloatArray, digits: int = 3) -> list[float]:
    found: list[float] = np.round(np.nan_to_num(values, neginf=-400.0, posinf=400.0), digits).tolist()
    return found
