"""Reshaping of a reference by its own level, so that equal references are equally strong: fitted to contours.

The distance of a contour from its strength level, d(f, L) = level(L, f) - L dB, is a gain over frequency for each level
L. All of them are sums of the same few pairs of poles and of the reference itself; the gains are found for each level:
least squares of the complex response against |d| with a phase, first the minimum phase that belongs to it, then that of
the fit before, and weights that grow where the error is greatest. Responses whose phases are near minimum phase are
near each other's, so that a blend of two lies between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import NoDesign
from tactuator.model.controller import StrengthShaping, shaping_basis
from tactuator.model.description import Channel
from tactuator.perception.contours import Contours
from tactuator.signals.decibels import db, from_db

PAIRS, LEVELS = 4, 21
"""Pairs of poles and levels of the core's reshaping (core/strength/strength.h)."""
_STEP_DB = float(10.0 * np.log10(2.0))
FOLLOW_S = 0.05
"""Time constant of each of the two poles through which the reference's power is followed. Less would let the level of a
slow tone swing with the tone itself."""
_FROM_HZ, _DAMPING = 3.0, 1.3
_TRIES, _FEW_ROUNDS, _ROUNDS = 160, 8, 60
"""Evaluations of the corners' search, and rounds of reweighting in each and of the result."""
_OUTSIDE_WEIGHT, _SHARPER, _EXACT_DB, _RIDGE = 0.1, 0.3, 1e-6, 1e-7
"""Weight beyond the band; power by which errors raise weights; error that is none, dB; part of the trace that keeps
the normal equations solvable."""
JUDGED_DB_SL = (10.0, 20.0, 30.0, 40.0, 50.0)
"""Strength levels at which a blended prefilter is judged."""


def fit_strength(channel: Channel, rate_hz: float, most_db: float) -> StrengthShaping | None:
    """Return how the channel's reference is reshaped; None where the prefilters of no several levels are asked for.

    Raises NoDesign where the response is further than most_db from a contour of `JUDGED_DB_SL`.
    """
    strength, band_hz = channel.strength, channel.threshold.band_hz
    if not strength.blended or strength.contours is None:
        return None
    shaping = _shaping(strength.contours, band_hz, rate_hz)
    inside = np.geomspace(*band_hz, 400)
    errors = furthest([shaping_error_db(shaping, level, strength.contours, inside, rate_hz) for level in JUDGED_DB_SL])
    at = int(np.argmax(np.abs(errors)))
    if abs(errors[at]) > most_db:
        raise NoDesign(
            f"channel {channel.name!r}: contours are missed by {errors[at]:+.2f} dB at {inside[at]:.3g} Hz; allowed: "
            f"contours without such steps, within {most_db:g} dB, or blended = false"
        )
    return shaping


@lru_cache(maxsize=16)
def _shaping(contours: Contours, band_hz: tuple[float, float], rate_hz: float) -> StrengthShaping:
    """Return the reshaping of a band: corners and damping by a search for the least error at some levels, gains for
    all.
    """
    low, high = band_hz
    grid = np.concatenate((np.geomspace(low / 10.0, low, 10), np.geomspace(low, high, 160)))
    grid = np.concatenate((grid, np.geomspace(1.02 * high, 0.49 * rate_hz, 30)))
    goals = [_Goal.of(contours, level, grid, band_hz, rate_hz) for level in _STEP_DB * np.arange(LEVELS)]
    # levels (9, 21 and 42 dB SL) by which the corners are chosen
    searched = [goals[row] for row in (3, 7, 14)]

    def missed_db(figures: FloatArray) -> float:
        corners, damping = np.sort(np.exp(figures[:-1])), float(np.exp(figures[-1]))
        # least ratio of neighbouring corners: nearer ones would be gains against each other
        near = np.min(corners[1:] / corners[:-1]) < 1.8
        if near or corners[0] < low or corners[-1] > 0.2 * rate_hz or not 0.4 < damping < 3.0:
            return 100.0
        basis = shaping_basis(corners, damping, grid, rate_hz)
        return max(goal.fitted(basis, _FEW_ROUNDS)[1] for goal in searched)

    start = np.log(np.append(np.geomspace(max(low, min(_FROM_HZ, high / 8.0)), high, PAIRS), _DAMPING))
    best = scipy.optimize.minimize(missed_db, start, method="Nelder-Mead", options={"maxfev": _TRIES}).x
    corners, damping = np.sort(np.exp(best[:-1])), float(np.exp(best[-1]))
    basis = shaping_basis(corners, damping, grid, rate_hz)
    return StrengthShaping(corners, damping, np.array([goal.fitted(basis, _ROUNDS)[0] for goal in goals]), FOLLOW_S)


def distance_db(contours: Contours, strength_db_sl: float, frequency_hz: FloatArray) -> FloatArray:
    """Return how far the contour of a strength level lies from that level, dB, (n,)."""
    return contours.level_db_sl_at(strength_db_sl, frequency_hz) - strength_db_sl


def shaping_error_db(
    shaping: StrengthShaping, strength_db_sl: float, contours: Contours, frequency_hz: FloatArray, rate_hz: float
) -> FloatArray:
    """Return by how much a steady tone's reshaped level is off the contour's, dB, (n,)."""
    answer = db(np.abs(shaping.response(strength_db_sl, frequency_hz, rate_hz)))
    return np.asarray(answer - distance_db(contours, strength_db_sl, frequency_hz))


def furthest(errors: Sequence[FloatArray]) -> FloatArray:
    """Return of several errors (n,) the one furthest from zero at each place."""
    whole = np.array(errors)
    return np.asarray(np.take_along_axis(whole, np.argmax(np.abs(whole), axis=0)[None], axis=0)[0])


@dataclass(frozen=True, eq=False)
class _Goal:
    """What the response of one level is to be on a grid: size, with the minimum phase (n,), and where it counts."""

    size: FloatArray
    phase: FloatArray
    inside: NDArray[np.bool_]

    @classmethod
    def of(
        cls, contours: Contours, level: float, grid_hz: FloatArray, band_hz: tuple[float, float], rate_hz: float
    ) -> _Goal:
        # lines every 3 Hz at 48 kHz: a phase from a magnitude (Hilbert) needs them dense
        whole = np.linspace(0.0, 0.5 * rate_hz, (1 << 14) // 2 + 1)
        phase = np.interp(grid_hz, whole, _minimum_phase(distance_db(contours, level, whole)))
        inside = (grid_hz >= band_hz[0]) & (grid_hz <= band_hz[1])
        return cls(from_db(distance_db(contours, level, grid_hz)), phase, inside)

    def fitted(self, basis: ComplexArray, rounds: int) -> tuple[FloatArray, float]:
        """Return the gains (columns of the basis,), and the greatest error over the band, dB."""
        weight, phase = np.where(self.inside, 1.0, _OUTSIDE_WEIGHT) / self.size, self.phase
        gains, least = np.zeros(basis.shape[1]), np.inf
        for _ in range(rounds):
            rows, wanted = basis * weight[:, None], self.size * weight * np.exp(1j * phase)
            square = np.real(rows.conj().T @ rows)
            ridge = _RIDGE * np.trace(square) * np.eye(len(square))
            solved = np.linalg.solve(square + ridge, np.real(rows.conj().T @ wanted))
            answer = basis @ solved
            error = np.abs(db(np.abs(answer) / self.size))
            most = float(np.max(error[self.inside]))
            if most < least:
                gains, least = solved, most
            if most < _EXACT_DB:
                break
            phase = np.angle(answer)
            weight = weight * np.where(self.inside, (1.0 + error / most) ** _SHARPER, 1.0)
        return gains, least


def _minimum_phase(level_db: FloatArray) -> FloatArray:
    """Return the minimum phase (radians) of a level on equally spaced frequencies from 0 to half the rate, by its
    cepstrum (Oppenheim & Schafer, Discrete-Time Signal Processing, chapter 12)."""
    logs = np.log(10.0) / 20.0 * level_db
    cepstrum = np.fft.irfft(logs)
    half = cepstrum.size // 2
    folded = np.zeros_like(cepstrum)
    folded[0], folded[1:half], folded[half] = cepstrum[0], 2.0 * cepstrum[1:half], cepstrum[half]
    return np.asarray(np.fft.rfft(folded).imag)
