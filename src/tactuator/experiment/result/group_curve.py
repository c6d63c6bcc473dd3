"""The threshold curve of a group, from its subjects' thresholds, and how it was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.result.thresholds import DISQUALIFYING, MeasuredThreshold
from tactuator.experiment.store.stored_runs import StoredRun
from tactuator.perception.curve import Provenance, ThresholdCurve

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
"""Columns of a session that stand in the file of a curve."""


@dataclass(frozen=True)
class GroupCurve:
    """The mean threshold curve of a group, and the subjects behind it.

    subjects: number at each point (0: extended to the band's edge, not measured). left_out: thresholds that were not
    taken in because of the flags of their runs.
    """

    curve: ThresholdCurve
    subjects: tuple[int, ...]
    left_out: tuple[MeasuredThreshold, ...] = ()


def group_curve(
    found: Sequence[MeasuredThreshold],
    reference: ThresholdCurve,
    band_hz: tuple[float, float],
    keep_flagged: bool = False,
) -> GroupCurve:
    """Return the mean refitted threshold at each frequency, a subject's fingers and repeats averaged first.

    Thresholds with a disqualifying flag are left out unless keep_flagged. The standard error is that of the mean
    between subjects, and not below what the single thresholds are known to. Beyond the measured frequencies the curve
    keeps its distance from `reference` up to the band's edges: a design needs the whole band. The provenance is
    `simulated` where any threshold is. Raises BadInput where fewer than three frequencies are left.
    """
    kept, left_out = _parted(found, keep_flagged)
    frequency_hz = np.array(sorted({one.frequency_hz for one in kept}))
    if frequency_hz.size < 3:
        without = f", {len(left_out)} thresholds left out for their flags" if left_out else ""
        raise BadInput(f"a curve of {frequency_hz.size} measured frequencies{without}", "three or more")
    rows = [_mean([one for one in kept if one.frequency_hz == frequency]) for frequency in frequency_hz.tolist()]
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
    simulated = any(one.simulated for one in kept)
    return GroupCurve(_curve(frequency_hz, level, error, kept, reference, simulated), tuple(count), tuple(left_out))


def _parted(
    found: Sequence[MeasuredThreshold], keep_flagged: bool
) -> tuple[list[MeasuredThreshold], list[MeasuredThreshold]]:
    """Return the thresholds that are taken in, and those that are left out."""
    kept: list[MeasuredThreshold] = []
    left_out: list[MeasuredThreshold] = []
    for one in found:
        (left_out if not keep_flagged and DISQUALIFYING & set(one.flags) else kept).append(one)
    return kept, left_out


def _curve(
    frequency_hz: FloatArray, level: FloatArray, error: FloatArray, kept: Sequence[MeasuredThreshold],
    reference: ThresholdCurve, simulated: bool,
) -> ThresholdCurve:  # fmt: skip
    subjects = len({(one.study_number, one.subject) for one in kept})
    who = "simulated, nobody felt it: " if simulated else ""
    source = (
        f"{who}mean of {subjects} subjects on the display, each point at {100.0 * kept[0].point:.1f} % correct; "
        f"ends beyond the measured frequencies follow {reference.name}"
    )
    provenance: Provenance = "simulated" if simulated else "measured"
    return ThresholdCurve(provenance, frequency_hz, level, provenance, source, error)


def _mean(found: Sequence[MeasuredThreshold]) -> tuple[float, float, int]:
    """Return level, standard error and number of subjects at one frequency."""
    of_subject: dict[tuple[int, str], list[MeasuredThreshold]] = {}
    for one in found:
        of_subject.setdefault((one.study_number, one.subject), []).append(one)
    subjects = sorted(of_subject)
    each = [of_subject[subject] for subject in subjects]
    levels = np.array([np.mean([one.level_db_re_1um for one in mine]) for mine in each])
    within = np.array([np.sqrt(np.sum([one.sd_db**2 for one in mine])) / len(mine) for mine in each])
    known = float(np.sqrt(np.sum(within**2)) / len(subjects))
    between = float(np.std(levels, ddof=1) / np.sqrt(len(subjects))) if len(subjects) > 1 else 0.0
    return float(levels.mean()), max(known, between), len(subjects)


def circumstances(group: GroupCurve, runs: Sequence[StoredRun]) -> dict[str, list[object]]:
    """Return the columns that tell how a group's curve was measured, one cell for each of its points.

    A circumstance that differed between the sessions has its values joined by `;`; an unknown one is empty.
    """
    shared = {name: _joined([getattr(run.session, name) for run in runs]) for name in CIRCUMSTANCES}
    shared["finger"] = _joined([run.run.finger for run in runs])
    shared["controller_sha256"] = _joined([run.run.controller_sha256 for run in runs])
    points = len(group.subjects)
    return {"subjects": list(group.subjects), **{name: [value] * points for name, value in shared.items()}}


def _joined(values: Sequence[object]) -> str:
    return ";".join(sorted({str(value) for value in values if value is not None and value != ""}))
