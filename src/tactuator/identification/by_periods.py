"""Identification of a periodic record: the best linear approximation, with noise and distortion told apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tactuator.identification.by_prediction import Prepared
from tactuator.identification.by_spectrum import identification
from tactuator.identification.evidence.distortion import Distortion, distortion_of
from tactuator.identification.forms.known import Known
from tactuator.identification.result import BetweenSamples, Identification
from tactuator.identification.spectral.hold import Hold
from tactuator.identification.spectral.hold_choice import estimate_lines
from tactuator.identification.spectral.lines import LocalResponse
from tactuator.identification.spectral.record_residual import residual_of_record
from tactuator.signals.multisine import Periods, periods_of

_FEWEST_LINES = 8
_NONE = 1e-6
"""Share of the response below which a distortion is rounding (120 dB)."""


def plans_of(common: Prepared) -> tuple[Periods, ...] | None:
    """Return the plan of every record, or None where one has none, too few lines, or another than the first."""
    made = [periods_of(one.about, one.command.size) for one in common.all_records]
    plans = tuple(one for one in made if one is not None)
    if len(plans) < len(made) or plans[0].lines.size < _FEWEST_LINES:
        return None
    first = plans[0]
    alike = all(
        (one.period, one.repeats) == (first.period, first.repeats) and np.array_equal(one.lines, first.lines)
        for one in plans
    )
    return plans if alike else None


@np.errstate(all="ignore")
def identify_periods(
    common: Prepared,
    plans: tuple[Periods, ...],
    holds: tuple[Hold, ...],
    source: str,
    known: Known,
    note: Callable[[str], None],
) -> Identification:
    """Return the model of the best linear approximation that the records' periods show, weighted by its total variance.

    What a nonlinear mechanism does beyond it counts as error: the band holds the approximation, not one realisation.
    """
    note("periods")
    signals = [(one.command, one.position) for one in common.all_samples]
    references = [one.reference for one in common.all_records if one.reference is not None]
    seen = distortion_of(
        signals, references if len(references) == len(signals) else None, plans, common.samples.rate_hz
    )
    ones = np.ones(seen.frequency_hz.size)
    noise = seen.total**2 / np.maximum(len(plans) * plans[0].realisations, 1)
    local = LocalResponse(seen.frequency_hz, seen.value, seen.variance, noise, ones, ones)
    found = estimate_lines(local, signals, common.samples.rate_hz, holds, known, note)
    residuals = tuple(residual_of_record(found.chosen.fit, taken) for taken in found.spectra)
    between = BetweenSamples(found.chosen.hold, source, source != "data" or found.certain, found.advantage)
    gain = common.scale[1] / common.scale[0]
    common = replace(common, remarks=(*common.remarks, *_remarks(seen)))
    return identification(common, found, residuals, between, seen.scaled(gain))


def _remarks(seen: Distortion) -> tuple[str, ...]:
    if not seen.shows:
        return ()
    size = np.abs(seen.value)
    worst = int(np.argmax(seen.distortion / size))
    kinds = [("even", seen.even), ("odd", seen.distortion)]
    said = " and ".join(f"{name} {_below(float(level[worst] / size[worst]))}" for name, level in kinds)
    return (
        f"distortion stands out of the noise, at {seen.frequency_hz[worst]:.3g} Hz: {said}; the model is the best "
        "linear approximation at this level of the command, the band counts distortion as error, and friction is part "
        "of both",
    )


def _below(share: float) -> str:
    """Return a distortion's level in words; share: of the response."""
    return "none that shows" if share < _NONE else f"{-20.0 * np.log10(share):.0f} dB below the response"
