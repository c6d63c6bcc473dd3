"""The verb `experiment thresholds`: results of a store's runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group

from tactuator.cli.answer import shown
from tactuator.errors import BadInput
from tactuator.experiment.result.group_curve import GroupCurve, group_curve, write_group_curve
from tactuator.experiment.result.tables import threshold_table
from tactuator.experiment.result.thresholds import Threshold, thresholds
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import StoredRun, detection_runs
from tactuator.files.curve import resolve_curve
from tactuator.report.plates.felt.thresholds import PersonThresholds, thresholds_plate


def results(
    store_path: Path, group: str | None, reference: str | None, curve_out: Path | None, figure_out: Path | None
) -> tuple[dict[str, Any], Group]:
    """Return thresholds and the curve across subjects, as JSON and as a table; files are written where asked."""
    store = Store(store_path, must_exist=True)
    try:
        runs = [run for run in detection_runs(store) if group is None or run.session.subject_group == group]
    finally:
        store.close()
    if not runs:
        raise BadInput(f"store {store_path} has no run of group {group!r}; allowed: a group that took part")
    found = thresholds(runs)
    names = sorted({run.run.curve for run in runs})
    if reference is None and len(names) > 1:
        raise BadInput(
            f"runs stand on the curves {', '.join(names)}; allowed: --reference to name the one to extend by"
        )
    original = resolve_curve(reference or names[0])
    across = _across(found, runs, original)
    if across is None and (curve_out or figure_out):
        raise BadInput("fewer than three frequencies were measured; allowed: three or more for a curve or figure")
    if across is not None and curve_out is not None:
        write_group_curve(curve_out, across, runs)
    if across is not None and figure_out is not None:
        figure_out.mkdir(parents=True, exist_ok=True)
        thresholds_plate(_people(found), original, across.curve).save(figure_out)
    return {"thresholds": [_plain(one) for one in found], "curve": _curve(across)}, shown(threshold_table(found))


def _people(found: Sequence[Threshold]) -> list[PersonThresholds]:
    """Return each subject's thresholds by frequency; every finger and repeat is a point."""
    people = []
    for subject in sorted({one.subject for one in found}):
        mine = sorted((one for one in found if one.subject == subject), key=lambda one: one.frequency_hz)
        columns = np.array([(one.frequency_hz, one.level_db_re_1um, one.refit_sd_db) for one in mine]).T
        people.append(PersonThresholds(subject, *columns))
    return people


def _across(found: Sequence[Threshold], runs: Sequence[StoredRun], original: Any) -> GroupCurve | None:
    if len({one.frequency_hz for one in found}) < 3:
        return None
    band = (min(run.run.band_low_hz for run in runs), max(run.run.band_high_hz for run in runs))
    return group_curve(found, original, band)


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


def _plain(one: Threshold) -> dict[str, Any]:
    return {**asdict(one), "flags": list(one.flags)}
