"""Thresholds from stored runs: the procedure's own number, the Bayesian refit, and the flags of the run."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_prior import CurveReading
from tactuator.experiment.procedure.procedure import Playable, Procedure
from tactuator.experiment.procedure.refit import ALIKE_DB, Refit, RefitPrior, refit
from tactuator.experiment.procedure.run_flags import RunFlags, UnseenNotch, run_flags, unseen_notch
from tactuator.experiment.procedure.whole_curve import CurveFlags, Trials, WholeCurve, WholeCurveRule, curve_flags
from tactuator.experiment.result.played import (
    DeliveredLevel,
    attention,
    catch_kinds,
    delivered_level,
    hum_is_felt,
    was_simulated,
)
from tactuator.experiment.store.stored_runs import StoredRun
from tactuator.table import brief


@dataclass(frozen=True)
class CurveRun:
    """The curve of a whole-curve run at every frequency at which trials may be put.

    curve: dB SL, (points,) each. flags: of the run. notch: where the trials cannot exclude a notch.
    """

    frequency_hz: FloatArray
    curve: CurveReading
    flags: CurveFlags
    notch: UnseenNotch


def curve_run(
    rule: WholeCurveRule, frequency_hz: FloatArray, levels_db_sl: FloatArray, correct: NDArray[np.bool_]
) -> CurveRun:
    """Return the curve after trials, each array (trials,), as they were played, whatever placed them."""
    run = WholeCurve(rule)
    points = np.argmin(np.abs(np.log(frequency_hz[:, None] / rule.prior.frequency_hz)), axis=1)
    for point, level, right in zip(points, levels_db_sl, correct, strict=True):
        run.belief.learn(np.array([point]), np.array([level]), np.array([right]))
    run.belief.refine()
    flags = curve_flags(run.belief, Trials(points[None, :], levels_db_sl[None, :], correct[None, :]))
    at = rule.prior.frequency_hz
    return CurveRun(at, run.curve(at), flags, unseen_notch(run.belief))


DOUBTFUL = frozenset({"attention", "chance", "drift", "lapses", "mains", "trial-limit"})
"""Flags that make a threshold doubtful. The experimenter decides: a curve is told with and without such thresholds."""

_RUNS_AT_ONCE = 1024
"""Runs whose trials are played through anew before any of them is let go: a million trials would take up 100 MB."""
_NEAR_DECADES, _NEAR_DB = 0.2, 12.0
_NORMAL_95 = 1.959964
_MAINS_HZ = (60.0, 50.0, 0.0)
"""Mains frequencies that a whole curve may have kept clear of; the frequencies that were played tell which."""
_SAME_FREQUENCY = 1e-6


@dataclass(frozen=True)
class MeasuredThreshold:
    """One threshold of one subject: what a field means stands in THRESHOLD_COLUMNS of the exports' dictionary.

    None, NaN or an infinite end stands where the export's cell is empty. flags: floor, ceiling, trial-limit, chance,
    attention, cue, lapses, drift, mains, out-of-range, saturated, delivered-unknown. simulated: True where nobody felt
    the stimuli. study_number: that of the study in the store; a code is a person's in one study.
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
    """Return what to call each person, by study and code: the code, or `CODE-STUDY` where several studies have it."""
    each = sorted({(threshold.study_number, threshold.subject) for threshold in measured})
    codes = Counter(code for _, code in each)
    return {(study, code): code if codes[code] == 1 else f"{code}-{study}" for study, code in each}


def thresholds(runs: Sequence[StoredRun]) -> list[MeasuredThreshold]:
    """Return the thresholds of every run; of a whole-curve run, one at each of its frequencies."""
    parts = (runs[first : first + _RUNS_AT_ONCE] for first in range(0, len(runs), _RUNS_AT_ONCE))
    return [threshold for part in parts for threshold in _thresholds(part)]


def _thresholds(runs: Sequence[StoredRun]) -> list[MeasuredThreshold]:
    procedures = [replayed(run) for run in runs]
    fitted = _fitted(runs, procedures)
    measured: list[MeasuredThreshold] = []
    for index, (run, procedure) in enumerate(zip(runs, procedures, strict=True)):
        if isinstance(procedure, WholeCurve):
            measured += _whole_curve(run, procedure)
        else:
            measured.append(_one(run, procedure, *fitted[index]))
    return measured


def replayed(run: StoredRun) -> Procedure:
    """Return the run's procedure after its last trial.

    A whole curve is returned fresh, since the belief is computed from the trials as they were played.
    """
    procedure = _fresh(run, _MAINS_HZ[0])
    if isinstance(procedure, WholeCurve):
        return next(
            (fresh for fresh in (_fresh(run, mains_hz) for mains_hz in _MAINS_HZ) if _placed(fresh, run)), procedure
        )
    for outcome in run.correct[catch_kinds(run) == ""]:
        procedure.record(bool(outcome))
    return procedure


def _fresh(run: StoredRun, mains_hz: float) -> Procedure:
    """Return the run's procedure before its first trial, at a display with that mains frequency (0: none)."""
    clearance_hz = run.protocol.timing.clearance_hz(mains_hz or 100.0)
    return run.protocol.fresh_run(Playable((run.run.band_low_hz, run.run.band_high_hz), mains_hz, clearance_hz))


def _placed(procedure: Procedure, run: StoredRun) -> bool:
    assert isinstance(procedure, WholeCurve)
    points = np.log(procedure.rule.prior.frequency_hz)
    return bool(np.all(np.abs(np.log(run.frequency_hz)[:, None] - points).min(axis=1) < _SAME_FREQUENCY))


def refit_prior(guess: float, procedure: Procedure) -> RefitPrior:
    """Return the prior of the refit of a procedure's runs, at the point that the procedure's own number stands for."""
    return RefitPrior(guess=guess, target=round(procedure.point, 6))


def _fitted(runs: Sequence[StoredRun], procedures: Sequence[Procedure]) -> dict[int, tuple[Refit, RunFlags, int]]:
    """Return refit, flags and the row in them of every run at one frequency, by its index.

    Runs with the same prior are fitted together.
    """
    groups: dict[RefitPrior, list[int]] = {}
    for index, (run, procedure) in enumerate(zip(runs, procedures, strict=True)):
        if not isinstance(procedure, WholeCurve):
            prior = refit_prior(run.protocol.paradigm.guess, procedure)
            groups.setdefault(prior, []).append(index)
    fits = {}
    for prior, members in groups.items():
        kept = [catch_kinds(runs[index]) != "blank" for index in members]
        width = max(int(mask.sum()) for mask in kept)
        levels, correct = np.full((len(members), width), np.nan), np.zeros((len(members), width), dtype=np.bool_)
        for row, (index, mask) in enumerate(zip(members, kept, strict=True)):
            count = int(mask.sum())
            levels[row, :count] = runs[index].levels_db_sl[mask]
            correct[row, :count] = runs[index].correct[mask]
        fit = refit(levels, correct, prior)
        flags = run_flags(levels, correct, fit, prior)
        fits.update({index: (fit, flags, row) for row, index in enumerate(members)})
    return fits


@dataclass(frozen=True)
class _Level:
    """A threshold as commanded, held against the levels that were played; named as MeasuredThreshold has it."""

    refit_db_sl: float
    refit_sd_db: float
    refit_low_db_sl: float
    refit_high_db_sl: float
    bound: str

    @classmethod
    def censored(cls, played_db_sl: FloatArray, level: float, sd: float, low: float, high: float) -> "_Level":
        least, most = float(played_db_sl.min()), float(played_db_sl.max())
        bound = ">=" if level > most else "<=" if level < least else ""
        level = float(np.clip(level, least, most))
        low = -np.inf if bound == "<=" or low < least - ALIKE_DB else min(low, level)
        high = np.inf if bound == ">=" or high > most + ALIKE_DB else max(high, level)
        return cls(level, np.nan if bound else sd, low, high, bound)


def _one(run: StoredRun, procedure: Procedure, fit: Refit, flags: RunFlags, row: int) -> MeasuredThreshold:
    fitted = (fit.threshold_db[row], fit.sd_db[row], fit.low_db[row], fit.high_db[row])
    at = _Level.censored(run.levels_db_sl[catch_kinds(run) != "blank"], *(float(value) for value in fitted))
    seen, hertz = run.intervals, float(run.run.frequency_hz)
    gain = delivered_level(seen.commanded_db_sl, seen.measured_db_sl, hertz, at.refit_db_sl)
    names = [*procedure.flags, *flags.names(row), *attention(run)]
    if hum_is_felt(seen, hertz, run.protocol.timing, at.refit_db_sl):
        names.append("mains")
    power = (float(flags.lapse_power[row]), float(flags.drift.power[row]))
    return _threshold(run, procedure, hertz, at, gain, float(run.curve_level_db_re_1um[0]), names, power)


def _whole_curve(run: StoredRun, procedure: WholeCurve) -> list[MeasuredThreshold]:
    seen, placed = run.intervals, catch_kinds(run) != "blank"
    if not placed.any():
        raise BadInput(f"run {run.run.id} has no trial of its procedure", "a run with trials")
    trial = np.arange(seen.saturated.size) // max(seen.saturated.size // max(run.correct.size, 1), 1)
    levels, hertz = run.levels_db_sl[placed], run.frequency_hz[placed]
    curve = curve_run(procedure.rule, hertz, levels, run.correct[placed])
    order = np.argsort(run.frequency_hz, kind="stable")
    base = np.interp(np.log(curve.frequency_hz), np.log(run.frequency_hz[order]), run.curve_level_db_re_1um[order])
    names, power = [*curve.flags.names(), *attention(run)], (None, float(curve.flags.drift.power[0]))
    measured = []
    read = (curve.curve.mean, curve.curve.sd, curve.curve.low, curve.curve.high)
    for point, (hertz, zero, *figures) in enumerate(zip(curve.frequency_hz, base, *read, strict=True)):
        at = _Level.censored(levels, *(float(value) for value in figures))
        near = np.abs(np.log10(run.frequency_hz / hertz))[trial] <= _NEAR_DECADES
        commanded, sensed = seen.commanded_db_sl[near], seen.measured_db_sl[near]
        gain = delivered_level(commanded, sensed, float(hertz), at.refit_db_sl, _NEAR_DB)
        threshold = _threshold(run, procedure, float(hertz), at, gain, float(zero), names, power)
        measured.append(replace(threshold, notch_trials=int(curve.notch.trials[0, point])))
    return measured


def _threshold(
    run: StoredRun, procedure: Procedure, frequency_hz: float, at: _Level, gain: DeliveredLevel, base: float,
    names: Sequence[str], power: tuple[float | None, float | None],
) -> MeasuredThreshold:  # fmt: skip
    """Return a threshold with its displacement; base: level of 0 dB SL, names: flags beside those of the playing."""
    known, estimate = not np.isnan(gain.offset_db), procedure.estimate()
    playing = {
        "out-of-range": bool(at.bound),
        "saturated": run.intervals.saturated.any(),
        "delivered-unknown": not known,
    }
    shift, shift_sd = (gain.offset_db, gain.sd_db) if known else (0.0, 0.0)
    level, spare = base + shift + at.refit_db_sl, _NORMAL_95 * shift_sd
    return MeasuredThreshold(
        subject=run.session.subject_code,
        group=run.session.subject_group,
        finger=run.run.finger,
        frequency_hz=frequency_hz,
        procedure=run.run.procedure,
        run=run.run.id,
        trials=run.correct.size,
        point=procedure.point,
        own_db_sl=None if estimate is None else estimate.level_db_sl,
        own_standard_error_db=None if estimate is None else estimate.standard_error_db,
        **vars(at),
        delivered_db=gain.offset_db,
        delivered_sd_db=gain.sd_db,
        own_level_db_re_1um=None if estimate is None else base + shift + estimate.level_db_sl,
        level_db_re_1um=level,
        level_low_db_re_1um=level - float(np.hypot(at.refit_db_sl - at.refit_low_db_sl, spare)),
        level_high_db_re_1um=level + float(np.hypot(at.refit_high_db_sl - at.refit_db_sl, spare)),
        sd_db=float(np.hypot(at.refit_sd_db, shift_sd)),
        curve=run.run.curve,
        flags=tuple(sorted({*names, *(name for name, true in playing.items() if true)})),
        lapse_power=power[0],
        drift_power=power[1],
        simulated=was_simulated(run.session.subject_group, run.run),
        study_number=run.session.study_id,
    )
