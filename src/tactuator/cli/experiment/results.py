"""The verb `experiment thresholds`: results of a store's runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group

from tactuator.cli.answer import shown, working, written
from tactuator.errors import BadInput
from tactuator.experiment.language.words import shipped_words
from tactuator.experiment.result.group_curve import GroupCurve, circumstances, group_curve
from tactuator.experiment.result.psychometric_trials import psychometric_trials
from tactuator.experiment.result.tables import threshold_table
from tactuator.experiment.result.thresholds import DISQUALIFYING, MeasuredThreshold, names_of_people, thresholds
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import StoredRun, detection_runs
from tactuator.io.curve import resolve_curve, write_curve
from tactuator.report.plates.felt.psychometric import psychometric_plate
from tactuator.report.plates.felt.thresholds import PersonThresholds, thresholds_plate


def results(
    store_path: Path,
    group: str | None,
    reference: str | None,
    curve_out: Path | None,
    figures: Path | None,
    keep_flagged: bool = False,
) -> tuple[dict[str, Any], Group, BadInput | None]:
    """Return thresholds and the curve across subjects, as JSON and as a table; files are written where asked.

    The third is why there is no curve where a file or figures of it were asked for, and None otherwise: the thresholds
    are worth telling all the same.
    """
    store = Store(store_path, must_exist=True)
    try:
        runs = [run for run in detection_runs(store) if group is None or run.session.subject_group == group]
    finally:
        store.close()
    if not runs:
        raise BadInput(f"store {store_path} has no run of group {group!r}", "a group that took part")
    with working(f"refitting {len(runs)} runs"):
        found = thresholds(runs)
    names = sorted({run.run.curve for run in runs})
    if reference is None and len(names) > 1:
        raise BadInput(f"runs stand on the curves {', '.join(names)}", "--reference to name the one to extend by")
    original = resolve_curve(reference or names[0])
    across, refused = _across(found, runs, original, keep_flagged)
    if across is not None and curve_out is not None:
        write_curve(curve_out, across.curve, circumstances(across, runs))
    if across is not None and figures is not None:
        figures.mkdir(parents=True, exist_ok=True)
        thresholds_plate(person_thresholds(found), original, across.curve).save(figures)
        for subject, trials in psychometric_trials(runs, found).items():
            psychometric_plate(subject, trials).save(figures)
    answer = {"thresholds": [_plain(one) for one in found], "curve": _curve(across), "left_out": _left_out(across)}
    made = written(curve_out, figures) if across is not None else []
    table = Group(shown(threshold_table(found, shipped_words("en"))), *_told(across), *made)
    return answer, table, refused if curve_out or figures else None


def _told(group: GroupCurve | None) -> list[str]:
    """Return lines on who stands in the curve across subjects."""
    if group is None:
        return []
    points = [(hertz, count) for hertz, count in zip(group.curve.frequency_hz, group.subjects, strict=True) if count]
    counts = {count for _, count in points}
    if len(counts) == 1:
        people = f"people: {counts.pop()} at each of {len(points)} frequencies"
    else:
        people = "people: " + ", ".join(f"{count} at {hertz:.4g} Hz" for hertz, count in points)
    lines = [f"curve across subjects ({group.curve.provenance}): {people}"]
    lines += [
        f"left out: {one.subject}, {one.finger}, {one.frequency_hz:.4g} Hz, run {one.run}: {', '.join(one.flags)}"
        for one in group.left_out
    ]
    return lines


def _left_out(group: GroupCurve | None) -> list[dict[str, Any]]:
    keys = ("subject", "finger", "frequency_hz", "run")
    left_out = () if group is None else group.left_out
    return [{**{key: getattr(one, key) for key in keys}, "flags": list(one.flags)} for one in left_out]


def person_thresholds(found: Sequence[MeasuredThreshold]) -> list[PersonThresholds]:
    """Return each subject's thresholds by frequency; every finger and repeat is a point."""
    each: dict[tuple[int, str], list[MeasuredThreshold]] = {}
    for one in sorted(found, key=lambda one: one.frequency_hz):
        each.setdefault((one.study_number, one.subject), []).append(one)
    people = []
    for person, name in names_of_people(found).items():
        mine = each[person]
        hertz, level, error = np.array([(one.frequency_hz, one.level_db_re_1um, one.sd_db) for one in mine]).T
        flagged = np.array([bool(DISQUALIFYING & set(one.flags)) for one in mine])
        people.append(PersonThresholds(name, hertz, level, error, flagged))
    return people


def _across(
    found: Sequence[MeasuredThreshold], runs: Sequence[StoredRun], original: Any, keep_flagged: bool
) -> tuple[GroupCurve | None, BadInput | None]:
    """Return the curve across subjects, or why there is none."""
    band = (min(run.run.band_low_hz for run in runs), max(run.run.band_high_hz for run in runs))
    try:
        return group_curve(found, original, band, keep_flagged), None
    except BadInput as error:
        return None, error


def _curve(group: GroupCurve | None) -> list[dict[str, float | int]] | None:
    if group is None:
        return None
    curve = group.curve
    errors = np.zeros(0) if curve.standard_error_db is None else curve.standard_error_db
    return [
        {"frequency_hz": f, "level_db_re_1um": level, "standard_error_db": error, "subjects": count}
        for f, level, error, count in zip(
            curve.frequency_hz.tolist(), curve.level_db_re_1um.tolist(), errors.tolist(), group.subjects, strict=True
        )
    ]


def _plain(one: MeasuredThreshold) -> dict[str, Any]:
    return {**vars(one), "flags": list(one.flags)}
