"""Results of a store: its thresholds, psychometric functions, the curve across subjects, and how it was measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import hypot, isnan
from os import PathLike
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.refit import Refit, RefitPrior, refit
from tactuator.experiment.result.group_level import BETWEEN, GroupLevel, group_level
from tactuator.experiment.result.thresholds import DOUBTFUL, MeasuredThreshold, fitted_parts, names_of_people
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import StoredRun, required_parts
from tactuator.io.csv_tables import resolve_curve
from tactuator.perception.curve import POINTS_MIN, Provenance, ThresholdCurve
from tactuator.perception.psychometric import Psychometric, Weibull
from tactuator.plain import brief

_MARGIN_DB = 3.0
_CURVE_STEP_DB = 2.0
"""Width of the classes of level into which the trials of a whole-curve run are put: hardly two are at the same level
above their curve."""


@dataclass(frozen=True, eq=False)
class PsychometricTrials:
    """Shares of right answers at levels, dB SL, and the psychometric function fitted to them.

    level_db_sl, share, count: (levels,). grid_db_sl, psi: the function, (n,). threshold: the refit with its 95 %
    interval; its own_db_sl is the procedure's number, where it has one. whole_curve: True where levels are not in dB SL
    but relative to the run's own curve at the frequency of each trial.
    """

    level_db_sl: FloatArray
    share: FloatArray
    count: NDArray[np.int64]
    grid_db_sl: FloatArray
    psi: FloatArray
    threshold: MeasuredThreshold
    whole_curve: bool = False


def psychometric_trials(
    runs: Sequence[StoredRun], measured: Sequence[MeasuredThreshold]
) -> Iterator[tuple[str, list[PsychometricTrials]]]:
    """Yield each subject's name with their runs; measured: one threshold of a run, or those of a whole curve."""
    by_run: dict[int, list[MeasuredThreshold]] = {}
    for threshold in measured:
        by_run.setdefault(threshold.run, []).append(threshold)
    people: dict[tuple[int, str], list[StoredRun]] = {}
    for run in runs:
        if run.run.id in by_run:
            people.setdefault((run.session.study_id, run.session.subject_code), []).append(run)
    names = names_of_people(measured)
    for person, each in people.items():
        yield names[person], [_psychometric(run, by_run[run.run.id]) for run in each]


def _psychometric(run: StoredRun, points: Sequence[MeasuredThreshold]) -> PsychometricTrials:
    return _of_curve(run, points) if run.protocol.procedure.chooses_frequency else _of_run(run, points[0])


def _of_run(run: StoredRun, threshold: MeasuredThreshold) -> PsychometricTrials:
    kept = run.catch_kinds != "blank"
    levels, correct = run.levels_db_sl[kept], run.correct[kept]
    guess = run.protocol.paradigm.guess
    fit = refit(levels, correct, RefitPrior(guess=guess, target=threshold.point))
    return _shares(np.round(levels, 3), correct, fit, guess, threshold)


def _of_curve(run: StoredRun, points: Sequence[MeasuredThreshold]) -> PsychometricTrials:
    """Return the trials of a whole-curve run by their level above its curve, which is linear between the points.

    A threshold of 0 dB says that the curve and one psychometric function explain all frequencies together.
    """
    kept = run.catch_kinds != "blank"
    mine = sorted(points, key=lambda point: point.frequency_hz)
    at, level = np.array([(np.log(point.frequency_hz), point.refit_db_sl) for point in mine]).T
    above, correct = run.levels_db_sl[kept] - np.interp(np.log(run.frequency_hz[kept]), at, level), run.correct[kept]
    guess, point = run.protocol.paradigm.guess, mine[0].point
    fit = refit(above, correct, RefitPrior(guess=guess, target=point))
    flags = tuple(sorted({flag for point in mine for flag in point.flags}))
    threshold = replace(
        mine[0], frequency_hz=float("nan"), refit_db_sl=float(fit.threshold_db[0]), refit_sd_db=float(fit.sd_db[0]),
        refit_low_db_sl=float(fit.low_db[0]), refit_high_db_sl=float(fit.high_db[0]), bound="", flags=flags,
    )  # fmt: skip
    classes = _CURVE_STEP_DB * np.round(above / _CURVE_STEP_DB) + 0.0  # no -0
    return replace(_shares(classes, correct, fit, guess, threshold), whole_curve=True)


def _shares(
    levels: FloatArray, correct: NDArray[np.bool_], fit: Refit, guess: float, threshold: MeasuredThreshold
) -> PsychometricTrials:
    distinct, place = np.unique(levels, return_inverse=True)
    count = np.bincount(place)
    share = np.bincount(place, weights=correct) / count
    grid = np.linspace(distinct[0] - _MARGIN_DB, distinct[-1] + _MARGIN_DB, 200)
    lapse = min(float(fit.lapse[0]), 0.99 * (1.0 - threshold.point))
    model = Psychometric(Weibull(float(fit.slope[0])), guess, lapse, threshold.point)
    return PsychometricTrials(
        distinct, share, count, grid, model.probability(grid - float(fit.threshold_db[0])), threshold
    )


CIRCUMSTANCES = (
    "subject_group",
    "experimenter",
    "site",
    "surround",
    "contact_area_mm2",
    "skin_temperature_c",
    "preload_n",
    "masking_sound",
    "masking_level_db_spl",
)
"""Columns of a session that a curve's file has."""
COUNTED = ("subjects", "censored", "bound", "unknown")
"""What a curve's file and a document say of each point of a GroupCurve."""


@dataclass(frozen=True)
class GroupCurve:
    """The mean threshold curve of a group, and the subjects behind it.

    subjects, censored: number of people at each point, and of those among them whose threshold lies beyond what was
    played (0: extended to the band's edge, not measured). bound: of each point, ">=" or "<=" where it is known from
    one side alone. left_out: thresholds that were not taken in. unknown: number of people at each point who lie beyond
    on both sides and are not counted. Frequencies at which the mean is not known from either side have no point.
    """

    curve: ThresholdCurve
    subjects: tuple[int, ...]
    censored: tuple[int, ...]
    bound: tuple[str, ...]
    left_out: tuple[MeasuredThreshold, ...] = ()
    unknown: tuple[int, ...] = ()


def group_curve(
    measured: Sequence[MeasuredThreshold],
    reference: ThresholdCurve,
    band_hz: tuple[float, float],
    leave_out: Sequence[str] = (),
) -> GroupCurve:
    """Return the mean refitted threshold at each frequency, a subject's fingers and repeats averaged first.

    leave_out: names of people who are not taken in; FLAGGED: every threshold with a flag of DOUBTFUL. People whose
    threshold lies beyond what was played are taken in as that (`group_level`). The standard error is that of the mean
    between subjects, and not below what the single thresholds are known to. Beyond the measured frequencies the curve
    keeps its distance from `reference` up to the band's edges: a design needs the whole band. The provenance is
    `simulated` where any threshold is. Raises BadInput where fewer than three frequencies are left, and for people who
    are not there.
    """
    kept, left_out = _parted(measured, leave_out)
    levels = group_levels(kept)
    open_hz = [hertz for hertz, row in levels.items() if row.bound == BETWEEN]
    rows = [row for row in levels.values() if row.bound != BETWEEN]
    frequency_hz = np.array([hertz for hertz, row in levels.items() if row.bound != BETWEEN])
    if frequency_hz.size < POINTS_MIN:
        without = f", {len(left_out)} thresholds left out" if left_out else ""
        without += f", {len(open_hz)} known from neither side" if open_hz else ""
        raise BadInput(f"a curve of {frequency_hz.size} measured frequencies{without}", "three or more")
    kept = [each for each in kept if levels[each.frequency_hz].bound != BETWEEN]
    level = np.array([row.level_db for row in rows])
    error = np.array([0.0 if row.bound else row.standard_error_db for row in rows])
    counts = [(row.people, row.censored, row.bound, row.unknown) for row in rows]
    for edge, end in ((band_hz[0], 0), (band_hz[1], -1)):
        if (edge < frequency_hz[0]) if end == 0 else (edge > frequency_hz[-1]):
            distance = level[end] - float(reference.level_db_re_1um_at(frequency_hz[end]))
            place = 0 if end == 0 else level.size
            level = np.insert(level, place, float(reference.level_db_re_1um_at(edge)) + distance)
            error = np.insert(error, place, error[end])
            frequency_hz = np.insert(frequency_hz, place, edge)
            counts.insert(place, (0, 0, counts[end][2], 0))
    simulated = any(threshold.simulated for threshold in kept)
    subjects, censored, bound, unknown = zip(*counts, strict=True)
    without = f"; not known from either side at {', '.join(f'{hertz:g}' for hertz in open_hz)} Hz" if open_hz else ""
    curve = _curve(frequency_hz, level, error, kept, reference, simulated, without)
    curve = replace(curve, bound=bound if any(bound) else None)
    return GroupCurve(curve, subjects, censored, bound, tuple(left_out), unknown)


FLAGGED = "flagged"
"""Name for all doubtful thresholds, to leave them out."""


def _parted(
    measured: Sequence[MeasuredThreshold], leave_out: Sequence[str]
) -> tuple[list[MeasuredThreshold], list[MeasuredThreshold]]:
    names = names_of_people(measured)
    strangers = sorted(set(leave_out) - {FLAGGED, *names.values()})
    if strangers:
        raise BadInput(f"leaving out {', '.join(strangers)}", f"{FLAGGED}, {', '.join(names.values())}")
    kept: list[MeasuredThreshold] = []
    left_out: list[MeasuredThreshold] = []
    for threshold in measured:
        named = names[threshold.study_number, threshold.subject] in leave_out
        (left_out if named or (FLAGGED in leave_out and is_doubtful(threshold)) else kept).append(threshold)
    return kept, left_out


def is_doubtful(threshold: MeasuredThreshold) -> bool:
    """Return whether the threshold has a flag of DOUBTFUL."""
    return bool(DOUBTFUL & set(threshold.flags))


def _curve(
    frequency_hz: FloatArray, level: FloatArray, error: FloatArray, kept: Sequence[MeasuredThreshold],
    reference: ThresholdCurve, simulated: bool, unknown: str,
) -> ThresholdCurve:  # fmt: skip
    subjects = len({(threshold.study_number, threshold.subject) for threshold in kept})
    who = "simulated, nobody felt it: " if simulated else ""
    source = (
        f"{who}mean of {subjects} subjects on the display, each point at {100.0 * kept[0].point:.1f} % correct; "
        f"ends beyond the measured frequencies follow {reference.name}{unknown}"
    )
    provenance: Provenance = "simulated" if simulated else "measured"
    return ThresholdCurve(provenance, frequency_hz, level, provenance, source, error)


def group_levels(measured: Sequence[MeasuredThreshold]) -> dict[float, GroupLevel]:
    """Return the mean level of the people at each frequency, in order."""
    by_frequency: dict[float, list[MeasuredThreshold]] = {}
    for threshold in sorted(measured, key=lambda each: each.frequency_hz):
        by_frequency.setdefault(threshold.frequency_hz, []).append(threshold)
    return {hertz: _mean(mine) for hertz, mine in by_frequency.items()}


def _mean(measured: Sequence[MeasuredThreshold]) -> GroupLevel:
    """Return the mean at one frequency. The mean of a subject's thresholds is a bound where one of them is."""
    of_subject: dict[tuple[int, str], list[MeasuredThreshold]] = {}
    for threshold in measured:
        of_subject.setdefault((threshold.study_number, threshold.subject), []).append(threshold)
    each = [of_subject[subject] for subject in sorted(of_subject)]
    levels = np.array([fmean(threshold.level_db_re_1um for threshold in mine) for mine in each])
    known = [[threshold.sd_db for threshold in mine if not isnan(threshold.sd_db)] for mine in each]
    within = np.array([hypot(*sd_db) / len(mine) for sd_db, mine in zip(known, each, strict=True)])
    sides = [{threshold.bound for threshold in mine} - {""} for mine in each]
    row = group_level(levels, within, [BETWEEN if len(side) > 1 else "".join(side) for side in sides])
    if row.bound != BETWEEN:
        return row
    played = [threshold.level_db_re_1um for threshold in measured]
    return replace(row, low_db=min(played), high_db=max(played))


def circumstances(group: GroupCurve, runs: Sequence[StoredRun]) -> dict[str, Sequence[object]]:
    """Return the columns that say how a group's curve was measured, one cell for each of its points.

    A circumstance that differed between the sessions has its values joined by `;`; an unknown one is empty.
    """
    shared = {name: _joined([getattr(run.session, name) for run in runs]) for name in CIRCUMSTANCES}
    shared["finger"] = _joined([run.run.finger for run in runs])
    shared["controller_sha256"] = _joined([run.run.controller_sha256 for run in runs])
    points = len(group.subjects)
    counted = {name: getattr(group, name) for name in COUNTED}
    return {**counted, **{name: [value] * points for name, value in shared.items()}}


def _joined(values: Sequence[object]) -> str:
    return ";".join(sorted({str(value) for value in values if value is not None and value != ""}))


@dataclass(frozen=True, eq=False)
class PersonThresholds:
    """One person's thresholds: level (dB re 1 um peak) and standard error at frequency_hz, all of shape (n,).

    flagged: True at each doubtful threshold, None where runs have no flags. bound: of each, None: they have none.
    simulated: True where nobody felt the stimuli.
    """

    name: str
    frequency_hz: FloatArray
    level_db_re_1um: FloatArray
    standard_error_db: FloatArray
    flagged: NDArray[np.bool_] | None = None
    bound: tuple[str, ...] | None = None
    simulated: bool = False


def person_thresholds(thresholds: Sequence[MeasuredThreshold]) -> tuple[PersonThresholds, ...]:
    """Return each subject's thresholds by frequency; every finger and repeat is a point."""
    each: dict[tuple[int, str], list[MeasuredThreshold]] = {}
    for threshold in sorted(thresholds, key=lambda threshold: threshold.frequency_hz):
        each.setdefault((threshold.study_number, threshold.subject), []).append(threshold)
    people = []
    for person, name in names_of_people(thresholds).items():
        mine = each[person]
        hertz, level, error = np.array([(point.frequency_hz, point.level_db_re_1um, point.sd_db) for point in mine]).T
        flagged, simulated = np.array([is_doubtful(point) for point in mine]), any(point.simulated for point in mine)
        bounds = tuple(point.bound for point in mine)
        people.append(PersonThresholds(name, hertz, level, error, flagged, bounds, simulated))
    return tuple(people)


@dataclass(frozen=True, eq=False)
class StoreResults:
    """Thresholds of a store's finished runs, and the curve across its subjects.

    runs: what the thresholds were taken from. reference: the curve that 0 dB SL stood for. group: the curve across
    subjects, with who is behind it and what was left out. no_curve: the reason, if group is None. beside:
    where there are doubtful thresholds, the same curve without them, or with them where they were left out (None: there
    is none); beside_is says which. not_refitted: runs that have no threshold, each with the reason.
    not_known: frequencies (Hz) at which the mean is not known from either side.
    """

    runs: tuple[StoredRun, ...]
    reference: ThresholdCurve
    thresholds: tuple[MeasuredThreshold, ...]
    group: GroupCurve | None
    no_curve: BadInput | None
    beside: GroupCurve | None = None
    beside_is: str = ""
    not_refitted: tuple[tuple[StoredRun, str], ...] = ()
    not_known: Mapping[float, GroupLevel] = field(default_factory=dict)

    __repr__ = brief

    @cached_property
    def people(self) -> tuple[PersonThresholds, ...]:
        """Return each subject's thresholds."""
        return person_thresholds(self.thresholds)

    def psychometric(self) -> Iterator[tuple[str, list[PsychometricTrials]]]:
        """Yield each subject's name with the answers of every run by level, and the function fitted to them."""
        return psychometric_trials(self.runs, self.thresholds)

    @property
    def circumstances(self) -> dict[str, Sequence[object]]:
        """Return the columns of the curve's file that say how it was measured; empty without a curve."""
        if self.group is None:
            return {}
        taken = {each.run for each in self.thresholds} - {each.run for each in self.group.left_out}
        return circumstances(self.group, [run for run in self.runs if run.run.id in taken])

    def document(self) -> dict[str, Any]:
        """Return the results as JSON has them: thresholds, points of the curve (or None), left_out."""
        left_out = () if self.group is None else self.group.left_out
        doubtful = [each for each in self.thresholds if is_doubtful(each)]
        return {
            "thresholds": [{**vars(threshold), "flags": list(threshold.flags)} for threshold in self.thresholds],
            "curve": None if self.group is None else _points(self.group),
            "curve_beside": None if self.beside is None else _points(self.beside),
            "doubtful": [_named(each) for each in doubtful],
            "left_out": [_named(each) for each in left_out],
            "not_known": [{"frequency_hz": hertz, **vars(row)} for hertz, row in self.not_known.items()],
            "not_refitted": [{"run": run.run.id, "reason": reason} for run, reason in self.not_refitted],
        }


def _named(threshold: MeasuredThreshold) -> dict[str, Any]:
    keys = ("subject", "finger", "frequency_hz", "run")
    return {**{key: getattr(threshold, key) for key in keys}, "flags": list(threshold.flags)}


def _points(group: GroupCurve) -> list[dict[str, float | int | str]]:
    curve = group.curve
    errors = np.zeros(0) if curve.standard_error_db is None else curve.standard_error_db
    columns = (curve.frequency_hz.tolist(), curve.level_db_re_1um.tolist(), errors.tolist())
    names = ("frequency_hz", "level_db_re_1um", "standard_error_db", *COUNTED)
    counted = [getattr(group, name) for name in COUNTED]
    return [dict(zip(names, cells, strict=True)) for cells in zip(*columns, *counted, strict=True)]


def store_results(
    store_path: str | PathLike[str],
    group: str | None = None,
    reference: str | None = None,
    leave_out: Sequence[str] = (),
    voided: bool = False,
) -> StoreResults:
    """Return the results of a store's finished runs, of one group of subjects or of all.

    reference: name or file of the curve that 0 dB SL stood for, None: that of the runs. leave_out: as group_curve
    takes it. voided: what is void is included. Raises BadInput where there are no such runs, or runs on several
    curves without a reference.
    """
    with closing(Store(store_path, must_exist=True, voided=voided)) as store:
        runs, of_runs = fitted_parts(required_parts(store, group=group))
    measured = of_runs.require().thresholds
    names = sorted({run.run.curve for run in runs})
    if reference is None and len(names) > 1:
        raise BadInput(f"runs refer to the curves {', '.join(names)}", "`reference` to name the one to extend by")
    original = resolve_curve(reference or names[0])
    band_hz = (min(run.run.band_low_hz for run in runs), max(run.run.band_high_hz for run in runs))
    across, refused = _across(measured, original, band_hz, leave_out)
    beside = None
    if any(is_doubtful(threshold) for threshold in measured):
        beside, _ = _across(measured, original, band_hz, sorted(set(leave_out) ^ {FLAGGED}))
    which = f"{'with' if FLAGGED in leave_out else 'without'} those flagged"
    censored_hz = {threshold.frequency_hz for threshold in measured if threshold.bound}
    levels = group_levels([each for each in _parted(measured, leave_out)[0] if each.frequency_hz in censored_hz])
    not_known = {hertz: row for hertz, row in levels.items() if row.bound == BETWEEN}
    return StoreResults(runs, original, measured, across, refused, beside, which, of_runs.refused, not_known)


def _across(
    measured: Sequence[MeasuredThreshold], reference: ThresholdCurve, band_hz: tuple[float, float],
    leave_out: Sequence[str],
) -> tuple[GroupCurve | None, BadInput | None]:  # fmt: skip
    """Return the curve across subjects, or the reason why not. Raises BadInput for unknown subjects."""
    _parted(measured, leave_out)
    try:
        return group_curve(measured, reference, band_hz, leave_out), None
    except BadInput as error:
        return None, error
