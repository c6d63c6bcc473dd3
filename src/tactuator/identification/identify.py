"""From a record to a model with its uncertainty: all of identification behind one function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from tactuator.errors import BadInput
from tactuator.identification.asked import Asked
from tactuator.identification.by_spectrum import identification
from tactuator.identification.distortion import Distortion, distortion_of
from tactuator.identification.form import Known
from tactuator.identification.friction import fit_friction
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.lines import LocalResponse
from tactuator.identification.motor import motor_identification
from tactuator.identification.prepared import Prepared, Signals, check_rise, prepared
from tactuator.identification.recursive import recursive
from tactuator.identification.residual import residual_of_record
from tactuator.identification.result import BetweenSamples, Identification
from tactuator.identification.spectral_estimate import SpectralEstimate, estimate, estimate_lines, following
from tactuator.signals.multisine import Periods, periods_of
from tactuator.signals.record import Record

_FEWEST_LINES = 8
_NONE = 1e-6
"""Share of the response below which a distortion is rounding (120 dB)."""


def plans_of(common: Prepared) -> tuple[Periods, ...] | None:
    """Return the plan of every record, or None where one has none, too few lines, or another than the first."""
    listed = [periods_of(plan.about, plan.command.size) for plan in common.records]
    plans = tuple(plan for plan in listed if plan is not None)
    if len(plans) < len(listed) or plans[0].lines.size < _FEWEST_LINES:
        return None
    first = plans[0]
    alike = all(
        (plan.period, plan.repeats) == (first.period, first.repeats) and np.array_equal(plan.lines, first.lines)
        for plan in plans
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
    seen = distortion_of(common.signals, common.references, plans, common.rate_hz)
    ones = np.ones(seen.frequency_hz.size)
    noise = seen.total**2 / np.maximum(len(plans) * plans[0].realisations, 1)
    local = LocalResponse(seen.frequency_hz, seen.value, seen.variance, noise, ones, ones)
    estimated = estimate_lines(local, common.signals, common.rate_hz, holds, known, note)
    fit = estimated.chosen.fit
    residuals = tuple(residual_of_record(fit, taken, 0.5 * taken.rate_hz) for taken in estimated.spectra)
    common = replace(common, remarks=(*common.remarks, *_remarks(seen)))
    return identification(common, estimated, source, residuals, seen.scaled(common.gain))


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


_WIDEST_DB = 20.0
_CHANCE, _MISSED = 1e-3, 1e-3
"""Chance of a residual that follows the command so much, and the share of the position's power (3 % of its size), from
which on a model by least squares lacks something."""
_RULED = 0.5
"""Part of the position that is left over, over what friction takes of the command, from which on friction rules."""
_SHORT = 1.1
"""Ratio of its ends below which a range of frequency is none."""


def distrusted(result: Identification, common: Prepared) -> Identification:
    """Return the identification with the reasons, if any, for which its model must not be designed with."""
    model, record = result.model, common.records[0]
    reasons = [*result.distrust, *(str(doubt) for doubt in common.doubts if doubt.expected.impossible)]
    poles = np.roots(model.den)
    size = float(np.abs(poles).max())
    unstable = bool(np.any(poles.real > 1e-6 * size))
    if unstable and result.tests.feedback is not True:
        reasons.append("the model is not stable, though the record stays bounded and no feedback can be seen in it")
    sections = [value.fixed.section for value in result.fixed if value.fixed.section]
    known = np.concatenate([np.roots([1.0, *value]) for value in sections]) if sections else np.zeros(0)
    unknown = [pole for pole in poles if not np.any(np.abs(known - pole) < 1e-6 * size)]
    fastest = float(np.max(np.abs(unknown), initial=0.0)) / (2.0 * np.pi)
    if fastest > 0.5 * record.rate_hz:
        reasons.append(
            f"a pole at {fastest:.3g} Hz lies beyond half the rate ({0.5 * record.rate_hz:.6g} Hz), where the record "
            "shows nothing"
        )
    low, high = max(common.excitation.low_hz, model.band_hz[0]), min(common.excitation.high_hz, model.band_hz[1])
    if high > low:
        band = model.band_db(np.geomspace(low, high, 100))
        if float(np.max(band)) > _WIDEST_DB:
            reasons.append(f"the band is {float(np.max(band)):.3g} dB wide inside the record's own excitation")
    if model.valid_hz is not None and model.valid_hz[1] < _SHORT * model.valid_hz[0]:
        reasons.append("the band is nowhere narrower than 3 dB and 20 degrees")
    if result.fit_percent < 100.0 * (1.0 - np.sqrt(1.0 - 1e-3)):
        reasons.append("the model explains next to nothing of the position")
    missed = result.tests.unexplained * (1.0 - result.fit_percent / 100.0) ** 2
    if model.method == "rls" and result.tests.uncorrelated_p < _CHANCE and missed > _MISSED:
        reasons.append(
            f"{100.0 * missed:.2g} % of the position's power follow the command and not the model: a dead time, more "
            "poles, or sensor noise, which least squares has no place for (--method refined has)"
        )
    friction = result.friction
    if friction is not None and friction.presliding is None and not result.tests.uncorrelated_with_input:
        rest = 1.0 - result.fit_percent / 100.0
        if rest * float(np.std(record.command)) > _RULED * friction.coulomb or friction.confidence > friction.coulomb:
            reasons.append(
                f"friction rules the record: it builds up between two samples, {100.0 * rest:.2g} % of the position's "
                "size is left over, and how large it is cannot be told; a stronger command or a higher rate shows more"
            )
    if reasons:  # where a model cannot be trusted anyway, the likely slip helps
        reasons += [str(doubt) for doubt in check_rise(common.response)]
    remarks = list(result.remarks)
    if unstable and result.tests.feedback is True:
        remarks.append("the model is not stable (the record was made in a closed loop)")
    return replace(result, distrust=tuple(reasons), remarks=tuple(r for r in remarks if r != "the model is not stable"))


def identify(
    record: Record | Sequence[Record], *, note: Callable[[str], None] = lambda _: None, **wishes: Any
) -> Identification:
    """Return a continuous model of a record, or of several records of one mechanism at one rate.

    wishes: the fields of `Asked`. Several records are for the method "refined" alone. Raises BadInput for a record that
    cannot tell this.
    """
    records, asked = [record] if isinstance(record, Record) else list(record), Asked(**wishes)
    if asked.method != "refined" and len(records) > 1:
        raise BadInput(f"{len(records)} records with the method {asked.method!r}", "several with 'refined' alone")
    # threads of BLAS wait for each other over matrices of a dozen columns
    with threadpool_limits(limits=1):
        common = prepared(records, asked)
        return distrusted(recursive(common) if asked.method == "rls" else _refined(common, note), common)


def _refined(common: Prepared, note: Callable[[str], None]) -> Identification:
    asked = common.asked
    holds, source = _holds(common.records[0], asked)
    if asked.may_be_motor and len(common.records) == 1:
        motor = motor_identification(common, BetweenSamples(holds[0], source, len(holds) == 1))
        if motor is not None:
            return motor
    known = asked.known(common.gain)
    plans = plans_of(common)
    if plans is not None:
        return identify_periods(common, plans, holds, source, known, note)

    def estimate_of(signals: Signals) -> SpectralEstimate:
        return estimate(signals, common.rate_hz, holds, known, note)

    estimated, rubbed = estimate_of(common.signals), None
    if estimated.chosen.hold == "band-limited" and common.references is not None:
        note("fitting what follows the reference")
        estimated = following(estimated, common.references)
    if asked.friction and estimated.before is None:
        note("looking for friction")
        rubbed = fit_friction(common.signals, estimated, known, estimate_of)
    if rubbed is not None:
        estimated = rubbed.estimate
    return identification(common, estimated, source, estimated.residuals, rubbed=rubbed)


def _holds(record: Record, asked: Asked) -> tuple[tuple[Hold, ...], str]:
    """Return the holds to try, and who says so: the user, the record's own file, or the data."""
    if asked.hold != "auto":
        return (asked.hold,), "asked"
    written = tuple(hold for hold in HOLDS if hold == record.about.get("hold"))
    return (written, "file") if written else (("zero-order", "band-limited"), "data")
