"""The threshold curve of a group, from its subjects' thresholds, and its file."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.experiment.result.thresholds import Threshold
from tactuator.experiment.store.stored_runs import StoredRun
from tactuator.files.atomic import write_text
from tactuator.perception.curve import ThresholdCurve

Floats = NDArray[np.float64]

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
"""Columns of a session that a curve carries on."""


@dataclass(frozen=True)
class GroupCurve:
    """curve: mean over subjects; subjects: how many at each point (0: extended to the band's edge, not measured)."""

    curve: ThresholdCurve
    subjects: tuple[int, ...]


def group_curve(found: Sequence[Threshold], reference: ThresholdCurve, band_hz: tuple[float, float]) -> GroupCurve:
    """Mean refitted threshold at each frequency, a subject's fingers and repeats averaged first.

    The standard error is that of the mean between subjects, and not below what the single thresholds are known to.
    Beyond the measured frequencies the curve keeps its distance from `reference` up to the band's edges: a design needs
    the whole band. Raises BadInput for fewer than three frequencies.
    """
    frequency_hz = np.array(sorted({one.frequency_hz for one in found}))
    if frequency_hz.size < 3:
        raise BadInput(f"a curve of {frequency_hz.size} measured frequencies; allowed: three or more")
    rows = [_mean([one for one in found if one.frequency_hz == frequency]) for frequency in frequency_hz]
    level, error = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    count = [row[2] for row in rows]
    for edge, end in ((band_hz[0], 0), (band_hz[1], -1)):
        if (edge < frequency_hz[0]) if end == 0 else (edge > frequency_hz[-1]):
            distance = level[end] - float(reference.level_db_re_1um_at(frequency_hz[end]))
            place = 0 if end == 0 else level.size
            level = np.insert(level, place, float(reference.level_db_re_1um_at(edge)) + distance)
            error = np.insert(error, place, error[end])
            frequency_hz = np.insert(frequency_hz, place, edge)
            count.insert(place, 0)
    subjects = len({one.subject for one in found})
    source = f"mean of {subjects} subjects on the display; ends beyond the measured frequencies follow {reference.name}"
    return GroupCurve(ThresholdCurve("measured", frequency_hz, level, "measured", source, error), tuple(count))


def _mean(found: Sequence[Threshold]) -> tuple[float, float, int]:
    """Level, standard error and number of subjects at one frequency."""
    subjects = sorted({one.subject for one in found})
    each = [[one for one in found if one.subject == subject] for subject in subjects]
    levels = np.array([np.mean([one.level_db_re_1um for one in mine]) for mine in each])
    within = np.array([np.sqrt(np.sum([one.refit_sd_db**2 for one in mine])) / len(mine) for mine in each])
    known = float(np.sqrt(np.sum(within**2)) / len(subjects))
    between = float(np.std(levels, ddof=1) / np.sqrt(len(subjects))) if len(subjects) > 1 else 0.0
    return float(levels.mean()), max(known, between), len(subjects)


def write_group_curve(path: str | Path, group: GroupCurve, runs: Sequence[StoredRun]) -> None:
    """The curve as CSV that `read_curve` reads, with a column for each circumstance.

    A circumstance that differed between the sessions has its values joined by `;`, an unknown one is empty.
    """
    curve = group.curve
    assert curve.standard_error_db is not None
    shared = {name: _joined([getattr(run.session, name) for run in runs]) for name in CIRCUMSTANCES}
    shared["finger"] = _joined([run.run.finger for run in runs])
    shared["controller_sha256"] = _joined([run.run.controller_sha256 for run in runs])
    stream = io.StringIO()
    stream.write(f"# name: {curve.name}\n# provenance: {curve.provenance}\n# source: {curve.source}\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["frequency_hz", "level_db_re_1um", "standard_error_db", "subjects", *shared])
    points = zip(curve.frequency_hz, curve.level_db_re_1um, curve.standard_error_db, group.subjects, strict=True)
    for frequency, level, error, count in points:
        writer.writerow([f"{frequency:.6g}", f"{level:.4f}", f"{error:.4f}", count, *shared.values()])
    write_text(path, stream.getvalue())


def _joined(values: Sequence[object]) -> str:
    return ";".join(sorted({str(value) for value in values if value is not None and value != ""}))
