"""What was played in a stored run, and what of it a reader must know: hum, catch trials, the level delivered.

The delivered level is that at the sensor relative to the commanded one. Friction makes a display's gain depend on the
level: it is estimated from stimuli near threshold, and from louder ones, which a sensor sees far better, as long as
they agree with those that are nearer (the rule of Lepski 1990, "On a problem of adaptive estimation in Gaussian white
noise", Theory of Probability and its Applications 35). Below FRICTION_HZ, where friction is strongest, loud ones never
do.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.store.stored_runs import PROGRAMS, StoredIntervals, StoredRun
from tactuator.experiment.trial import Timing
from tactuator.signals.decibels import from_db
from tactuator.signals.spectra import nearest_mains

_LAPSE_RATE = 0.03
_FALSE_ALARM_RATE = 0.02
"""A run is flagged where the errors in loud trials have a probability below _FALSE_ALARM_RATE at a lapse rate of
_LAPSE_RATE, or the right answers in blank ones have a probability below _FALSE_ALARM_RATE by chance."""


def inattentive(missed: int, loud: int) -> bool:
    """Return whether more of the loud trials were missed than a lapse rate of 3 % explains."""
    return bool(loud and scipy.stats.binom.sf(missed - 1, loud, _LAPSE_RATE) < _FALSE_ALARM_RATE)


def attention(run: StoredRun) -> tuple[str, ...]:
    """Return the flags of the catch trials.

    `attention` means too many errors in loud trials, or, of one interval, in blank ones; `cue` for too many right
    answers where nothing was played.
    """
    kinds = run.catch_kinds
    loud, blank = run.correct[kinds == "loud"], run.correct[kinds == "blank"]
    flags = []
    if inattentive(int(np.count_nonzero(~loud)), loud.size):
        flags.append("attention")
    paradigm = run.protocol.paradigm
    surprising = np.count_nonzero(~blank if paradigm.yes_no else blank)  # of one interval, who says yes to nothing
    if blank.size and scipy.stats.binom.sf(surprising - 1, blank.size, paradigm.guess) < _FALSE_ALARM_RATE:
        flags.append("attention" if paradigm.yes_no else "cue")
    return tuple(dict.fromkeys(flags))


FRICTION_HZ = 25.0
_NEAR_THRESHOLD_DB = 4.0
_WIDTHS_DB = (2.0, 4.0, 8.0, 12.0, np.inf)
_APART_SD, _LARGEST_SD_DB = 3.0, 3.0


@dataclass(frozen=True)
class DeliveredLevel:
    """Gain of the display in each of several runs, arrays (runs,).

    offset_db: level at the sensor above the commanded level. sd_db: its standard deviation. NaN where noise hides it.
    """

    offset_db: FloatArray
    sd_db: FloatArray


def delivered_levels(
    commanded_db_sl: Sequence[FloatArray],
    measured_db_sl: Sequence[FloatArray],
    frequency_hz: FloatArray,
    level_db_sl: FloatArray,
    near_db: float = _NEAR_THRESHOLD_DB,
) -> DeliveredLevel:
    """Estimate the display's gain in each run, at its frequency, from intervals played there.

    commanded_db_sl (NaN in blank intervals), measured_db_sl: (intervals,) of each run. frequency_hz, level_db_sl (the
    threshold): (runs,). near_db: how near to it a stimulus must be below FRICTION_HZ. The power at the sensor is
    g^2 c + b (c: commanded; b: hum and noise, from the blank intervals) with the variance b^2 + 2 g^2 c b of a sinusoid
    in noise; g^2 is its weighted least-squares estimate. Where the powers scatter more than that, the standard
    deviation grows with them.
    """
    runs = frequency_hz.size
    run = np.repeat(np.arange(runs), [each.size for each in commanded_db_sl])
    commanded, measured = np.concatenate(commanded_db_sl), np.concatenate(measured_db_sl)
    known = np.isfinite(measured)
    blank, played = known & np.isnan(commanded), known & np.isfinite(commanded)
    hum = _Hum.of(_Sums(run[blank], runs), from_db(measured[blank]) ** 2)
    run, signal, seen = run[played], from_db(commanded[played]) ** 2, from_db(measured[played]) ** 2
    away_db = np.abs(commanded[played] - level_db_sl[run])
    widest_db = np.where(frequency_hz < FRICTION_HZ, near_db, np.inf)
    best, nearer = DeliveredLevel(np.full(runs, np.nan), np.full(runs, np.nan)), list[DeliveredLevel]()
    used, agree = np.zeros(runs, dtype=np.intp), np.ones(runs, dtype=bool)
    for width_db in _WIDTHS_DB:
        within = away_db <= np.minimum(width_db, widest_db)[run]
        count = np.bincount(run[within], minlength=runs)
        more = agree & (count != used)  # else there are no other stimuli than those of the width before
        within, used = within & more[run], count
        level = _level(_Sums(run[within], runs), signal[within], seen[within], hum)
        for each in nearer:
            agree &= ~(np.abs(level.offset_db - each.offset_db) > _APART_SD * each.sd_db)
        kept = more & agree & np.isfinite(level.sd_db)
        nearer.append(DeliveredLevel(np.where(kept, level.offset_db, np.nan), np.where(kept, level.sd_db, np.nan)))
        best = DeliveredLevel(np.where(kept, level.offset_db, best.offset_db), np.where(kept, level.sd_db, best.sd_db))
    return best


class _Sums:
    """Sums over the intervals of each run. run: that of each interval, (intervals,)."""

    def __init__(self, run: NDArray[np.intp], runs: int) -> None:
        self.run, self.runs = run, runs
        self.count = np.bincount(run, minlength=runs)

    def __call__(self, values: FloatArray) -> FloatArray:
        return np.bincount(self.run, values, self.runs).astype(np.float64)


@dataclass(frozen=True)
class _Hum:
    """Mean power of the blank intervals of each run and its standard error, (runs,)."""

    power: FloatArray
    power_sd: FloatArray

    @classmethod
    def of(cls, sums: _Sums, powers: FloatArray) -> "_Hum":
        count = np.maximum(sums.count, 1)
        mean = sums(powers) / count
        return cls(mean, np.sqrt(sums((powers - mean[sums.run]) ** 2)) / count)


def _level(sums: _Sums, signal: FloatArray, seen: FloatArray, hum: _Hum) -> DeliveredLevel:
    """Return the level delivered in each run by powers commanded and seen (n,), beside those of blank intervals."""
    run, base, squared = sums.run, hum.power[sums.run], signal**2
    seen = seen - base
    with np.errstate(divide="ignore", invalid="ignore"):  # a run without any interval has no level
        gain = np.maximum(sums(seen) / sums(signal), 1e-3)
        for _ in range(3):
            weight = 1.0 / (base**2 + 2.0 * gain[run] * signal * base + 1e-6 * (gain[run] * signal) ** 2)
            information = sums(weight * squared)
            gain = np.maximum(sums(weight * signal * seen) / information, 1e-9)
        scatter = 1.0 / information + (hum.power_sd * sums(weight * signal) / information) ** 2
        excess = sums(weight * (seen - gain[run] * signal) ** 2) / np.maximum(sums.count - 1, 1)
        sd_db = 10.0 / np.log(10.0) * np.sqrt(scatter * np.maximum(excess, 1.0)) / gain
        known = sd_db <= _LARGEST_SD_DB
        return DeliveredLevel(np.where(known, 10.0 * np.log10(gain), np.nan), np.where(known, sd_db, np.nan))


_MAINS_HZ = (50.0, 60.0)
_FELT_RE_THRESHOLD_DB = -10.0
_STEADY_VARIATION_MAX = 0.5
"""Largest standard deviation over mean of a hum's power from interval to interval; that of noise is 1."""


def hum_is_felt(
    seen: Sequence[StoredIntervals], frequency_hz: FloatArray, timing: Timing, threshold_db_sl: FloatArray
) -> NDArray[np.bool_]:
    """Return whether hum was felt with the stimulus of each run, (runs,).

    That is a line of 50 or 60 Hz mains within the bandwidth of the stimulus, and blank intervals with a steady tenth or
    more of the power of a stimulus at threshold.
    """
    away = np.min([np.abs(frequency_hz - nearest_mains(frequency_hz, mains)) for mains in _MAINS_HZ], axis=0)
    felt = np.asarray(away < [timing.clearance_hz(hertz) for hertz in frequency_hz.tolist()])
    for run in np.flatnonzero(felt).tolist():
        felt[run] = _is_steady(seen[run], threshold_db_sl[run] + _FELT_RE_THRESHOLD_DB)
    return felt


def _is_steady(seen: StoredIntervals, least_db_sl: float) -> bool:
    """Return whether blank intervals have a steady power of a level or more; it is not known without any."""
    blank = seen.measured_db_sl[np.isnan(seen.commanded_db_sl) & np.isfinite(seen.measured_db_sl)]
    if blank.size == 0:
        return True
    powers = from_db(blank) ** 2
    power = float(np.mean(powers))
    steady = float(np.std(powers)) < _STEADY_VARIATION_MAX * power
    return steady and bool(10.0 * np.log10(max(power, 1e-30)) >= least_db_sl)


def was_simulated(group: str, run: Any) -> bool:
    """Return whether nobody felt a run: the subject (of that group) or the display of the run's row was simulated."""
    return group == "simulated" or run.respondent in PROGRAMS or bool(run.rig_simulated)
