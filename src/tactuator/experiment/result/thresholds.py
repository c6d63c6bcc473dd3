"""Thresholds from stored runs: the procedure's own number, the Bayesian refit, and the flags of the run."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.entry_points import plugin_fault
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Estimate, Playable
from tactuator.experiment.procedure.refit import ALIKE_DB, RefitPrior, refit
from tactuator.experiment.procedure.run_flags import run_flags
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.result.played import (
    DeliveredLevel,
    attention,
    delivered_levels,
    hum_is_felt,
    was_simulated,
)
from tactuator.experiment.store.stored_runs import NO_INTERVALS, RUNS_AT_ONCE, SATURATED, StoredRun, in_order, names_of
from tactuator.plain import brief

DOUBTFUL = frozenset({"attention", "chance", "drift", "lapses", "mains", "trial-limit"})
"""Flags that make a threshold doubtful. The experimenter decides: a curve is given with and without them."""

_NEAR_DECADES, _NEAR_DB = 0.2, 12.0
_NORMAL_95 = 1.959964
_MAINS_HZ = (60.0, 50.0, 0.0)
"""Mains frequencies that a whole curve may have kept clear of; the frequencies that were played show which."""
_SAME_FREQUENCY = 1e-6


@dataclass(frozen=True)
class MeasuredThreshold:
    """One threshold of one subject: THRESHOLD_COLUMNS of the exports' dictionary explains the fields.

    None, NaN or an infinite end: the export's cell is empty. flags: floor, ceiling, trial-limit, chance,
    attention, cue, lapses, drift, mains, out-of-range, saturated, delivered-unknown, void (the run, or trials of it).
    simulated: True where nobody felt the stimuli. study_number: that of the study in the store; a code is a
    person's in one study.
    """

    subject: str
    group: str
    finger: str
    frequency_hz: float
    procedure: str
    run: int
    trials: int
    point: float
    own_db_sl: float | None
    own_standard_error_db: float | None
    reversal_spread_db: float | None
    refit_db_sl: float
    refit_sd_db: float
    refit_low_db_sl: float
    refit_high_db_sl: float
    bound: str
    delivered_db: float
    delivered_sd_db: float
    own_level_db_re_1um: float | None
    level_db_re_1um: float
    level_low_db_re_1um: float
    level_high_db_re_1um: float
    sd_db: float
    curve: str
    flags: tuple[str, ...]
    lapse_power: float | None
    drift_power: float | None
    simulated: bool
    study_number: int = 1
    notch_trials: int | None = None

    __repr__ = brief


def names_of_people(measured: Sequence[MeasuredThreshold]) -> dict[tuple[int, str], str]:
    """Return what to call each person, by study and code, as names_of does."""
    return names_of((threshold.study_number, threshold.subject) for threshold in measured)


@dataclass(frozen=True, eq=False)
class Fitted:
    """Thresholds of runs, and what could not be refitted: each such run, with the reason."""

    thresholds: tuple[MeasuredThreshold, ...]
    refused: tuple[tuple[StoredRun, str], ...] = ()

    def require(self) -> "Fitted":
        """Raise BadInput where no run could be refitted."""
        if self.refused and not self.thresholds:
            run, reason = self.refused[0]
            raise BadInput(f"run {run.run.id} cannot be refitted: {reason}")
        return self


def fitted(runs: Sequence[StoredRun]) -> Fitted:
    """Return the thresholds of every run that can be refitted; of a whole-curve run, one at each of its frequencies.

    The runs of one protocol at one display are fitted together, apart from all others, so that a study's numbers are
    the same to the last bit whatever else is in its store.
    """
    alike: dict[tuple[int, float, float], list[int]] = {}
    for index, run in enumerate(runs):
        key = (run.run.protocol_version_id, run.run.band_low_hz, run.run.band_high_hz)
        alike.setdefault(key, []).append(index)
    found: dict[int, list[MeasuredThreshold] | str] = {}
    for members in alike.values():
        for first in range(0, len(members), RUNS_AT_ONCE):
            part = members[first : first + RUNS_AT_ONCE]
            found |= zip(part, _each_fitted([runs[index] for index in part]), strict=True)
    measured: list[MeasuredThreshold] = []
    refused = []
    for index, run in enumerate(runs):
        of_run = found[index]
        if isinstance(of_run, str):
            refused.append((run, of_run))
        else:
            measured += of_run
    return Fitted(tuple(measured), tuple(refused))


def fitted_parts(parts: Iterable[Sequence[StoredRun]]) -> tuple[tuple[StoredRun, ...], Fitted]:
    """Return the runs that have thresholds, in order, with those, read and fitted a part at a time.

    Of a run without catch trials the intervals are let go: of a million trials they would fill the memory.
    """
    runs, fits = list[StoredRun](), list[Fitted]()
    for part in parts:
        fits.append(fitted(part))
        refused_runs = {run.run.id for run, _ in fits[-1].refused}
        kept = [run for run in part if run.run.id not in refused_runs]
        runs += [run if np.count_nonzero(run.catch_kinds) else replace(run, intervals=NO_INTERVALS) for run in kept]
    runs.sort(key=in_order)
    place = {run.run.id: index for index, run in enumerate(runs)}
    measured = sorted((each for fit in fits for each in fit.thresholds), key=lambda each: place[each.run])
    refused = sorted((each for fit in fits for each in fit.refused), key=lambda each: in_order(each[0]))
    return tuple(runs), Fitted(tuple(measured), tuple(refused))


def thresholds(runs: Sequence[StoredRun]) -> list[MeasuredThreshold]:
    """Return the thresholds of the runs that can be refitted. Raises BadInput where none of them can."""
    return list(fitted(runs).require().thresholds)


def _each_fitted(runs: Sequence[StoredRun]) -> list[list[MeasuredThreshold] | str]:
    """Return the thresholds of each run, or why it has none; all are of one protocol at one display.

    Where one run cannot be refitted, the others are: halves of them are fitted, down to that run.
    """
    try:
        if runs[0].protocol.procedure.chooses_frequency:
            return [_whole_curve(run) for run in runs]
        return [*_at_one_frequency(runs)]
    except Exception as error:
        fault = None if isinstance(error, BadInput) else plugin_fault(error)
        if fault is None and not isinstance(error, ValueError | ArithmeticError | LookupError):
            raise
        if len(runs) == 1:
            return [str(fault or error)]
        middle = len(runs) // 2
        return [*_each_fitted(runs[:middle]), *_each_fitted(runs[middle:])]


def playable_in(run: StoredRun, mains_hz: float) -> Playable:
    """Return what could be played in a run, at a display with that mains frequency (0: none)."""
    clearance_hz = run.protocol.timing.clearance_hz(mains_hz or 100.0)
    return Playable((run.run.band_low_hz, run.run.band_high_hz), mains_hz, clearance_hz)


def refit_prior(protocol: Protocol) -> RefitPrior:
    """Return the prior of the refit of a protocol's runs, at the point to which the procedure's own number refers."""
    return RefitPrior(guess=protocol.paradigm.guess, target=round(protocol.procedure.point, 6))


def _padded(rows: Sequence[FloatArray]) -> FloatArray:
    """Return rows of several lengths as one array, NaN after the end of each."""
    together = np.full((len(rows), max(row.size for row in rows)), np.nan)
    for place, row in zip(together, rows, strict=True):
        place[: row.size] = row
    return together


def _at_one_frequency(runs: Sequence[StoredRun]) -> list[list[MeasuredThreshold]]:
    """Return the threshold of each run; all are of one protocol at one display."""
    protocol, kinds = runs[0].protocol, [run.catch_kinds for run in runs]
    hertz = np.array([run.run.frequency_hz for run in runs], dtype=np.float64)
    base = np.array([run.curve_level_db_re_1um[0] for run in runs])
    if np.isnan(hertz + base).any():
        raise BadInput("a run without its frequency, or without the curve's level there", "both")
    replayed = protocol.begin(playable_in(runs[0], _MAINS_HZ[0]), len(runs))
    own = _padded([run.correct[kind == ""].astype(np.float64) for run, kind in zip(runs, kinds, strict=True)])
    for outcomes in (own == 1.0).T:
        replayed.record(outcomes)
    kept = [kind != "blank" for kind in kinds]
    levels = _padded([run.levels_db_sl[mask] for run, mask in zip(runs, kept, strict=True)])
    correct = _padded([run.correct[mask].astype(np.float64) for run, mask in zip(runs, kept, strict=True)]) == 1.0
    prior = refit_prior(protocol)
    fit = refit(levels, correct, prior)
    flags = run_flags(levels, correct, fit, prior)
    found = (fit.threshold_db, fit.sd_db, fit.low_db, fit.high_db)
    at = _Levels.censored(np.nanmin(levels, axis=1), np.nanmax(levels, axis=1), *found)
    seen = [run.intervals for run in runs]
    gain = delivered_levels(
        [each.commanded_db_sl for each in seen], [each.measured_db_sl for each in seen], hertz, at.refit_db_sl
    )
    felt = hum_is_felt(seen, hertz, protocol.timing, at.refit_db_sl).tolist()
    power = zip(flags.lapse_power.tolist(), flags.drift.power.tolist(), strict=True)
    points = at.points(hertz, base, gain)
    measured = []
    for row, (run, point, of_run) in enumerate(zip(runs, points, power, strict=True)):
        estimate, own_flags = (replayed.estimate(row), replayed.flags(row)) if run.whole else (None, ())
        names = [*own_flags, *flags.names(row), *attention(run), *(["mains"] if felt[row] else [])]
        measured.append([_threshold(run, estimate, point, names, of_run)])
    return measured


def played_at(run: StoredRun) -> Playable:
    """Return what could be played in a run that chose its frequencies, by those that it chose."""
    every = [playable_in(run, mains_hz) for mains_hz in _MAINS_HZ]
    for playable in every:
        away = np.abs(np.log(run.frequency_hz[:, None] / run.protocol.procedure.places(playable))).min(axis=1)
        if np.all(away < _SAME_FREQUENCY):
            return playable
    return every[0]


@dataclass(frozen=True)
class _Levels:
    """Thresholds as commanded, (points,), held against the levels that were played; named as MeasuredThreshold has
    them.
    """

    refit_db_sl: FloatArray
    refit_sd_db: FloatArray
    refit_low_db_sl: FloatArray
    refit_high_db_sl: FloatArray
    bound: NDArray[np.str_]

    @classmethod
    def censored(
        cls, least: FloatArray, most: FloatArray, level: FloatArray, sd: FloatArray, low: FloatArray, high: FloatArray
    ) -> "_Levels":
        bound = np.where(level > most, ">=", np.where(level < least, "<=", ""))
        level = np.clip(level, least, most)
        low = np.where((bound == "<=") | (low < least - ALIKE_DB), -np.inf, np.minimum(low, level))
        high = np.where((bound == ">=") | (high > most + ALIKE_DB), np.inf, np.maximum(high, level))
        return cls(level, np.where(bound == "", sd, np.nan), low, high, bound)

    def points(self, frequency_hz: FloatArray, base: FloatArray, gain: DeliveredLevel) -> list[dict[str, Any]]:
        """Return the fields of each MeasuredThreshold that follow from its level, with the displacement.

        base: level of 0 dB SL at the sensor.
        """
        known = ~np.isnan(gain.offset_db)
        shift, shift_sd = np.where(known, gain.offset_db, 0.0), np.where(known, gain.sd_db, 0.0)
        level, spare = base + shift + self.refit_db_sl, _NORMAL_95 * shift_sd
        columns = {
            "frequency_hz": frequency_hz,
            **vars(self),
            "delivered_db": gain.offset_db,
            "delivered_sd_db": gain.sd_db,
            "level_db_re_1um": level,
            "level_low_db_re_1um": level - np.hypot(self.refit_db_sl - self.refit_low_db_sl, spare),
            "level_high_db_re_1um": level + np.hypot(self.refit_high_db_sl - self.refit_db_sl, spare),
            "sd_db": np.hypot(self.refit_sd_db, shift_sd),
        }
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        return [dict(zip(columns, row, strict=True)) for row in rows]


def _whole_curve(run: StoredRun) -> list[MeasuredThreshold]:
    seen, placed = run.intervals, run.catch_kinds != "blank"
    if not placed.any():
        raise BadInput(f"run {run.run.id} has no trial of its procedure", "a run with trials")
    trial = np.arange(seen.kind.size) // max(seen.kind.size // max(run.correct.size, 1), 1)
    levels, procedure = run.levels_db_sl[placed], run.protocol.procedure
    trials = run.frequency_hz[placed], levels, run.correct[placed]
    curve = procedure.curve(run.protocol.paradigm.guess, played_at(run), *trials)
    order = np.argsort(run.frequency_hz, kind="stable")
    base = np.interp(np.log(curve.frequency_hz), np.log(run.frequency_hz[order]), run.curve_level_db_re_1um[order])
    names, power = [*curve.flags, *attention(run)], (None, curve.drift_power)
    at = _Levels.censored(np.min(levels), np.max(levels), curve.mean, curve.sd, curve.low, curve.high)
    near = np.abs(np.log10(run.frequency_hz / curve.frequency_hz[:, None]))[:, trial] <= _NEAR_DECADES
    gain = delivered_levels(
        [seen.commanded_db_sl[of_point] for of_point in near],
        [seen.measured_db_sl[of_point] for of_point in near],
        curve.frequency_hz,
        at.refit_db_sl,
        _NEAR_DB,
    )
    points = zip(at.points(curve.frequency_hz, base, gain), curve.notch_trials.tolist(), strict=True)
    return [_threshold(run, None, point | {"notch_trials": notch}, names, power) for point, notch in points]


def _threshold(
    run: StoredRun, estimate: Estimate | None, point: dict[str, Any], names: Sequence[str],
    power: tuple[float | None, float | None],
) -> MeasuredThreshold:  # fmt: skip
    """Return a threshold; point: its fields as `_Levels.points` has them, names: flags beside those of the playing."""
    own_level = None if estimate is None else point["level_db_re_1um"] + estimate.level_db_sl - point["refit_db_sl"]
    playing = {
        "out-of-range": bool(point["bound"]),
        "saturated": np.bitwise_or.reduce(run.intervals.kind) & SATURATED,
        "delivered-unknown": isnan(point["delivered_db"]),
        "void": run.void,
    }
    return MeasuredThreshold(
        subject=run.session.subject_code,
        group=run.session.subject_group,
        finger=run.run.finger,
        procedure=run.run.procedure,
        run=run.run.id,
        trials=run.correct.size,
        point=run.protocol.procedure.point,
        own_db_sl=None if estimate is None else estimate.level_db_sl,
        own_standard_error_db=None if estimate is None else estimate.standard_error_db,
        reversal_spread_db=None if estimate is None else estimate.reversal_spread_db,
        own_level_db_re_1um=own_level,
        **point,
        curve=run.run.curve,
        flags=tuple(sorted({*names, *(name for name, true in playing.items() if true)})),
        lapse_power=power[0],
        drift_power=power[1],
        simulated=was_simulated(run.session.subject_group, run.run),
        study_number=run.session.study_id,
    )
