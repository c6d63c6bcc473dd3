"""The loop's chart: what it is drawn on, and every curve that changes while a controller is dragged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Channel, Display
from tactuator.model.plausibility import doubtful
from tactuator.model.verdict import (
    AT_LOWEST,
    FELT_HUM,
    FELT_NOISE,
    FINDING_COLUMNS,
    LEVEL_ERROR,
    Finding,
    Verdict,
    finding_row,
    verdict_of,
)
from tactuator.processors import single_threaded
from tactuator.report.nichols import GAIN_LEVELS_DB, MARKS_HZ, hull
from tactuator.report.printed import design_rows
from tactuator.signals.decibels import db
from tactuator.signals.loop_figures import LoopFigures, around_modes_hz, continuous_phase_deg
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.design import assemble
from tactuator.synthesis.family import Member, plant_family
from tactuator.synthesis.objectives import RESONANCE, judge_channel
from tactuator.synthesis.prefilter import fit_prefilter
from tactuator.wordlength.float32_check import buildable

_TILES = (LEVEL_ERROR, AT_LOWEST, FELT_HUM, FELT_NOISE, RESONANCE, "change of |H|")
"""Quantities of a verdict that are shown in large type."""
_BUILD = "build"


def channel_controller(plants: ChannelPlants, feedback: SampledSystem) -> ChannelController:
    """Return the controller of a channel with C as it was shaped, and the prefilter that belongs to it.

    Raises UnstableLoop where the loop is unstable on a plant of the family; BadInput where no prefilter fits.
    """
    display, channel = plants.display, plants.channel
    with single_threaded():  # as `design` does: the same figures on any machine
        fit = fit_prefilter(channel, feedback, display.rate_hz, display.delay_samples, channel.prefilter.poles)
        return assemble(display, channel, feedback, fit, plants.family)


def settled_figures(
    plants: ChannelPlants, feedback: SampledSystem, known: ChannelController | None
) -> tuple[ChannelController, dict[str, Any]]:
    """Return the controller of a channel (the one that is known already, or one made for C), and its figures."""
    controller = channel_controller(plants, feedback) if known is None else known
    return controller, channel_figures(plants, controller)


def channel_figures(plants: ChannelPlants, controller: ChannelController) -> dict[str, Any]:
    """Return the figures of `design` and the findings of `check` on one channel, as rows of texts, and the large
    figures: name, value and limit as texts, and what came of them.
    """
    alone = Controller(replace(plants.display, channels=(plants.channel,)), (controller,))
    findings = [*judge_channel(controller, plants.channel, plants.display), buildable(alone), *doubtful(alone.display)]
    return {
        "design": [list(row) for row in design_rows([controller])],
        "verdict": verdict_rows(verdict_of(findings, channels=(plants.channel,))),
        "tiles": [
            _margin_tile(plants, controller),
            *_tiles(verdict_of([replace(each, model="") for each in findings], channels=(plants.channel,))),
        ],
    }


def verdict_rows(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict as `check` prints it: columns, rows of texts with remarks, its sentence, what was assumed."""
    worst = [finding for objective in verdict.objectives for finding in objective.worst()]
    return {
        "columns": [*FINDING_COLUMNS, "remark"],
        "rows": [[*finding_row(finding), finding.remark] for finding in worst],
        "sentence": verdict.sentence,
        "assumed": list(verdict.assumptions),
    }


def _margin_tile(plants: ChannelPlants, controller: ChannelController) -> dict[str, str]:
    margin = controller.report["margins"]["phase_margin_deg"]
    asked = plants.channel.feedback.phase_margin_deg
    short = asked is not None and margin is not None and margin < asked
    return {
        "name": "phase margin",
        "value": "—" if margin is None else f"{margin:.2f}°",
        "allowed": "" if asked is None else f"{asked:g}° or more",
        "outcome": "not met" if short else "met",
    }


def _tiles(verdict: Verdict) -> list[dict[str, str]]:
    findings = [finding for objective in verdict.objectives for finding in objective.worst()]
    worst = {finding.quantity: finding for finding in findings if finding.objective != _BUILD}
    built = [replace(finding, quantity="word length: float32") for finding in findings if finding.objective == _BUILD]
    return [_tile(finding) for finding in [*(worst[name] for name in _TILES if name in worst), *built]]


def _tile(finding: Finding) -> dict[str, str]:
    allowed = finding_row(finding)[4]
    return {
        "name": finding.quantity,
        "value": finding.figure,
        "allowed": allowed if finding.side or not allowed else f"{allowed} or less",
        "outcome": finding.outcome.value,
    }


_POINTS = 240
_INSTANTS, _STEP_S = 320, 0.4
_FOLD = 1e-6
"""Share of a step's end that the inverse transform folds back onto its beginning; half the digits of a double."""


@dataclass(frozen=True, eq=False)
class StepCircle:
    """A circle |z| = radius, by which steps come of responses: the inverse z-transform, y[k] = radius^k times the
    inverse FFT of Y on it. Every pole lies inside where the loop is stable, and what comes after `count` samples folds
    back onto the beginning, weighed by radius^-count (Abate & Whitt 1992, Queueing Systems 10).
    """

    count: int

    @cached_property
    def z(self) -> ComplexArray:
        """Return the upper half of the circle, (count // 2 + 1,)."""
        return np.asarray(self._radius * np.exp(2j * np.pi * np.arange(self.count // 2 + 1) / self.count))

    @property
    def _radius(self) -> float:
        return float(_FOLD ** (-1.0 / self.count))

    def response(self, system: SampledSystem) -> ComplexArray:
        """Return the response of a system on the circle."""
        zeros, poles = (np.prod(self.z[:, None] - roots, axis=1) for roots in (system.zeros, system.poles))
        return np.asarray(system.gain * zeros / poles / self.z**system.delay_samples)

    def steps(self, closed: ComplexArray) -> FloatArray:
        """Return the answers to a step of one, (..., count), of systems by their responses on the circle."""
        values = scipy.fft.irfft(closed * self.z / (self.z - 1.0), self.count, axis=-1)
        return np.asarray(values * self._radius ** np.arange(self.count))


@dataclass(frozen=True)
class ChannelPlants:
    """Plants of a channel, computed once for one controller after another: channel, family (the
    nominal plant first), frequencies (n,) in hertz and responses of the plants there, (members, n), and on the circle
    that gives their steps; every `stride`-th sample of a step is shown.
    """

    display: Display
    channel: Channel
    family: tuple[Member, ...]
    frequency_hz: FloatArray
    response: ComplexArray
    circle: StepCircle
    on_circle: ComplexArray
    stride: int

    @property
    def time_s(self) -> FloatArray:
        """Return the instants at which steps are shown, seconds."""
        return np.arange(_INSTANTS) * self.stride / self.display.rate_hz

    @property
    def shown(self) -> tuple[int, ...]:
        """Return the places of the members with a separate curve: the nominal model under every load."""
        return tuple(place for place, member in enumerate(self.family) if member.model == 0)


def channel_plants(display: Display, channel: Channel) -> ChannelPlants:
    """Return what the chart of one channel of a display is drawn on."""
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    frequency = _grid_hz(display, channel, family)
    plants = np.array([member.sampled.response(frequency) for member in family])
    stride = max(1, round(_STEP_S * display.rate_hz / _INSTANTS))
    circle = StepCircle(scipy.fft.next_fast_len(_INSTANTS * stride, real=True))
    on_circle = np.array([circle.response(member.sampled) for member in family])
    return ChannelPlants(display, channel, family, frequency, plants, circle, on_circle, stride)


def _grid_hz(display: Display, channel: Channel, family: tuple[Member, ...]) -> FloatArray:
    """Return frequencies up to half the rate, those of the limits among them, dense around light damping."""
    low = min(channel.threshold.band_hz[0], channel.feedback.rejection_band_hz[0]) / 2.0
    high = 0.499 * display.rate_hz
    asked = channel.feedback
    parts = [np.geomspace(low, high, _POINTS), np.array([*asked.rejection_hz, *asked.mains_hz])]
    roots = np.concatenate([np.append(member.continuous.poles, member.continuous.zeros) for member in family])
    parts.append(around_modes_hz(roots[roots.real != 0.0]))
    grid = np.unique(np.concatenate(parts))
    return np.asarray(grid[(grid >= low) & (grid <= high)])


_TURN = np.linspace(0.0, 2.0 * np.pi, 361)


def ground(plants: ChannelPlants) -> dict[str, Any]:
    """Return contours of |T| (dB), and the regions around the critical point, as points (phase in degrees from -360 to
    0, gain in dB): `sensitivity`, in which |S| passes its limit, `resonance`, in which |T| does; `phase`, the margin
    asked for in degrees; and limits of |S| and |T| by frequency.
    """
    asked = plants.channel.feedback
    peak_s = asked.sensitivity_peak
    peak_t = plants.display.objectives.resonance_peak
    closed = peak_t * np.exp(1j * _TURN)
    return {
        "contours": [{"level_db": level, "points": _contour(10.0 ** (level / 20.0))} for level in GAIN_LEVELS_DB],
        "sensitivity": None if peak_s is None else _points(-1.0 + np.exp(1j * _TURN) / peak_s),
        "resonance": _points(closed / (1.0 - closed)) if peak_t > 1.0 else None,
        "phase": asked.phase_margin_deg,
        "limits": {
            "s_db": [list(pair) for pair in zip(asked.rejection_hz, asked.rejection_max_db, strict=True)],
            "t_db": [list(pair) for pair in zip(asked.mains_hz, asked.mains_max_db, strict=True)],
            "s_peak_db": None if peak_s is None else float(db(peak_s)),
            "t_peak_db": float(db(peak_t)),
        },
    }


def _contour(value: float) -> list[list[float]]:
    """Return the contour |T| = value between -360 and 0 degrees, from its left end on."""
    closed = value * np.exp(1j * np.linspace(1e-3, 2.0 * np.pi - 1e-3, 241))
    with np.errstate(all="ignore"):
        # below 1 it runs from 0 to -360 degrees; above, around the critical point
        return _points(closed / (1.0 - closed), ascending=value < 1.0)


def _points(loop: ComplexArray, ascending: bool = False) -> list[list[float]]:
    """Return L as points of phase (degrees, from -360 to 0) and gain (dB), rounded to what is drawn."""
    phase = np.degrees(np.angle(loop))
    points = np.column_stack([np.where(phase > 0.0, phase - 360.0, phase), db(loop)])
    points = points[np.isfinite(points[:, 1]) & (np.abs(points[:, 1]) < 120.0)]
    rounded: list[list[float]] = np.round(points[np.argsort(points[:, 0])] if ascending else points, 1).tolist()
    return rounded


_AT_REST = 1e-9
"""Distance from z = 1 within which a pole lies at rest, as an integrator's does."""
_DRAWN_DB, _DRAWN_DEG = 0.02, 0.1
"""Tolerance for the drawn frequencies: a design exactly at its limits does not exceed them."""


def frame(plants: ChannelPlants, feedback: SampledSystem) -> dict[str, Any]:
    """Return the curves of a controller around every plant of a channel, as plain lists.

    curves: of the nominal model under each load, gain (dB) and phase (degrees) of L, and |S| and |T| in dB, at the
    chart's frequencies; envelope: least and greatest of |L|, |S| and |T| over the whole family; templates: at marked
    frequencies the hull of L over the family; steps: at the chart's instants; unstable: names of the plants on which
    the loop is unstable; crossed: names of the regions and limits that the family passes.
    """
    loops = LoopFigures(np.asarray(feedback.response(plants.frequency_hz) * plants.response))
    gain, phase = db(loops.loop), continuous_phase_deg(loops.loop)
    sense, complement = db(loops.sensitivity), db(loops.complementary)
    stable = _is_stable(plants, feedback, loops)
    curves = [
        {
            "load": plants.family[place].load,
            "gain_db": _plain(gain[place]),
            "phase_deg": _plain(phase[place]),
            "s_db": _plain(sense[place]),
            "t_db": _plain(complement[place]),
        }
        for place in plants.shown
    ]
    return {
        "curves": curves,
        "envelope": {
            name: [_plain(values.min(axis=0)), _plain(values.max(axis=0))]
            for name, values in (("gain_db", gain), ("s_db", sense), ("t_db", complement))
        }
        if len(plants.family) > 1
        else None,
        "templates": list(_templates(plants, phase, gain)) if len(plants.family) > 1 else [],
        "steps": _steps(plants, feedback, stable),
        "unstable": [member.name for member, each in zip(plants.family, stable, strict=True) if not each],
        "crossed": list(_crossed(plants, loops, sense, complement)),
    }


def _templates(plants: ChannelPlants, phase: FloatArray, gain: FloatArray) -> Iterator[list[list[float]]]:
    logs = np.log(plants.frequency_hz)
    for mark in MARKS_HZ:
        if plants.frequency_hz[0] < mark < plants.frequency_hz[-1]:
            place = int(np.searchsorted(logs, np.log(mark)))
            share = (np.log(mark) - logs[place - 1]) / (logs[place] - logs[place - 1])
            points = [(1.0 - share) * axis[:, place - 1] + share * axis[:, place] for axis in (phase, gain)]
            yield np.round(hull(np.array(points).T), 2).tolist()


def _is_stable(plants: ChannelPlants, feedback: SampledSystem, loops: LoopFigures) -> NDArray[np.bool_]:
    poles = [np.append(feedback.poles, member.sampled.poles) for member in plants.family]
    at_rest = np.array([np.sum(np.abs(each - 1.0) < _AT_REST) for each in poles])
    return loops.is_stable(at_rest, np.array([np.sum(np.abs(each) > 1.0 + _AT_REST) for each in poles]))


def _steps(plants: ChannelPlants, feedback: SampledSystem, stable: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the steps of the loops that are stable: `asked`, one volt at the loop's input; `pushed`, one volt added to
    the command. None: of an unstable loop.
    """
    loop = plants.circle.response(feedback) * plants.on_circle
    shown: dict[str, Any] = {}
    for name, forward in (("asked", loop), ("pushed", plants.on_circle)):
        values = plants.circle.steps(forward / (1.0 + loop))[:, :: plants.stride][:, :_INSTANTS]
        shown[name] = {"curves": [_plain(values[place], 4) if stable[place] else None for place in plants.shown]}
        if len(plants.family) > 1 and np.any(stable):
            held = values[stable]
            shown[name]["envelope"] = [_plain(held.min(axis=0), 4), _plain(held.max(axis=0), 4)]
    return shown


def _crossed(plants: ChannelPlants, loops: LoopFigures, sense: FloatArray, complement: FloatArray) -> Iterator[str]:
    """Yield the limits that the family exceeds at the drawn frequencies; the figures say by how much."""
    asked, logs = plants.channel.feedback, np.log(plants.frequency_hz)
    if asked.sensitivity_peak is not None and np.max(sense) > db(asked.sensitivity_peak) + _DRAWN_DB:
        yield "sensitivity"
    if np.max(complement) > db(plants.display.objectives.resonance_peak) + _DRAWN_DB:
        yield "resonance"
    margin_deg = float(np.min(np.abs(loops.phase_margin_deg()[0])))
    if asked.phase_margin_deg is not None and margin_deg < asked.phase_margin_deg - _DRAWN_DEG:
        yield "phase"
    for name, levels, at, most in (
        ("rejection", sense, asked.rejection_hz, asked.rejection_max_db),
        ("mains", complement, asked.mains_hz, asked.mains_max_db),
    ):
        for frequency, limit in zip(at, most, strict=True):
            if any(np.interp(np.log(frequency), logs, level) > limit + _DRAWN_DB for level in levels):
                yield f"{name} {frequency:g}"


def _plain(values: FloatArray, digits: int = 3) -> list[float]:
    plain: list[float] = np.round(np.nan_to_num(values, neginf=-400.0, posinf=400.0), digits).tolist()
    return plain
