"""The prefilter, with which a reference of amplitude one is at threshold at every frequency.

H = F T is to equal the threshold voltage of the curve, on the sampled loop as it will run and without a load. Where
there is no loop, F equalises the plant itself.

H's inverse is therefore known from the display alone: W = 1/threshold voltage, minimum phase, the felt weighting. Above
the band it stays near its value at the band's end, since the sensor's noise is not to be amplified further. What W
gives for y = H r is r again (threshold units), whatever C and F are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.model.requirements import MOST_POLES
from tactuator.signals.decibels import db, from_db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.loop_figures import around_modes_hz
from tactuator.signals.magnitude import MagnitudeGoal, fit_magnitude
from tactuator.signals.systems import SampledSystem, sections_response
from tactuator.synthesis.felt import friction_loss_db
from tactuator.synthesis.sections import cascade

_FRICTION_FLOORS_DB = {20.0: 0.45, 10.0: 0.72}
"""By level (dB SL): how far below the curve the motion may be, friction included, as far as the fit can help it."""


@dataclass(frozen=True)
class PrefilterFit:
    """A fitted prefilter: sections (n, 6); its number of poles; the error of |H| against the curve over the band, dB:
    greatest, where (hertz), root mean square even in log frequency; and the error at frequency_hz, shape (k,)."""

    sections: FloatArray
    poles: int
    max_error_db: float
    worst_hz: float
    rms_error_db: float
    frequency_hz: FloatArray
    error_db: FloatArray


def fit_prefilter(
    channel: Channel,
    feedback: SampledSystem | None,
    rate_hz: float,
    delay_samples: int,
    poles: int | None = None,
    tolerance_db: float = 0.25,
    raised_db: Callable[[FloatArray], FloatArray] = np.zeros_like,
) -> PrefilterFit:
    """Fit the prefilter of `poles` poles (None: the fewest, even, that keep tolerance_db) for the channel's curve.

    raised_db: by how much it is to lie above the curve at frequencies (n,), hertz.

    Raises UnstableLoop for an unstable loop; BadInput if no number of poles up to 16 keeps the tolerance, or if the
    plant gives nothing somewhere in the band.
    """
    loop = bare_loop(feedback, discretise(channel.plant, rate_hz, "zoh", delay_samples))
    goal = prefilter_goal(channel, loop, rate_hz)
    raised = raised_db(goal.frequency_hz)
    floor_db = None if goal.floor_db is None else goal.floor_db - raised
    goal = replace(goal, level_db=goal.level_db + raised, ceiling_db=goal.ceiling_db + max(raised), floor_db=floor_db)
    if poles is not None:
        return _fit(channel, loop, rate_hz, goal, poles, raised_db)
    best = float("inf")
    for count in range(2, MOST_POLES + 1, 2):
        try:
            fit = _fit(channel, loop, rate_hz, goal, count, raised_db)
        except BadInput:
            if count < MOST_POLES:
                continue
            raise
        if fit.max_error_db <= tolerance_db:
            return fit
        best = min(best, fit.max_error_db)
    raise BadInput(
        f"channel {channel.name!r}: {MOST_POLES} poles leave a prefilter error of {best:.2f} dB",
        f"a tolerance of at least that (asked: {tolerance_db:g} dB)",
    )


def bare_loop(feedback: SampledSystem | None, plant: SampledSystem) -> TwoDegreeLoop:
    """Return what follows a prefilter, T or the plant itself, as a loop whose prefilter is one.

    Raises UnstableLoop for an unstable loop.
    """
    loop = TwoDegreeLoop(SampledSystem(np.empty(0), np.empty(0), 1.0, plant.rate_hz), feedback, plant)
    if loop.feedback is not None:
        loop.feedback.require_stable()
    return loop


def prefilter_goal(channel: Channel, loop: TwoDegreeLoop, rate_hz: float) -> MagnitudeGoal:
    """Return the goal |F| = threshold voltage / |T| over the band; held near it below; no more than its greatest above
    the band. loop: the bare one.

    Friction only takes away: where it does, the fit leans against it within its tolerance.
    """
    low, high = channel.threshold.band_hz
    inside, zeros = _design_grid_hz(channel, loop, rate_hz), loop.plant.zeros
    below = np.append(np.geomspace(low * 1e-3, low / 15.0, 5), np.geomspace(low / 10.0, low / 1.03, 14))
    if zeros.size and np.min(np.abs(zeros - 1.0)) < 1e-9:
        below = np.empty(0)  # a plant that gives nothing at rest asks nothing of the prefilter there
    frequency = np.append(below, inside)
    level = db(channel.prefilter_voltage(frequency) / np.abs(loop.moved_response(frequency)))
    if not np.all(np.isfinite(level)):
        raise BadInput(f"channel {channel.name!r}: the plant gives nothing somewhere in the band", "no such zero")
    # dB by which the error may be larger below the band
    allowance = np.append(np.full(below.size, 1.0), np.zeros(inside.size))
    falls = max(channel.prefilter.falls_above_hz, high * 1.02)
    top = 0.499 * rate_hz
    if falls > 0.9 * top:
        falls = max(high * 1.02, 0.9 * top)
    above = np.unique(np.append(np.geomspace(high * 1.02, top, 50), falls))
    ceiling_db = float(np.max(level[allowance == 0.0]))
    floors = [  # the least error that keeps what friction takes within bounds
        friction_loss_db(channel, loop, frequency, level_db_sl) - most
        for level_db_sl, most in _FRICTION_FLOORS_DB.items()
    ]
    return MagnitudeGoal(frequency, level, allowance, above, ceiling_db, np.asarray(np.max(floors, axis=0)), falls)


def band_grid_hz(channel: Channel, count: int) -> FloatArray:
    """Return `count` frequencies of the band, even in log frequency, and those of the curve's points."""
    (low, high), points = channel.threshold.band_hz, channel.threshold.curve.frequency_hz
    return np.unique(np.append(np.geomspace(low, high, count), points[(points >= low) & (points <= high)]))


def _design_grid_hz(channel: Channel, loop: TwoDegreeLoop, rate_hz: float) -> FloatArray:
    """Return frequencies of the band: even in log frequency, the curve's own, and dense around lightly damped roots."""
    low, high = channel.threshold.band_hz
    parts = [band_grid_hz(channel, 200)]
    for system in (loop.plant, *([] if loop.controller is None else [loop.controller])):
        roots = np.append(system.poles, system.zeros)
        s = np.log(roots[np.abs(roots) > 1e-3]) * rate_hz
        parts.append(around_modes_hz(s[s.imag > 0.0]))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid >= low) & (grid <= high)]


def response_error_db(channel: Channel, loop: TwoDegreeLoop, frequency_hz: ArrayLike) -> FloatArray:
    """Return the error of |H| against what the prefilter is to give, dB, at `frequency_hz`."""
    return db(np.abs(loop.moved_response(frequency_hz)) / channel.prefilter_voltage(frequency_hz))


def _fit(
    channel: Channel,
    loop: TwoDegreeLoop,
    rate_hz: float,
    goal: MagnitudeGoal,
    poles: int,
    raised_db: Callable[[FloatArray], FloatArray],
) -> PrefilterFit:
    sections = cascade(fit_magnitude(goal, rate_hz, poles))
    judged = band_grid_hz(channel, 1200)
    wanted = channel.prefilter_voltage(judged) / np.abs(loop.moved_response(judged))
    error = db(np.abs(sections_response(sections, judged, rate_hz)) / wanted)
    above = error - raised_db(judged)
    centre = 0.5 * float(np.max(above) + np.min(above))
    sections[0, :3] *= 10.0 ** (-centre / 20.0)
    error = error - centre
    worst = int(np.argmax(np.abs(error)))
    rms = float(np.sqrt(np.mean(error**2)))
    return PrefilterFit(sections, poles, float(abs(error[worst])), float(judged[worst]), rms, judged, error)


def weighting_sections(channel: Channel, rate_hz: float) -> FloatArray:
    """Return W as second-order sections, shape (2, 6), at rate_hz: volts of y to felt threshold units.

    Channels whose sensors differ in gain alone share one fit. Raises BadInput if no stable filter of that order comes
    near it.
    """
    frequency = np.geomspace(*channel.threshold.band_hz, 160)
    level: FloatArray = -db(channel.threshold_voltage(frequency))
    least = float(np.min(level))
    sections = _fitted(tuple(np.round(level - least, 9).tolist()), channel.threshold.band_hz, rate_hz).copy()
    sections[0, :3] *= from_db(least)
    return sections


@lru_cache(maxsize=64)
def _fitted(level_db: tuple[float, ...], band_hz: tuple[float, float], rate_hz: float) -> FloatArray:
    """Return the sections that follow a level over the band, and stay near its greatest value above it."""
    low, high = band_hz
    frequency, level = np.geomspace(low, high, len(level_db)), np.array(level_db)
    goal = MagnitudeGoal(
        frequency_hz=frequency,
        level_db=level,
        allowance_db=np.zeros_like(frequency),
        above_hz=np.geomspace(1.02 * high, 0.4998 * rate_hz, 50),
        # above the band the weighting may rise by 6 dB
        ceiling_db=float(np.max(level)) + 6.0,
    )
    # poles of the fit
    return cascade(fit_magnitude(goal, rate_hz, 4))
