"""Frequency responses of others: columns of frequency, magnitude and phase, perhaps with coherence or confidence."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.columns import Columns, read_columns
from tactuator.signals.record import FrequencyResponse

FREQUENCY_NAMES = ("frequency_hz", "frequency", "freq_hz", "freq", "f_hz", "hz", "f")
MAGNITUDE_NAMES = ("magnitude", "gain", "amplitude", "abs", "mag", "magnitude_v")
LEVEL_NAMES = ("magnitude_db", "gain_db", "level_db", "mag_db", "db", "amplitude_db")
PHASE_NAMES = {"phase_deg": np.pi / 180.0, "phase_degrees": np.pi / 180.0, "phase_rad": 1.0, "phase": np.pi / 180.0}
REAL_NAMES, IMAGINARY_NAMES = ("real", "re", "response_real"), ("imag", "imaginary", "im", "response_imag")
_TYPICAL = 0.01
"""Relative error of a magnitude that comes without one: a tenth of a decibel."""


def is_response(path: Path) -> bool:
    """Return true where a file's columns are a frequency and a magnitude (or real and imaginary part), and no time."""
    try:
        columns = read_columns(path)
    except BadInput:
        return False
    names = {name.lower() for name in columns.values}
    parts = bool(names & set(REAL_NAMES)) and bool(names & set(IMAGINARY_NAMES))
    return bool(names & set(FREQUENCY_NAMES)) and (parts or bool(names & {*MAGNITUDE_NAMES, *LEVEL_NAMES}))


def read_foreign_response(path: Path) -> FrequencyResponse:
    """Return the response in a file; points that are no number are left out and told. Raises BadInput."""
    columns = read_columns(path)
    try:
        return _assembled(path, columns)
    except BadInput as error:
        raise error.within(f"response {path}") from None


def _assembled(path: Path, columns: Columns) -> FrequencyResponse:
    lower = {name.lower(): values for name, values in columns.values.items()}
    frequency = _first(lower, FREQUENCY_NAMES)
    level, magnitude = _first(lower, LEVEL_NAMES), _first(lower, MAGNITUDE_NAMES)
    real, imaginary = _first(lower, REAL_NAMES), _first(lower, IMAGINARY_NAMES)
    if level is None and magnitude is None and real is not None and imaginary is not None:
        magnitude = np.hypot(real, imaginary)
        lower["phase_rad"] = np.arctan2(imaginary, real)
    if frequency is None or (level is None and magnitude is None):
        raise BadInput(
            f"columns {', '.join(columns.values)}",
            "frequency_hz with magnitude or magnitude_db (and phase_deg), or with real and imag",
        )
    size = magnitude if magnitude is not None else 10.0 ** (np.asarray(level) / 20.0)
    phase = next((lower[name] * factor for name, factor in PHASE_NAMES.items() if name in lower), None)
    deviation, said = _deviation(lower, size.size)
    known = np.isfinite(frequency) & np.isfinite(size) & np.isfinite(deviation)
    remarks = [*columns.remarks, *([said] if said else [])]
    if phase is not None and np.mean(np.isfinite(phase)) < 0.5:
        raise BadInput(
            f"the phase is missing at {int(np.sum(~np.isfinite(phase)))} of {phase.size} points",
            "fewer than half, or no phase column at all (then the least phase is taken)",
        )
    if phase is not None:
        known &= np.isfinite(phase)
    if not np.all(known):
        remarks.append(f"{int(np.sum(~known))} of {known.size} points are no numbers and are left out")
    if phase is None:
        remarks.append("there is no phase: that of least lag is taken, without dead time")
    order = np.argsort(frequency[known], kind="stable")
    picked = [one[known][order] for one in (frequency, size, deviation)]
    turned = None if phase is None else phase[known][order]
    about = {"file": path.name, "kind": "response"}
    return FrequencyResponse(
        picked[0],
        picked[1],
        turned,
        picked[2],
        about,
        tuple(remarks),
        assumed=not {"confidence_db", "coherence"} & set(lower),
    )


def _first(columns: dict[str, FloatArray], names: tuple[str, ...]) -> FloatArray | None:
    return next((columns[name] for name in names if name in columns), None)


def _deviation(columns: dict[str, FloatArray], count: int) -> tuple[FloatArray, str]:
    """Return the relative standard error, by a confidence in decibels (95 %) or by the coherence of one average."""
    if "confidence_db" in columns:
        return np.maximum((10.0 ** (columns["confidence_db"] / 20.0) - 1.0) / 1.96, 1e-5), ""
    if "coherence" in columns:
        share = np.clip(columns["coherence"], 1e-3, 1.0 - 1e-6)
        return np.maximum(np.sqrt((1.0 - share) / (2.0 * share)), 1e-4), "the coherence is taken to be of one average"
    return np.full(count, _TYPICAL), "there is no confidence: 1 % of the magnitude is taken"
