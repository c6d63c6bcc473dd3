"""Is a record fit to be identified? What is wrong is refused, what is doubtful is said."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.identification.evidence.empirical import EmpiricalResponse
from tactuator.signals.record import Record

FEWEST = 100
"""Samples below which nothing is identified."""
_LEVELS, _FEW_LEVELS = 10_000, 50
"""Parts of its span in which a signal's levels are counted, and the count below which it is meant to have few."""
_OFTEN = 0.005
"""Share of samples exactly at an extreme from which on it is a limit, though none lasts."""


def check_record(record: Record) -> tuple[str, ...]:
    """Return remarks on a record; BadInput where it cannot be used at all."""
    if record.command.size < FEWEST:
        raise BadInput(f"the record has {record.command.size} samples", f"{FEWEST} or more")
    for name in ("command", "position"):
        values = getattr(record, name)
        if np.ptp(values) <= 1e-12 * max(float(np.max(np.abs(values))), 1e-300):
            raise BadInput(f"the {name} is constant ({values[0]:g})", "one that moves")
    remarks = []
    for name in ("position", "command"):
        clipped = clipped_share(getattr(record, name))
        if clipped > 0.2 and name == "position":
            raise BadInput(f"{100.0 * clipped:.0f} % of the position is clipped", "20 % at most")
        if clipped > 0.0:
            remarks.append(f"{name} is clipped in {100.0 * clipped:.2g} % of the samples: its converter was saturated")
    return tuple(remarks)


def clipped_share(values: FloatArray) -> float:
    """Return the share of samples that sit at an extreme in runs, as a saturated converter leaves them; 0 for a signal
    of few levels (steps, a binary sequence), which is meant to sit there.
    """
    span = float(np.ptp(values))
    levels = np.bincount(np.rint((values - values.min()) * (_LEVELS / span)).astype(np.int64))
    if np.count_nonzero(levels) < _FEW_LEVELS:
        return 0.0
    total = 0
    for extreme, sign in ((values.max(), 1.0), (values.min(), -1.0)):
        at = sign * (extreme - values) <= 1e-9 * span
        near = (sign * (extreme - values) <= 0.01 * span) & ~at
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(np.int8), [0]])))
        runs = edges[1::2] - edges[::2]
        long = int(runs[runs >= 3].sum())
        if long >= 6 and long > near.sum():
            total += long
        elif at.sum() > max(6, _OFTEN * values.size, 3.0 * near.sum()):
            # a quick signal comes back from its limit after a sample or two
            total += int(at.sum())
    return total / values.size


def check_direction(response: EmpiricalResponse) -> tuple[str, ...]:
    """Check whether what is called position follows what is called command: a mechanism falls with
    frequency, and lags.
    """
    trusted = response.trusted(0.5)
    if trusted.frequency_hz.size < 6:
        return ("command and position hardly depend on each other: little can be said",)
    log_f = np.log(trusted.frequency_hz)
    upper = log_f >= np.median(log_f)
    slope = np.polyfit(log_f[upper], np.log(np.abs(trusted.value[upper])), 1)[0]
    phase = np.unwrap(np.angle(trusted.value))
    leads = float(np.mean(phase[upper])) > 0.8 and phase[-1] > phase[0] - 0.2
    if slope > 1.0 and leads:
        return (
            "the position leads the command and rises with frequency, as no mechanism can (not causal): input and "
            "output look swapped",
        )
    return ()


def check_polarity(num: FloatArray, den: FloatArray) -> tuple[str, ...]:
    """Check whether the position goes where the command pushes; num, den: descending powers."""
    lowest = num[np.flatnonzero(num)[-1]] if np.any(num) else 1.0
    if lowest / (den[-1] if den[-1] != 0.0 else 1.0) < 0.0 and np.all(np.roots(den).real <= 0.0):
        return ("the position moves against the command (negative correlation): a polarity or the columns are swapped",)
    return ()


def check_length(poles_rad_s: NDArray[np.inexact[Any]], slow_error: float, duration_s: float) -> tuple[str, ...]:
    """Refuse a record shorter than the slowest time constant, unless the mechanism integrates.

    slow_error: standard error of the slowest pole, rad/s. A pole that cannot be told from zero in a record 20 times as
    long as the next time constant is an integrator; in a shorter one nothing is known of it.
    """
    # a resonance shows itself within its periods, however slowly it decays
    resonant = np.abs(poles_rad_s.imag) > np.abs(poles_rad_s.real)
    speed = np.sort(np.where(resonant, np.abs(poles_rad_s), np.abs(poles_rad_s.real)))
    slowest = float(speed[0])
    # within three time constants a pole has also to stand out from its own uncertainty
    stands_out = slowest >= 3.0 * slow_error and bool(np.all(poles_rad_s.real <= 0.0))
    if slowest * duration_s >= 3.0 or (slowest * duration_s >= 1.0 and stands_out):
        return ()
    next_one = float(speed[1]) if speed.size > 1 else np.inf
    integrates = next_one * duration_s >= 20.0 and slowest < max(3.0 * slow_error, 0.1 / duration_s)
    if integrates:
        return (f"the slowest pole cannot be told from an integrator in {duration_s:.3g} s",)
    raise BadInput(
        f"the record lasts {duration_s:.3g} s, the slowest time constant {1.0 / max(slowest, 1e-300):.3g} s",
        "a record that is longer",
    )
