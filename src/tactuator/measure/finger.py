"""Mass, damping and stiffness of what touches a display, from play free, touched and free again: do they describe it?

Each realisation gives one estimate, so the confidence needs no model of the noise: Student's t over
the realisations. Lines count by their scatter between realisations. The one mass, damper and spring is held against a
Kelvin-Voigt chain of two: a contact mass, a damper and spring to a second mass, a damper and spring from there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.measure.error import ChannelPrediction
from tactuator.measure.options import FINGER_LEVEL_DB_SL, FINGER_S
from tactuator.measure.response import sensed_columns
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.model.plant import Load
from tactuator.perception.curve import FELT_BAND_HZ, check_level
from tactuator.plain import brief
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import from_db
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.multisine import Periods, multisine, odd_lines

ONE, CHAIN, NEITHER, CANNOT_TELL = "one", "chain", "neither", "cannot tell"
FELT_ALIKE_DB = 0.25
"""A misfit that changes what is felt by no more than this does not speak against one mass, damper and spring."""
_MODEL_SHARE = 1e-3
"""Share of a figure that the model leaves open at least: images of the held command, and what friction does
differently under a finger."""
_STARTS_HZ = (60.0, 120.0, 240.0)
"""Resonances of the second mass from which a chain is sought: an octave apart over the band where fingers have one."""


@dataclass(frozen=True)
class FingerEstimate:
    """Estimate of what touches a channel: figures in a load's units, their 95 % half-widths, and what describes it.

    described_by: "one" mass, damper and spring; a "chain" of two; "neither"; or "cannot tell", where a half-width of
    mass or damping is more than half of it, or a reading came to its end (saturated). misfit_db: by how much the misfit
    of the one changes the felt level, at most. excess, chain_excess: squared misfit over what chance leaves in 99 of
    100, of the one and of the chain. chain: its mass, damping, stiffness and the second's, fitted; empty where the one
    is within chance. per: scale of the figures, None for that of a motor.
    """

    channel: str
    mass: float
    damping: float
    stiffness: float
    half_width: tuple[float, float, float]
    described_by: str
    misfit_db: float
    excess: float
    chain_excess: float | None
    chain: tuple[float, ...]
    realisations: int
    saturated: bool
    per: float | None = None

    __repr__ = brief

    @property
    def load(self) -> Load:
        """Return the load of a display file; a figure below zero, which noise can bring about, is zero."""
        return Load("finger", max(self.mass, 0.0), max(self.damping, 0.0), max(self.stiffness, 0.0), self.per)


def one_impedance(figures: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """Return m s^2 + b s + k at `frequency_hz` (n,) for figures (3,)."""
    s = 2j * np.pi * frequency_hz
    return np.asarray(figures[0] * s**2 + figures[1] * s + figures[2])


def chain_impedance(figures: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """Return the impedance of a chain of two at `frequency_hz` (n,): figures (6,), mass, damping, stiffness of the
    contact and of what is behind it."""
    s = 2j * np.pi * frequency_hz
    m, b, k, behind_m, behind_b, behind_k = figures
    link, behind = b * s + k, behind_m * s**2 + behind_b * s + behind_k
    return np.asarray(m * s**2 + link * behind / (link + behind))


def estimate_finger(
    channel: str,
    frequency_hz: FloatArray,
    impedance: ComplexArray,
    felt_per_impedance: ComplexArray,
    saturated: bool,
    model_share: float = _MODEL_SHARE,
) -> FingerEstimate:
    """Return what describes an impedance (realisations, m) at `frequency_hz` (m,).

    felt_per_impedance: change of the felt level, as a factor less one, for a small impedance more, (m,). model_share:
    by which the display's model is off without a load, a thousandth at least: every figure may be off as much.
    """
    count = impedance.shape[0]
    mean = impedance.mean(axis=0)
    scatter = np.sum(np.abs(impedance - mean) ** 2, axis=0) / (count - 1)
    weight = 1.0 / np.sqrt(np.maximum(scatter, 1e-24 * np.max(np.abs(mean)) ** 2))
    each = np.array([_fit_one(frequency_hz, realisation, weight) for realisation in impedance])
    figures = each.mean(axis=0)
    half = scipy.stats.t.ppf(0.975, count - 1) * each.std(axis=0, ddof=1) / np.sqrt(count)
    half = np.hypot(half, max(_MODEL_SHARE, model_share) * figures)
    missed = mean - one_impedance(figures, frequency_hz)
    excess = _excess(missed * weight, count, 1.5)
    chain, chain_excess = np.zeros(0), None
    if excess > 1.0:
        chain = _fit_chain(frequency_hz, mean, weight, figures)
        chain_excess = _excess((mean - chain_impedance(chain, frequency_hz)) * weight, count, 3.0)
    misfit_db = float(np.max(np.abs(20.0 * np.log10(np.abs(1.0 + felt_per_impedance * missed)))))
    if saturated or np.any(half[:2] > 0.5 * np.abs(figures[:2])):
        described_by = CANNOT_TELL
    elif chain_excess is None or misfit_db <= FELT_ALIKE_DB:
        described_by = ONE
    else:
        described_by = CHAIN if chain_excess <= max(1.0, 0.1 * excess) else NEITHER
    mass, damping, stiffness = figures.tolist()
    wide = (float(half[0]), float(half[1]), float(half[2]))
    return FingerEstimate(
        channel, mass, damping, stiffness, wide, described_by, misfit_db, excess, chain_excess,
        tuple(chain.tolist()), count, saturated,
    )  # fmt: skip


def _fit_one(frequency_hz: FloatArray, impedance: ComplexArray, weight: FloatArray) -> FloatArray:
    """Return m, b, k by weighted least squares, (3,)."""
    s = 2j * np.pi * frequency_hz
    columns = np.stack([s**2, s, np.ones_like(s)], axis=1) * weight[:, None]
    aim = impedance * weight
    size = np.linalg.norm(columns, axis=0)
    stacked = np.vstack([columns.real, columns.imag]) / size
    return np.asarray(np.linalg.lstsq(stacked, np.concatenate([aim.real, aim.imag]), rcond=None)[0] / size)


def _fit_chain(frequency_hz: FloatArray, mean: ComplexArray, weight: FloatArray, figures: FloatArray) -> FloatArray:
    """Return the chain of two nearest to an impedance, (6,), by descent in the figures' logarithms from three starts:
    a third of the mass at the contact, the rest behind a spring that resonates at different frequencies."""

    def off(logs: FloatArray) -> FloatArray:
        misfit = (chain_impedance(np.exp(logs), frequency_hz) - mean) * weight
        return np.concatenate([misfit.real, misfit.imag])

    mass, damping, stiffness = np.maximum(np.abs(figures), 1e-6 * np.max(np.abs(figures)))
    best = None
    for hertz in _STARTS_HZ:
        behind = mass / 1.5
        spring = behind * (2.0 * np.pi * hertz) ** 2
        start = np.log([mass / 3.0, np.sqrt(spring * behind), spring, behind, damping, stiffness])
        fit = scipy.optimize.least_squares(off, start, bounds=(start - 7.0, start + 7.0), max_nfev=200)
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    return np.asarray(np.exp(best.x))


def _excess(missed: ComplexArray, realisations: int, used: float) -> float:
    """Return the sum of squared misfit against its scatter, (m,) weighted by that of one realisation, over what it
    stays below in 99 of 100. used: complex figures that were fitted.

    Each term is Fisher's F with 2 and 2 (n - 1) degrees of freedom, their sum nearly a gamma variable.
    """
    below = 2.0 * (realisations - 1)
    mean = below / (below - 2.0)
    variance = below**3 / ((below - 2.0) ** 2 * (below - 4.0))
    # confidence with which a misfit speaks against a model: one finger in a hundred is called wrong by chance
    most = scipy.stats.gamma.ppf(0.99, (missed.size - used) * mean**2 / variance, scale=variance / mean)
    return float(np.sum(np.abs(missed) ** 2) * realisations / most)


REPEATS = 3
"""Periods of a realisation; the first settles."""
_PERIOD_S, _LINES, _FEWEST = 1.0, 32, 4
"""A period of a second has odd lines 2 Hz apart; 32 over the band; four realisations leave Student's t below 3.2."""


@dataclass(frozen=True, eq=False)
class FingerPlan:
    """Realisations of a multisine: when they are periodic, and the references (realisations, period) of all channels,
    or of each (realisations, period, channels)."""

    periods: Periods
    waves: FloatArray
    rate_hz: float

    @property
    def frequency_hz(self) -> FloatArray:
        """Return the excited frequencies, hertz, (m,)."""
        return np.asarray(self.periods.lines * self.rate_hz / self.periods.period)

    def part(self, kept: slice) -> FingerPlan:
        """Return the plan of some of the realisations."""
        waves = self.waves[kept]
        return replace(self, periods=replace(self.periods, realisations=len(waves)), waves=waves)

    def evened(self, factor: ComplexArray) -> FingerPlan:
        """Return the plan with the lines of each channel times a factor (channels, m)."""
        size = np.abs(factor)
        # factor by which a line is played stronger or weaker to a finger than free, at most
        factor = factor * np.clip(size, 0.5, 2.0) / size
        spectra = np.zeros((len(self.waves), self.periods.period // 2 + 1, len(factor)), dtype=np.complex128)
        lines = self.periods.lines
        spectra[:, lines] = np.fft.rfft(self.waves)[:, lines, None] * factor.T
        return replace(self, waves=np.fft.irfft(spectra, self.periods.period, axis=1))


@dataclass(frozen=True, eq=False)
class FingerPlay:
    """Spectra of command and position at the lines, (channels, realisations, m), and whose readings came to the
    converter's end, (channels,)."""

    command: ComplexArray
    position: ComplexArray
    ended: tuple[bool, ...]

    @property
    def response(self) -> ComplexArray:
        """Return what position there is for a command, (channels, realisations, m)."""
        return np.asarray(self.position / self.command)


def plan_play(
    rate_hz: float, band_hz: tuple[float, float], level_db_sl: float, seconds: float, rng: np.random.Generator
) -> FingerPlan:
    """Return multisines of lines at `level_db_sl` each: all of them free, the first and all of them touched take at
    most `seconds`.

    Raises BadInput for less time than four realisations take, a band with too few lines, or a level that may not be
    asked for.
    """
    check_level(level_db_sl)
    period = round(_PERIOD_S * rate_hz)
    count = (int(seconds * rate_hz / (REPEATS * period)) - 1) // 2
    if count < _FEWEST:
        least = (2 * _FEWEST + 1) * REPEATS * _PERIOD_S
        raise BadInput(f"{seconds:g} s for both states", f"{least:g} s or more")
    lines = odd_lines(band_hz, rate_hz, period, _LINES, rng)
    peak = float(from_db(level_db_sl))
    waves = [multisine(rate_hz, period, lines, peak, rng).one_period() for _ in range(count)]
    return FingerPlan(Periods(period, REPEATS, count, lines), np.array(waves), rate_hz)


def play_plan(rig: Rig, plan: FingerPlan, channels: Sequence[Channel]) -> FingerPlay:
    """Play the plan on channels of the rig at once; return what is heard of it.

    Raises BadInput where nothing is put out.
    """
    columns = [rig.channels.index(channel.name) for channel in channels]
    waves = plan.waves if plan.waves.ndim == 3 else plan.waves[:, :, None]
    reference = np.zeros((plan.periods.samples, len(rig.channels)))
    reference[:, columns] = np.repeat(waves, REPEATS, axis=0).reshape(plan.periods.samples, -1)
    trace = rig.play(reference)
    rig.rest()
    spectra: list[tuple[ComplexArray, ComplexArray]] = []
    ended = []
    for channel, column in zip(channels, columns, strict=True):
        command, position = (
            np.fft.rfft(plan.periods.blocks(values[:, column]).mean(axis=1))[:, plan.periods.lines]
            for values in (trace.command_v, trace.position_v)
        )
        if not np.all(np.abs(command) > 0.0):
            raise BadInput(f"channel {channel.name!r}: no command was put out", "a rig that plays")
        spectra.append((command, position))
        end_v = channel.converter.range_v - 1.5 * channel.converter.step_v
        ended.append(bool(np.max(np.abs(trace.position_v[:, column])) >= end_v))
    command, position = (np.array(part) for part in zip(*spectra, strict=True))
    return FingerPlay(command, position, tuple(ended))


def finger_impedance(channel: Channel, plan: FingerPlan, free: ComplexArray, touched: ComplexArray) -> ComplexArray:
    """Return the impedance in the units of a load of the display file, (realisations, m); free, touched: position over
    command, the same shape. A held command acts half a sample late, and a little less the higher its frequency.

    Raises BadInput for a channel whose sensor does not give the displacement.
    """
    if channel.quantity != "displacement":
        raise BadInput(f"channel {channel.name!r} measures the {channel.quantity}", "the displacement")
    f = plan.frequency_hz
    hold = np.sinc(f / plan.rate_hz) * np.exp(-2j * np.pi * f * (0.5 / plan.rate_hz + channel.plant.delay_s))
    return np.asarray(channel.load_scale * hold * (1.0 / touched - 1.0 / free))


def measure_finger(
    rig: Rig,
    controller: Controller,
    touch: Callable[[bool], object],
    rng: np.random.Generator,
    *,
    channels: Sequence[str] | None = None,
    level_db_sl: float = FINGER_LEVEL_DB_SL,
    seconds: float = FINGER_S,
) -> tuple[FingerEstimate, ...]:
    """Play half of the multisines with nothing on the display, `touch(True)`, play all as strongly as it takes for the
    same motion, `touch(False)`, play the other half, all in `seconds`; return what touches `channels` (default: all).

    What drifts evenly, as a motor that warms, falls out of the mean and is in the scatter between realisations.

    The controller is loaded here. Raises BadInput for an unknown channel, one without a loop or without a sensor of the
    displacement, or too short a time.
    """
    columns = sensed_columns(rig, channels)
    measured = [controller.display.channels[column] for column in columns]
    loops = [_loop(controller, column) for column in columns]
    low = max([FELT_BAND_HZ[0], *(channel.threshold.band_hz[0] for channel in measured)])
    # end of the lines, hertz: little moves above
    high = min([250.0, 0.2 * rig.rate_hz, *(channel.threshold.band_hz[1] for channel in measured)])
    plan = plan_play(rig.rate_hz, (low, high), level_db_sl, seconds, rng)
    rig.load(controller)
    half = len(plan.waves) // 2
    before = play_plan(rig, plan.part(slice(half)), measured)
    touch(True)
    tried = play_plan(rig, plan.part(slice(1)), measured)
    touched = play_plan(rig, plan.evened(before.position[:, 0] / tried.position[:, 0]), measured)
    touch(False)
    after = play_plan(rig, plan.part(slice(half, None)), measured)
    free = np.append(before.response, after.response, axis=1)
    estimates = []
    for k, channel in enumerate(measured):
        impedance = finger_impedance(channel, plan, free[k], touched.response[k])
        felt = loops[k].load_sensitivity(plan.frequency_hz) / channel.load_scale
        cut = any(play.ended[k] for play in (before, tried, touched, after))
        model = channel.plant.response(plan.frequency_hz) * np.sinc(plan.frequency_hz / plan.rate_hz)
        off = float(np.max(np.abs(np.median(np.abs(free[k] / model), axis=1) - 1.0)))
        estimate = estimate_finger(channel.name, plan.frequency_hz, impedance, felt, cut, off)
        estimates.append(estimate if channel.is_motor else replace(estimate, per=channel.load_scale))
    return tuple(estimates)


def _loop(controller: Controller, column: int) -> FeedbackLoop:
    """Return the unloaded loop of a channel. Raises BadInput for a channel without a loop."""
    name = controller.channels[column].name
    feedback = ChannelPrediction.of(controller, name).loop.feedback
    if feedback is None:
        raise BadInput(f"channel {name!r} has no loop, so its command does not show the load", "one with a loop")
    return feedback
