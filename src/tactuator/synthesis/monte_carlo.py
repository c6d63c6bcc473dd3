"""Monte Carlo: a controller on thousands of plants that the display may be.

Plants are drawn from the covariance of an identified model (or, without one, from the channel's family), with every
lightly damped root shifted in frequency, under each load in turn. Everything is done on frequency responses: loads
act as P/(1 + P Z), the hold between samples as its own response; what aliases through the hold is left out, which is
(f/(rate - f))^2 of a second-order motor, 0.6 % at 300 Hz and 4 kHz. What an adaptive channel feeds forward under a
load is that of the nominal model, with the load's own weights; without a load, nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Channel, Display
from tactuator.model.plant import DERIVATIVES, Load
from tactuator.result import ResultTable
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.loop_figures import LoopFigures, around_modes_hz
from tactuator.synthesis.candidates import LIGHT_DAMPING
from tactuator.synthesis.family import UNLOADED
from tactuator.synthesis.touch import fed_push

QUANTILES = (0.5, 0.95, 0.99, 1.0)
FIGURES = ("sensitivity_peak", "flatness_db", "felt_hum_db_sl")
_AT_ONCE = 2000
"""Plants evaluated together: it bounds the memory."""
SHIFT = 0.02
"""Relative standard deviation of a mode's frequency, if no record gives it."""
_MOST = 1_000_000
"""Most plants that may be drawn."""


@dataclass(frozen=True, eq=False)
class DrawnPlants:
    """The fate of the plants drawn for one channel under one load.

    stable: of each plant, shape (count,). sensitivity_peak, flatness_db, felt_hum_db_sl: max|S|, greatest error of |H|
    over the band, level of the loudest mains line, each (count,) (nan for an unstable loop, or without such a
    quantity). source: "covariance", "family" or "nominal", what the plants were drawn from. mode_shift: the relative
    standard deviation with which the frequency of every lightly damped root was shifted; 0 where there is none.
    """

    channel: str
    load: str
    source: str
    mode_shift: float
    stable: NDArray[np.bool_]
    sensitivity_peak: FloatArray
    flatness_db: FloatArray
    felt_hum_db_sl: FloatArray

    @property
    def count(self) -> int:
        """Return the number of plants."""
        return int(self.stable.size)

    @property
    def unstable(self) -> float:
        """Return the share of unstable loops."""
        return float(1.0 - np.mean(self.stable))

    def quantiles(self, values: FloatArray) -> FloatArray:
        """Return one of the three figures at `QUANTILES` of the stable plants (nan without one): shape (4,)."""
        finite = values[np.isfinite(values)]
        return np.quantile(finite, QUANTILES) if finite.size else np.full(len(QUANTILES), np.nan)

    def document(self) -> dict[str, Any]:
        """Return plain tables, as `--json` prints them."""
        figures = {name: self.quantiles(getattr(self, name)) for name in FIGURES}
        plants = {"channel": self.channel, "load": self.load, "count": self.count, "source": self.source}
        return {**plants, "unstable": self.unstable, **figures, "quantiles": list(QUANTILES)}


def monte_carlo(
    controller: Controller, count: int, rng: np.random.Generator, mode_shift: float | None = None
) -> list[DrawnPlants]:
    """Return what becomes of `count` plants of every channel and load; mode_shift: relative standard deviation of the
    frequency of each lightly damped pole and zero pair, None for what a model's covariance says of it, and 2 % without
    one. Raises BadInput for a count or a shift that cannot be."""
    if not 1 <= count <= _MOST:
        raise BadInput(f"{count} plants to draw", f"1 to {_MOST}")
    if mode_shift is not None and not 0.0 <= mode_shift < 0.3:
        raise BadInput(f"a shift of modes of {mode_shift:g}", "0 to 0.3")
    display = controller.display
    shifts = {each.name: 0.0 if each.covariance else SHIFT for each in display.channels}
    shifts = shifts if mode_shift is None else dict.fromkeys(shifts, mode_shift)
    return [
        _drawn_plants(controller.channel(channel.name), channel, display, load, count, rng, shifts[channel.name])
        for channel in display.channels
        for load in (None, *channel.loads)
    ]


def _drawn_plants(
    controller: ChannelController,
    channel: Channel,
    display: Display,
    load: Load | None,
    count: int,
    rng: np.random.Generator,
    mode_shift: float,
) -> DrawnPlants:
    grid = _Grids(controller, channel, display, load)
    rows: list[tuple[NDArray[np.bool_], FloatArray, FloatArray, FloatArray]] = []
    for start in range(0, count, _AT_ONCE):
        plants = _drawn(channel, min(_AT_ONCE, count - start), rng, mode_shift, grid.frequency_hz)
        rows.append(grid.figures(_loaded(plants, load, channel, grid.frequency_hz)))
    stable, *figures = (np.concatenate(column) for column in zip(*rows, strict=True))
    return DrawnPlants(
        channel.name,
        UNLOADED if load is None else load.name,
        "covariance" if channel.covariance else "family" if channel.family else "nominal",
        mode_shift if next(light_roots(channel), None) is not None else 0.0,
        stable,
        *(np.where(stable, values, np.nan) for values in figures),
    )


class _Grids:
    """One channel's controller on the frequencies of the band, the mains lines and the whole loop."""

    def __init__(self, controller: ChannelController, channel: Channel, display: Display, load: Load | None) -> None:
        rate_hz = display.rate_hz
        low, high = channel.threshold.band_hz
        spread = [np.geomspace(0.02 * low, low, 8), np.geomspace(low, 0.499 * rate_hz, 130)]
        around = around_modes_hz(np.append(channel.plant.poles, channel.plant.zeros))
        lines = np.array(channel.environment.hum_hz)
        grid = np.unique(np.concatenate([*spread, around, lines]))
        self.frequency_hz = grid[(grid > 0.0) & (grid < 0.5 * rate_hz)]
        self._channel = channel
        self._lines = np.searchsorted(self.frequency_hz, lines[lines < 0.5 * rate_hz])
        self._hum = np.array(channel.environment.hum_v_peak)[lines < 0.5 * rate_hz]
        self._band = (self.frequency_hz >= low) & (self.frequency_hz <= high)
        feedback = controller.feedback(rate_hz)
        delay = np.exp(-2j * np.pi * self.frequency_hz * (display.delay_samples + 0.5) / rate_hz)
        self._held = np.sinc(self.frequency_hz / rate_hz) * delay
        self._prefilter = controller.prefilter(rate_hz).response(self.frequency_hz)
        self._feedback = None if feedback is None else feedback.response(self.frequency_hz)
        self._integrators = 0 if feedback is None else int(np.sum(np.abs(feedback.poles - 1.0) < 1e-9))
        self._threshold_v = channel.threshold_voltage(self.frequency_hz)
        self._asked_v = channel.prefilter_voltage(self.frequency_hz[self._band])
        self._push: ComplexArray | float = 0.0
        if controller.feed_forward is not None and load is not None:
            plant = discretise(channel.plant, rate_hz, "zoh", display.delay_samples)
            free = TwoDegreeLoop(controller.prefilter(rate_hz), feedback, plant)
            self._push = fed_push(controller.feed_forward, free, load, self.frequency_hz, rate_hz)

    def figures(self, plants: ComplexArray) -> tuple[NDArray[np.bool_], FloatArray, FloatArray, FloatArray]:
        """Return (stable, max|S|, flatness in dB, felt hum in dB SL) of plants (n, f), each (n,)."""
        through = plants * self._held
        nothing = np.full(plants.shape[0], np.nan)
        if self._feedback is None:
            return np.ones(plants.shape[0], dtype=bool), nothing, self._flatness(through), nothing
        loops = LoopFigures(through * self._feedback)
        follow = loops.complementary
        hum = nothing
        if self._lines.size:
            moved = np.abs(follow[:, self._lines]) * self._hum
            hum = np.max(db(moved / self._threshold_v[self._lines]), axis=1)
        fed = through * loops.sensitivity * self._push
        return self._is_stable(loops), loops.sensitivity_peak, self._flatness(follow, fed), hum

    def _flatness(self, behind: ComplexArray, fed: ComplexArray | float = 0.0) -> FloatArray:
        position = np.abs(self._prefilter * behind + fed)[:, self._band]
        return np.asarray(np.max(np.abs(db(position / self._asked_v)), axis=1))

    def _is_stable(self, loops: LoopFigures) -> NDArray[np.bool_]:
        """Return whether loops are stable, by the poles of the nominal plant."""
        poles = self._channel.plant.poles
        at_rest = self._integrators + int(np.sum(np.abs(poles) < 1e-9))
        outside = int(np.sum(poles.real > 1e-9))
        return loops.is_stable(at_rest, outside)


def _drawn(
    channel: Channel, count: int, rng: np.random.Generator, mode_shift: float, frequency_hz: FloatArray
) -> ComplexArray:
    """Return responses (count, f) of plants drawn from what is known of the channel, with shifted modes."""
    s: ComplexArray = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    plants = (channel.plant, *channel.family)
    known = np.array([plant.response(frequency_hz) for plant in plants])
    responses = known[rng.integers(len(plants), size=count)]
    if channel.covariance:
        responses = responses * _from_covariance(channel, count, rng, s) / known[0]
    for root, sign in light_roots(channel):
        moved = np.exp(mode_shift * rng.standard_normal((count, 1)))
        responses = responses * moved_root(root, moved, frequency_hz) ** sign
    return np.asarray(responses, dtype=np.complex128)


def moved_root(root: complex, moved: FloatArray | float, frequency_hz: FloatArray) -> ComplexArray:
    """Return the factor by which a pair of zeros changes a response at `frequency_hz` (f,) where its frequency is
    `moved` times as high; of unit gain far below, so that nothing changes at rest.
    """
    natural, damping = abs(root), -root.real / abs(root)
    s = 2j * np.pi * frequency_hz
    shifted = natural * moved
    return np.asarray(
        (s**2 / shifted**2 + 2.0 * damping * s / shifted + 1.0)
        / (s**2 / natural**2 + 2.0 * damping * s / natural + 1.0)
    )


def light_roots(channel: Channel) -> Iterator[tuple[complex, int]]:
    """Yield the upper one of every lightly damped pair: poles with the sign -1, zeros with +1."""
    for roots, sign in ((channel.plant.poles, -1), (channel.plant.zeros, 1)):
        for root in roots[(roots.imag > 0.0) & (np.abs(roots.real) < LIGHT_DAMPING * np.abs(roots))]:
            yield complex(root), sign


def _from_covariance(channel: Channel, count: int, rng: np.random.Generator, s: ComplexArray) -> ComplexArray:
    num, den = channel.plant.polynomials()
    theta = np.concatenate([num, den[1:], [channel.plant.delay_s]])
    covariance = np.array(channel.covariance)
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = theta + (rng.standard_normal((count, theta.size)) @ spread.T) * unit
    columns = drawn.T[:, :, None]
    above = np.polyval(columns[: num.size], s)
    below = np.polyval(np.concatenate([np.ones((1, count, 1)), columns[num.size : -1]]), s)
    late = np.exp(-s * np.maximum(drawn[:, -1:], 0.0))
    return np.asarray(above / below * late, dtype=np.complex128)


def _loaded(plants: ComplexArray, load: Load | None, channel: Channel, frequency_hz: FloatArray) -> ComplexArray:
    """Return P/(1 + P0 Z) with P0 the displacement without dead time (see `Load`)."""
    if load is None:
        return plants
    s = 2j * np.pi * frequency_hz
    late = np.exp(-s * channel.plant.delay_s)
    impedance = np.polyval(channel.impedance(load), s)
    moved = plants / late / s ** DERIVATIVES[channel.quantity]
    return np.asarray(plants / (1.0 + moved * impedance))


def plants_table(drawn: Sequence[DrawnPlants]) -> ResultTable:
    """Return what 95 % of the plants keep, and the greatest of all, of each channel and load."""
    names = ("channel", "load", "plants", "from", "unstable", "max|S|", "flatness dB", "felt hum dB SL")
    rows = []
    for plants in drawn:
        cells = [
            plants.quantiles(values) for values in (plants.sensitivity_peak, plants.flatness_db, plants.felt_hum_db_sl)
        ]
        kept = ("—" if np.isnan(values[1]) else f"{values[1]:.2f}/{values[-1]:.2f}" for values in cells)
        unstable = f"{100.0 * plants.unstable:.2g} %"
        rows.append((plants.channel, plants.load, str(plants.count), plants.source, unstable, *kept))
    note = "max|S|, flatness, felt hum: what 95 % of the plants keep / the greatest of all"
    return ResultTable("Monte Carlo", names, tuple(rows), (note,))
