"""The loop's chart: what it is drawn on, and every curve that changes while a controller is dragged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Channel, Display
from tactuator.model.plausibility import doubtful
from tactuator.model.verdict import FELT_MINUS_ASKED, FINDING_COLUMNS, Finding, Verdict, finding_row, verdict_of
from tactuator.processors import single_threaded
from tactuator.report.nichols import GAIN_LEVELS_DB, MARKS_HZ, hull
from tactuator.report.printed import design_rows
from tactuator.signals.decibels import db
from tactuator.signals.loop_figures import LoopFigures, around_modes_hz, continuous_phase_deg
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.design import assemble
from tactuator.synthesis.family import Member, plant_family
from tactuator.synthesis.prefilter import fit_prefilter
from tactuator.synthesis.verdict import AT_LOWEST, FELT_HUM, FELT_NOISE, RESONANCE, judge_channel
from tactuator.wordlength.float32_check import buildable

_TILES = (FELT_MINUS_ASKED, AT_LOWEST, FELT_HUM, FELT_NOISE, RESONANCE, "change of |H|")
"""Quantities of a verdict that stand in large figures."""
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
        "verdict": verdict_rows(verdict_of(findings)),
        "tiles": [
            _margin_tile(plants, controller),
            *_tiles(verdict_of([replace(each, model="") for each in findings])),
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


_BEYOND = 1e6
_POINTS = 240
_INSTANTS, _STEP_S = 320, 0.4


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
    states = States(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0)
    for b0, b1, b2, a0, a1, a2 in system.sections() / 1.0:
        section = States(
            np.array([[-a1, 1.0], [-a2, 0.0]]) / np.array([[a0, 1.0], [a0, 1.0]]),
            np.array([b1 - a1 * b0 / a0, b2 - a2 * b0 / a0]) / a0,
            np.array([1.0, 0.0]),
            b0 / a0,
        )
        states = _behind(states, section)
    for _ in range(system.delay_samples):
        states = _behind(states, States(np.zeros((1, 1)), np.ones(1), np.ones(1), 0.0))
    return states


def padded(plants: Sequence[States]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return systems stacked, (loops, n, n), (loops, n), (loops, n), (loops,): smaller ones get states that rest."""
    order = max(plant.b.size for plant in plants)
    a, b, c = np.zeros((len(plants), order, order)), np.zeros((len(plants), order)), np.zeros((len(plants), order))
    for place, plant in enumerate(plants):
        size = plant.b.size
        a[place, :size, :size], b[place, :size], c[place, :size] = plant.a, plant.b, plant.c
    return a, b, c, np.array([plant.d for plant in plants])


def steps(
    controller: States, plants: tuple[FloatArray, FloatArray, FloatArray, FloatArray], stride: int, instants: int
) -> Steps:
    """Return the steps of one controller around many plants, at every `stride`-th sample from 0 on.

    The loop is a cascade of second-order sections in state space, r -> (+) -> C -> (+ d) -> P -> y, closed without any
    polynomial of the whole. The rows c A^k at every instant are made by doubling, so that hundreds of instants of
    dozens of loops are a few matrix products.
    """
    ap, bp, cp, dp = plants
    loops, size, other = len(dp), controller.b.size, ap.shape[1]
    through = 1.0 / (1.0 + controller.d * dp)
    # u = by_controller xc + by_plant xp + by_input (r, d), the loop closed
    by_controller = controller.c[None] * through[:, None]
    by_plant = -controller.d * cp * through[:, None]
    by_input = np.stack([controller.d * through, through], axis=1)
    order = size + other
    a, b = np.zeros((loops, order, order)), np.zeros((loops, order, 2))
    bc = controller.b
    a[:, :size, :size] = controller.a - bc[:, None] * (dp[:, None] * by_controller)[:, None, :]
    a[:, :size, size:] = -bc[:, None] * (cp + dp[:, None] * by_plant)[:, None, :]
    a[:, size:, :size] = bp[:, :, None] * by_controller[:, None, :]
    a[:, size:, size:] = ap + bp[:, :, None] * by_plant[:, None, :]
    b[:, :size] = bc[:, None] * (np.array([1.0, 0.0]) - dp[:, None] * by_input)[:, None, :]
    b[:, size:] = bp[:, :, None] * by_input[:, None, :]
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
    values = np.concatenate([rows, direct], axis=1)[:, None, :]
    power = np.linalg.matrix_power(whole, stride)
    while values.shape[1] < instants:
        values = np.concatenate([values, values @ power], axis=1)
        power = power @ power
    return values[:, :instants, order], values[:, :instants, order + 1]


def _behind(first: States, second: States) -> States:
    apart = np.zeros((first.b.size, second.b.size))
    a = np.block([[first.a, apart], [np.outer(second.b, first.c), second.a]])
    b, c = np.append(first.b, second.b * first.d), np.append(second.d * first.c, second.c)
    return States(a, b, c, second.d * first.d)


def _bounded(values: FloatArray) -> FloatArray:
    return np.clip(np.nan_to_num(values, nan=0.0, posinf=_BEYOND, neginf=-_BEYOND), -_BEYOND, _BEYOND)


@dataclass(frozen=True)
class ChannelPlants:
    """Plants of a channel, computed once for one controller after another: channel, family (the
    nominal plant first), frequencies (n,) in hertz, responses of the plants (members, n), and their states; every
    `stride`-th sample of a step is shown.
    """

    display: Display
    channel: Channel
    family: tuple[Member, ...]
    frequency_hz: FloatArray
    response: ComplexArray
    states: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    stride: int

    @property
    def time_s(self) -> FloatArray:
        """Return the instants at which steps are shown, seconds."""
        return np.arange(_INSTANTS) * self.stride / self.display.rate_hz

    @property
    def shown(self) -> tuple[int, ...]:
        """Return the places of the members that have a curve of their own: the nominal model under every load."""
        return tuple(place for place, member in enumerate(self.family) if member.model == 0)


def channel_plants(display: Display, channel: Channel) -> ChannelPlants:
    """Return what the chart of one channel of a display is drawn on."""
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    frequency = _grid_hz(display, channel, family)
    plants = np.array([member.sampled.response(frequency) for member in family])
    stride = max(1, round(_STEP_S * display.rate_hz / _INSTANTS))
    states = padded([states_of(member.sampled) for member in family])
    return ChannelPlants(display, channel, family, frequency, plants, states, stride)


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


_DRAWN_DB, _DRAWN_DEG = 0.02, 0.1
"""What the drawn frequencies leave open: a design that stands exactly at its limits does not pass them."""


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
    moved = steps(states_of(feedback), plants.states, plants.stride, plants.time_s.size)
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
        "steps": _steps(plants, moved),
        "unstable": [
            member.name for member, stable in zip(plants.family, moved.stable.tolist(), strict=True) if not stable
        ],
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


def _steps(plants: ChannelPlants, moved: Steps) -> dict[str, Any]:
    shown: dict[str, Any] = {}
    for name, values in (("asked", moved.asked), ("pushed", moved.pushed)):
        shown[name] = {"curves": [_plain(values[place], 4) for place in plants.shown]}
        if len(plants.family) > 1:
            shown[name]["envelope"] = [_plain(values.min(axis=0), 4), _plain(values.max(axis=0), 4)]
    return shown


def _crossed(plants: ChannelPlants, loops: LoopFigures, sense: FloatArray, complement: FloatArray) -> Iterator[str]:
    """Yield what the family passes, as it shows on the drawn frequencies; the figures tell by how much."""
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
