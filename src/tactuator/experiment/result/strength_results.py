"""Equal-strength contours of a store's people and of their group, and the balance between fingers."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from sqlalchemy import select

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import answered_runs, stored_tasks
from tactuator.experiment.task.estimate import Equality, Measured, StrengthEstimate, equality, estimate
from tactuator.experiment.task.matches import ContourSetting, Matches
from tactuator.experiment.task.matching import Matching
from tactuator.experiment.task.task import Answered, AnsweredRun
from tactuator.perception.contours import Contours
from tactuator.perception.curve import Contact, Provenance, ThresholdCurve

_POINTS = 24
_SAME_HZ = 1e-6


@dataclass(frozen=True, eq=False)
class PersonContours:
    """Contours of one person, and the other results of the matches."""

    subject: str
    estimate: StrengthEstimate
    contours: Contours


@dataclass(frozen=True)
class FingerBalance:
    """How far a tone on a finger lies above an equally strong one on the standard's finger at the same frequency: that
    finger's balance_db in a display file. people: their number. offset_db: over them.
    """

    finger: str
    offset_db: Measured
    people: int


@dataclass(frozen=True, eq=False)
class ContourResults:
    """Contours of everybody and of the group, pairs that were matched one by one, and balance. group: None without any
    contours. simulated: nobody felt anything.
    """

    people: tuple[PersonContours, ...]
    group: Contours | None
    pairs: tuple[tuple[AnsweredRun, Equality], ...]
    balance: tuple[FingerBalance, ...]
    simulated: bool


def contour_results(
    path: Path, group: str | None = None, curve: ThresholdCurve | None = None, voided: bool = False
) -> ContourResults:
    """Return the results of the matches of a store. curve: whose dB SL the contours are in, None: that of the
    display. voided: what is void is included.

    Contours are of the standard's own finger. Raises BadInput where there are no finished matching runs, or runs with
    several references; with a curve, if the matches do not name the display's.
    """
    with closing(Store(path, must_exist=True, voided=voided)) as store:
        keys, contact = _keys(store), _contact(store)
        runs = answered_runs(store, keys.kind, group=group)
    mine = [run for run in runs if run.finger == keys.finger]
    simulated = any(run.simulated for run in runs)
    provenance: Provenance = "simulated" if simulated else "measured"
    people = tuple(
        _person(subject, _of(mine, subject), keys, contact, curve, provenance)
        for subject in dict.fromkeys(run.subject for run in mine)
    )
    levels = np.array(keys.levels_db_sl)
    pairs = tuple((run, keys.equality(run)) for run in runs if run.frequency_hz is not None)
    together = _group(people, levels, contact, provenance) if people else None
    return ContourResults(people, together, pairs, _balance(runs, keys), simulated)


def _keys(store: Store) -> Matching:
    """Return the task's keys, the newest, with every level that was a standard's."""
    tasks = stored_tasks(store, Matching)
    if not tasks:
        raise BadInput(f"store {store.name} has no task of matches", "a study in which tones are matched")
    references = {(keys.finger, keys.frequency_hz) for keys in tasks}
    if len(references) != 1:
        got = ", ".join(f"{hertz:g} Hz on {finger}" for finger, hertz in sorted(references))
        raise BadInput(f"standards of {got}", "one frequency and finger in all of the store")
    return max(tasks, key=lambda keys: len(keys.levels_db_sl))


def _contact(store: Store) -> Contact:
    """Return where it was felt, as far as all sessions say the same."""
    session = schema.session.c
    with store.read() as connection:
        rows = connection.execute(select(session.site, session.surround, session.contact_area_mm2, session.preload_n))
        columns = list(zip(*rows, strict=True))
    site, surround, area_mm2, preload_n = (column[0] if len(set(column)) == 1 else None for column in columns)
    return Contact(site or "", area_mm2, "" if surround in (None, "none") else surround, preload_n or None)


def _of(runs: Sequence[AnsweredRun], subject: str) -> list[Answered]:
    return [trial for run in runs if run.subject == subject for trial in run.trials]


def _grid(keys: Matching, trials: Sequence[Answered]) -> FloatArray:
    hertz = keys.matches(trials).frequency_hz
    low, high = min(float(hertz.min()), keys.frequency_hz), max(float(hertz.max()), keys.frequency_hz)
    grid = np.geomspace(low, high, _POINTS)
    grid[np.argmin(np.abs(np.log(grid / keys.frequency_hz)))] = keys.frequency_hz
    return grid


def _person(
    subject: str,
    trials: Sequence[Answered],
    keys: Matching,
    contact: Contact,
    curve: ThresholdCurve | None,
    provenance: Provenance,
) -> PersonContours:
    matches, setting = keys.matches(trials), keys.setting_of(trials)
    if curve is not None:
        matches = _above(curve, matches, setting)
    hertz = matches.frequency_hz
    band = (min(keys.band_hz[0], float(hertz.min())), max(keys.band_hz[1], float(hertz.max())))
    result = estimate(matches, replace(setting, band_hz=band, curve=curve or setting.curve))
    grid, levels = _grid(keys, trials), np.array(sorted(keys.levels_db_sl))
    levels = levels[levels > 0.0]
    curves = result.contours(grid, levels)
    measured = sum(all(tone and tone.measured_db_sl is not None for tone in trial.tones) for trial in trials)
    source = (
        f"{len(trials)} matches, {measured} of them by the levels at the sensor; function: {result.intensity_function}"
    )
    source += "" if curve is None else f"; dB SL of {curve.name}"
    return PersonContours(
        subject, result, Contours(subject, grid, levels, *curves, keys.frequency_hz, provenance, source, contact)
    )


def _above(curve: ThresholdCurve, matches: Matches, setting: ContourSetting) -> Matches:
    """Return matches in dB SL of another curve than the display's, at the same displacements."""
    display = setting.curve
    if display is None:
        got = "matches that do not name the display's curve"
        raise BadInput(got, f"three frequencies, on both sides of {setting.reference_hz:g} Hz")

    def moved(hertz: FloatArray | float) -> FloatArray:
        return display.level_db_re_1um_at(hertz) - curve.level_db_re_1um_at(hertz)

    return replace(
        matches,
        comparison_db_sl=matches.comparison_db_sl + moved(matches.frequency_hz),
        reference_db_sl=matches.reference_db_sl + moved(setting.reference_hz),
    )


def _group(people: Sequence[PersonContours], levels: FloatArray, contact: Contact, provenance: Provenance) -> Contours:
    every = [person.contours for person in people]
    first = every[0]
    inside = [curves for curves in every if curves.reference_hz == first.reference_hz]
    low, high = max(c.frequency_hz[0] for c in inside), min(c.frequency_hz[-1] for c in inside)
    grid = first.frequency_hz[(first.frequency_hz >= low - _SAME_HZ) & (first.frequency_hz <= high + _SAME_HZ)]
    strength = first.level_db_sl[:, None]
    each = np.array([curves.level_db_sl_at(strength, grid) for curves in inside])
    mean, count = each.mean(axis=0), len(inside)
    if count == 1:
        low_db, high_db = every[0].band_db_sl_at(strength, grid)
    else:
        half = scipy.stats.t.ppf(0.975, count - 1) * each.std(axis=0, ddof=1) / np.sqrt(count)
        low_db, high_db = mean - half, mean + half
    source = f"{count} people, {sum(person.estimate.matches for person in people)} matches"
    return Contours(
        "group", grid, first.level_db_sl, mean, low_db, high_db, first.reference_hz, provenance, source, contact
    )


def _balance(runs: Sequence[AnsweredRun], keys: Matching) -> tuple[FingerBalance, ...]:
    fingers = dict.fromkeys(run.finger for run in runs if run.finger != keys.finger)
    balances = []
    for finger in fingers:
        mine = [run for run in runs if run.finger == finger]
        equalities = []
        for subject in dict.fromkeys(run.subject for run in mine):
            trials = [trial for trial in _of(mine, subject) if _same_frequency(keys, trial)]
            if trials:
                equalities.append(equality(keys.matches(trials), keys.setting).above_db)
        if equalities:
            balances.append(FingerBalance(finger, _mean(equalities), len(equalities)))
    return tuple(balances)


def _same_frequency(keys: Matching, trial: Answered) -> bool:
    return all(tone is not None and abs(tone.frequency_hz - keys.frequency_hz) < _SAME_HZ for tone in trial.tones)


def _mean(values: Sequence[Measured]) -> Measured:
    if len(values) == 1:
        return values[0]
    each = np.array([value.value for value in values])
    half = float(scipy.stats.t.ppf(0.975, each.size - 1) * each.std(ddof=1) / np.sqrt(each.size))
    mean = float(each.mean())
    return Measured(mean, mean - half, mean + half)


def person_document(person: PersonContours) -> dict[str, Any]:
    """Return the results of a person's matches, without the contours, in plain values."""
    result = person.estimate
    return {
        "subject": person.subject,
        "matches": result.matches,
        "intensity_function": result.intensity_function,
        "evidence": result.evidence,
        "order_db": vars(result.order_db),
        "standard_db": vars(result.standard_db),
        "jnd_db": vars(result.jnd_db),
    }
