"""Thresholds from stored runs: the procedure's own number, the Bayesian refit, and what to beware of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.diagnosis import diagnose
from tactuator.experiment.procedure.procedure import Procedure
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.procedure.whole_curve import WholeCurve
from tactuator.experiment.store.stored_runs import StoredRun
from tactuator.experiment.trial.delivered_level import delivered_offset_db

_CURVE_POINTS = 12
_NEAR_DECADES, _NEAR_DB = 0.2, 12.0


@dataclass(frozen=True)
class Threshold:
    """One threshold of one subject.

    own_db_sl, own_standard_error_db: as the procedure states it, commanded level (None where it states none).
    refit_*: posterior median, standard deviation and 95 % interval, commanded level. delivered_db: what the sensor saw
    above the commanded level near threshold. level_db_re_1um: the refit as displacement, delivered; own_level_db_re_1um
    likewise. flags: floor, ceiling, trial-limit, drift, lapses, saturated.
    """

    subject: str
    group: str
    finger: str
    frequency_hz: float
    procedure: str
    run: int
    trials: int
    own_db_sl: float | None
    own_standard_error_db: float | None
    refit_db_sl: float
    refit_sd_db: float
    refit_low_db_sl: float
    refit_high_db_sl: float
    delivered_db: float
    own_level_db_re_1um: float | None
    level_db_re_1um: float
    curve: str
    flags: tuple[str, ...]


def thresholds(runs: Sequence[StoredRun]) -> list[Threshold]:
    """Thresholds of every run; of a whole-curve run, one at each of twelve frequencies over its band."""
    found: list[Threshold] = []
    for run in runs:
        procedure = replayed(run)
        found += _whole_curve(run, procedure) if isinstance(procedure, WholeCurve) else [_one(run, procedure)]
    return found


def replayed(run: StoredRun) -> Procedure:
    """The run's procedure after its last trial."""
    procedure = run.protocol.procedure.build(run.protocol.forced_choice(), (run.run.band_low_hz, run.run.band_high_hz))
    for outcome in run.correct:
        procedure.record(bool(outcome))
    return procedure


def _one(run: StoredRun, procedure: Procedure) -> Threshold:
    prior = RefitPrior(guess=run.protocol.forced_choice().guess)
    fitted = refit(run.levels_db_sl, run.correct, prior)
    level, base = float(fitted.threshold_db[0]), float(run.curve_level_db_re_1um[0])
    delivered = delivered_offset_db(run.intervals, level)
    shift = 0.0 if np.isnan(delivered) else delivered
    own = procedure.estimate()
    flags = [*procedure.flags, *diagnose(run.levels_db_sl, run.correct, fitted, prior)]
    if any(one.saturated for one in run.intervals):
        flags.append("saturated")
    if np.isnan(delivered):
        flags.append("delivered-unknown")
    return Threshold(
        run.session.subject_code,
        run.session.subject_group,
        run.run.finger,
        float(run.run.frequency_hz),
        run.run.procedure,
        run.run.id,
        run.correct.size,
        None if own is None else own.level_db_sl,
        None if own is None else own.standard_error_db,
        level,
        float(fitted.sd_db[0]),
        float(fitted.low_db[0]),
        float(fitted.high_db[0]),
        delivered,
        None if own is None else base + shift + own.level_db_sl,
        base + shift + level,
        run.run.curve,
        tuple(flags),
    )


def _whole_curve(run: StoredRun, procedure: WholeCurve) -> list[Threshold]:
    band = procedure.rule.prior.band_hz
    frequency_hz = CurvePrior(band, points=_CURVE_POINTS).frequency_hz
    mean, sd = procedure.curve(frequency_hz)
    order = np.argsort(run.frequency_hz, kind="stable")
    base = np.interp(np.log(frequency_hz), np.log(run.frequency_hz[order]), run.curve_level_db_re_1um[order])
    shifts = [
        _delivered_near(run, float(frequency), float(level))
        for frequency, level in zip(frequency_hz, mean, strict=True)
    ]
    return [
        Threshold(
            run.session.subject_code,
            run.session.subject_group,
            run.run.finger,
            float(frequency),
            run.run.procedure,
            run.run.id,
            run.correct.size,
            None,
            None,
            float(level),
            float(error),
            float(level - 1.96 * error),
            float(level + 1.96 * error),
            shift,
            None,
            float(zero + level + (0.0 if np.isnan(shift) else shift)),
            run.run.curve,
            procedure.flags,
        )
        for frequency, level, error, zero, shift in zip(frequency_hz, mean, sd, base, shifts, strict=True)
    ]


def _delivered_near(run: StoredRun, frequency_hz: float, level_db_sl: float) -> float:
    """What was delivered in trials within a fifth of a decade of the frequency."""
    each = len(run.intervals) // run.correct.size
    near = np.flatnonzero(np.abs(np.log10(run.frequency_hz / frequency_hz)) <= _NEAR_DECADES)
    intervals = [one for trial in near for one in run.intervals[trial * each : (trial + 1) * each]]
    return delivered_offset_db(intervals, level_db_sl, near_db=_NEAR_DB)
