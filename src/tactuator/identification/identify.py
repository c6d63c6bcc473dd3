"""From a record to a model with its uncertainty: all of identification behind one function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tactuator.errors import BadInput
from tactuator.identification import trust
from tactuator.identification.alignment import clock_skew_ppm
from tactuator.identification.check import Prepared, Signals, check_rise, prepared
from tactuator.identification.distortion import distortion_of
from tactuator.identification.fit import SpectralEstimate, estimate, estimate_lines, following
from tactuator.identification.form import Known
from tactuator.identification.friction import fit_friction, ruled_by_friction
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.judge import identification
from tactuator.identification.lines import LocalResponse
from tactuator.identification.options import IdentifyOptions, solvable
from tactuator.identification.recursive import recursive
from tactuator.identification.residual import residual_of_record
from tactuator.identification.result import Identification
from tactuator.model.plant_model import PlantModel, QualityCheck
from tactuator.processors import single_threaded
from tactuator.signals.multisine import Periods, periods_of
from tactuator.signals.record import Record

_FEWEST_LINES = 8


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
    return identification(common, estimated, source, residuals, seen.scaled(common.gain))


_CHANCE = 1e-3
"""Chance of a residual that follows the command so much, from which on it is taken to."""
_ONE_CLOCK = "record both columns with one clock"
_SHORTER = "use a shorter part: --from-s, --to-s"
_NO_LOOP = "record the motor outside its position loop, with noise several times as large as the friction"
_SHOWN = 20.0
"""Radians that a resonance turns in a record; one that turns less may be two integrators."""


def judged(result: Identification, common: Prepared) -> Identification:
    """Return the identification with all that decides whether its model is to be designed with."""
    model, record = result.model, common.records[0]
    poles = np.roots(model.den)
    size = float(np.abs(poles).max())
    growing = float(np.sum(poles.real > 1e-6 * size))
    known = np.array([-value.fixed.rate for value in result.fixed if value.fixed.name == "pole"])
    unknown = [pole for pole in poles if not np.any(np.abs(known - pole) < 1e-6 * size)]
    fastest = float(np.max(np.abs(unknown), initial=0.0)) / (2.0 * np.pi)
    slowest = 1.0 / common.longest_s
    lasting = sum(abs(pole.real) < slowest and pole.imag > _SHOWN * slowest for pole in unknown)
    rest = 1.0 - result.fit_percent / 100.0
    follows = result.tests.uncorrelated_p < _CHANCE
    rows = [
        trust.EXPLAINED.of(100.0 * (1.0 - rest**2)),
        trust.GROWING.of(0.0 if result.tests.feedback is True else growing),
        trust.LASTING.of(float(lasting)),
        trust.FASTEST.of(fastest / (0.5 * record.rate_hz)),
        *_ranges(model, common),
        trust.FOLLOWING.of(100.0 * result.tests.unexplained * rest**2 if follows else 0.0),
        trust.DRIFT.of(8.685890 * max(abs(result.tests.drift[0]) - result.tests.drift[1], 0.0), remedy=_SHORTER),
    ]
    friction = result.friction
    if friction is not None and friction.presliding is None:
        rows.append(trust.FRICTION.of(100.0 * friction.confidence / friction.coulomb))
        if not result.tests.uncorrelated_with_input:
            rows.append(trust.RUBBING.of(rest * float(np.std(record.command)) / friction.coulomb))
    model = model.with_checks(*rows)
    skew = max(abs(result.tests.skew_ppm[0]) - result.tests.skew_ppm[1], 0.0)
    if model.distrust or skew > trust.SKEW.limit:  # a residual tells of small ones alone
        skew = max(skew, *map(clock_skew_ppm, common.records))
    model = model.with_checks(trust.SKEW.of(skew, remedy=_ONE_CLOCK))
    if model.distrust:  # where a model cannot be trusted anyway, the likely slip helps
        model = model.with_checks(
            *(doubt.quality_check() for doubt in check_rise(common.response)),
            trust.RULED.of(100.0 * max(map(ruled_by_friction, common.records)), remedy=_NO_LOOP),
        )
    return replace(result, model=model)


def _ranges(model: PlantModel, common: Prepared) -> list[QualityCheck]:
    """Return what decides on the valid range: its part of what was excited, and the band inside it."""
    if model.valid_hz is None:
        return []
    low, high = (float(edge) for edge in model.valid_hz)
    excited = common.excitation.low_hz, common.excitation.high_hz
    inside = max(np.log(min(high, excited[1]) / max(low, excited[0])), 0.0)
    frequency = np.geomspace(low, high, 100)
    return [
        trust.VALID.of(100.0 * float(inside / max(np.log(excited[1] / excited[0]), 1e-9))),
        trust.BAND_DB.of(float(np.max(model.band_db(frequency)))),
        trust.BAND_DEG.of(float(np.degrees(np.max(model.band_rad(frequency))))),
    ]


def identify(
    record: Record | Sequence[Record],
    *,
    note: Callable[[str], None] = lambda _: None,
    warn: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> Identification:
    """Return a continuous model of a record, or of several records of one mechanism at one rate.

    note: told what is at hand; warn: why the model will not be trusted, known before it is fitted.
    options: the fields of `IdentifyOptions`. Several records are for the method "refined" alone. Raises BadInput for a
    record that cannot tell this.
    """
    records = [record] if isinstance(record, Record) else list(record)
    known = IdentifyOptions(**options).of(records[0].about)
    if known.method != "refined" and len(records) > 1:
        raise BadInput(f"{len(records)} records with the method {known.method!r}", "several with 'refined' alone")
    with single_threaded(scipys=False), solvable():
        common = prepared(records, known)
        for row in common.checks:
            if row.refuses:
                warn(f"{row.name}, {row.where.partition(':')[0]}".rstrip(", "))
        if known.method == "rls":
            return judged(recursive(common), common)
        return judged(_refined(common, note), common)


def _refined(common: Prepared, note: Callable[[str], None]) -> Identification:
    options = common.options
    holds, source = _holds(common.records[0], options)
    known = options.known(common.gain)
    plans = plans_of(common)
    if plans is not None:
        return identify_periods(common, plans, holds, source, known, note)

    def estimate_of(signals: Signals, before: SpectralEstimate | None = None, quick: bool = False) -> SpectralEstimate:
        return estimate(signals, common.rate_hz, holds, known, note, before, quick)

    friction_fit = first = None
    if options.friction and common.references is None:
        first = estimate_of(common.signals, quick=True)
        note("looking for friction")
        friction_fit = fit_friction(common.signals, first, known, estimate_of)
    if friction_fit is not None:
        return identification(
            common, friction_fit.estimate, source, friction_fit.estimate.residuals, friction_fit=friction_fit
        )
    estimated = estimate_of(common.signals, first)
    if estimated.chosen.hold == "band-limited" and common.references is not None:
        note("fitting what follows the reference")
        estimated = following(estimated, common.references)
    if options.friction and estimated.before is None:
        friction_fit = fit_friction(common.signals, estimated, known, estimate_of)
    estimated = estimated if friction_fit is None else friction_fit.estimate
    return identification(common, estimated, source, estimated.residuals, friction_fit=friction_fit)


def _holds(record: Record, options: IdentifyOptions) -> tuple[tuple[Hold, ...], str]:
    """Return the holds to try, and who says so: the user, the record's own file, or the data."""
    if options.hold != "auto":
        return (options.hold,), "asked"
    written = tuple(hold for hold in HOLDS if hold == record.about.get("hold"))
    return (written, "file") if written else (("zero-order", "band-limited"), "data")
