"""From a record to a model with its uncertainty: all of identification behind one function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tactuator.errors import BadInput
from tactuator.identification import trust
from tactuator.identification.asked import Asked, solvable
from tactuator.identification.by_spectrum import identification
from tactuator.identification.constancy import LostBlock, of_one_clock, parts_between, read_at, without_images
from tactuator.identification.distortion import distortion_of
from tactuator.identification.form import Known
from tactuator.identification.friction import fit_friction, ruled_by_friction
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.lines import LocalResponse
from tactuator.identification.prepared import Prepared, Signals, check_rise, prepared, valid_range
from tactuator.identification.recursive import recursive
from tactuator.identification.residual import residual_of_record
from tactuator.identification.result import Identification
from tactuator.identification.spectral_estimate import SpectralEstimate, estimate, estimate_lines, following
from tactuator.model.plant_model import PlantModel, Weighed
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
_RULED_HELP = "record the motor outside its position loop, with noise several times as large as the friction"
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
        trust.SKEW.of(max(abs(result.tests.skew_ppm[0]) - result.tests.skew_ppm[1], 0.0)),
        trust.DRIFT.of(8.685890 * max(abs(result.tests.drift[0]) - result.tests.drift[1], 0.0)),
    ]
    friction = result.friction
    if friction is not None and friction.presliding is None:
        rows.append(trust.FRICTION.of(100.0 * friction.confidence / friction.coulomb))
        if not result.tests.uncorrelated_with_input:
            rows.append(trust.RUBBING.of(rest * float(np.std(record.command)) / friction.coulomb))
    model = model.judged(*rows)
    if model.distrust:  # where a model cannot be trusted anyway, the likely slip helps
        model = model.judged(
            *(doubt.weighed() for doubt in check_rise(common.response)),
            trust.RULED.of(100.0 * max(map(ruled_by_friction, common.records)), _RULED_HELP),
        )
    return replace(result, model=model)


def _ranges(model: PlantModel, common: Prepared) -> list[Weighed]:
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
    **wishes: Any,
) -> Identification:
    """Return a continuous model of a record, or of several records of one mechanism at one rate.

    note: told what is at hand; warn: why the model will not be trusted, known before it is fitted.
    wishes: the fields of `Asked`. Several records are for the method "refined" alone. Raises BadInput for a record that
    cannot tell this.
    """
    records = [record] if isinstance(record, Record) else list(record)
    asked = Asked(**wishes).of(records[0].about)
    if asked.method != "refined" and len(records) > 1:
        raise BadInput(f"{len(records)} records with the method {asked.method!r}", "several with 'refined' alone")
    with single_threaded(scipys=False), solvable():
        read = [read_at(each) for each in records]
        if asked.method == "refined" and min(each.step for each in read) > 1:
            return judged(*_at_those_read(records, read, asked, note))
        common = prepared(records, asked)
        for row in common.weighed:
            if row.refuses:
                warn(f"{row.name}, {row.where.partition(':')[0]}".rstrip(", "))
        if asked.method == "rls":
            refined = identify(records, note=note, hold=asked.hold, quantity=asked.quantity)
            return judged(recursive(common, refined.model), common)
        common, result = _without_knocks(common, _refined(common, note), note)
        if common.ppm:  # in a chirp a delay that changes with frequency looks like clocks apart
            plain = prepared(records, asked, clocks=False)
            plain, other = _without_knocks(plain, _refined(plain, note), note)
            if 100.0 - result.fit_percent > _BETTER * (100.0 - other.fit_percent):
                common, result = plain, other
        return judged(*_at_one_clock(common, result, note))


_KNOCKS = 4
"""Cuts at knocks that are tried, one after the other."""
_NO_WORSE = 1.5
"""What both sides of a cut may leave, over what the longest side leaves by itself, where both are of one delay."""


def _without_knocks(
    common: Prepared, result: Identification, note: Callable[[str], None]
) -> tuple[Prepared, Identification]:
    """Return the records and their identification, cut where the residual jumps as neither command nor noise does: both
    sides are used where they are of one delay, the longest alone where they are not.
    """
    for _ in range(_KNOCKS):
        tests = result.tests
        if tests.knock <= trust.KNOCK.limit or tests.jump is None:
            break
        note("cutting the record where it jumps")
        spoilt, loss = common.records[tests.part], LostBlock(tests.jump, 0)
        sides, others = parts_between(spoilt, [loss]), [record for record in common.records if record is not spoilt]
        if len(sides) < 2:
            break
        longest = max([*sides, *others], key=lambda record: record.command.size)
        cut_there = f"lost {loss.told(common.rate_hz)}: the record was cut there"
        trials = []
        for kept, used in (
            ([*sides, *others], ""),
            ([longest], f", the longest part of {longest.duration_s:.4g} s used"),
        ):
            again = replace(prepared(kept, common.asked, mended=True), remarks=(*common.remarks, cut_there + used))
            trials.append((again, _refined(again, note)))
        both, alone = ((100.0 - trial.fit_percent) for _, trial in trials)
        common, result = trials[0] if both < _NO_WORSE * alone else trials[1]
    return common, result


_ROUNDS, _LEAST_PPM = 3, 0.05
_TOLD = 0.9
"""What a command that no converter held leaves of the position, over what a held one leaves, below which it is told."""
_BETTER = 0.98
"""What is left of the position at one clock, over what was left before, from which on the clocks were apart."""


def _at_one_clock(
    common: Prepared, result: Identification, note: Callable[[str], None]
) -> tuple[Identification, Prepared]:
    """Return the identification with the positions at the command's clock, and the records, where that leaves less."""
    first, more = common, 0.0
    for _ in range(_ROUNDS):
        ppm, half = result.tests.skew_ppm
        if abs(ppm) < 2.0 * half + _LEAST_PPM or common.references is not None:
            break
        note("reading the position at the command's clock")
        trial = _again(first, [of_one_clock(record, more + ppm) for record in first.records])
        again = _refined(trial, note)
        if 100.0 - again.fit_percent > _BETTER * (100.0 - result.fit_percent):
            break
        common, result, more = trial, again, more + ppm
    if common.ppm + more == 0.0:
        return result, common
    source, ppm = result.between.source, first.ppm + more
    holds = (True, False) if source == "data" else (result.between.hold != "band-limited",)
    trials = [_again(first, [without_images(record, held=held) for record in common.records]) for held in holds]
    said = f"command and position had clocks {ppm:.4g} ppm apart: the position was read anew, both at half the rate"
    return _at_lower_rate(trials, source, said, note)


def _at_those_read(
    records: Sequence[Record], read: Sequence[slice], asked: Asked, note: Callable[[str], None]
) -> tuple[Identification, Prepared]:
    """Return the identification by the samples of the position that were read, and these records."""
    wanted, source = _holds(records[0], asked)
    pairs, asked = list(zip(records, read, strict=True)), replace(asked, hold="auto")
    trials = [
        prepared([without_images(each, held=held, read=those) for each, those in pairs], asked, clocks=False)
        for held in ((True, False) if len(wanted) > 1 else (wanted[0] != "band-limited",))
    ]
    said = f"of every {read[0].step} samples of the position one was read: that one alone is used"
    return _at_lower_rate(trials, source, said, note)


def _at_lower_rate(
    trials: Sequence[Prepared], source: str, said: str, note: Callable[[str], None]
) -> tuple[Identification, Prepared]:
    """Return the better identification of records whose command was held before, and was not; its band holds both
    where they are alike.
    """
    fits = [_refined(trial, note) for trial in trials]
    left_over = [100.0 - fit.fit_percent for fit in fits]
    best = 1 if left_over[-1] < _TOLD * left_over[0] else 0
    result, model = fits[best], fits[best].model
    if len(fits) > 1 and (best == 1 or left_over[1] * _TOLD < left_over[0]):
        model = model.holding(fits[1 - best].model)
    model = replace(model, valid_hz=valid_range(model, model.valid_hz or model.band_hz))
    remarks = (*result.remarks, said)
    between = replace(result.between, source=source)
    return replace(result, model=model, remarks=remarks, between=between), trials[best]


def _again(first: Prepared, records: Sequence[Record]) -> Prepared:
    return replace(prepared(records, first.asked, mended=True), remarks=first.remarks, ppm=first.ppm)


def _refined(common: Prepared, note: Callable[[str], None]) -> Identification:
    asked = common.asked
    holds, source = _holds(common.records[0], asked)
    known = asked.known(common.gain)
    plans = plans_of(common)
    if plans is not None:
        return identify_periods(common, plans, holds, source, known, note)

    def estimate_of(signals: Signals, before: SpectralEstimate | None = None, quick: bool = False) -> SpectralEstimate:
        return estimate(signals, common.rate_hz, holds, known, note, before, quick)

    rubbed = first = None
    if asked.friction and common.references is None:
        first = estimate_of(common.signals, quick=True)
        note("looking for friction")
        rubbed = fit_friction(common.signals, first, known, estimate_of)
    if rubbed is not None:
        return identification(common, rubbed.estimate, source, rubbed.estimate.residuals, rubbed=rubbed)
    estimated = estimate_of(common.signals, first)
    if estimated.chosen.hold == "band-limited" and common.references is not None:
        note("fitting what follows the reference")
        estimated = following(estimated, common.references)
    if asked.friction and estimated.before is None:
        rubbed = fit_friction(common.signals, estimated, known, estimate_of)
    estimated = estimated if rubbed is None else rubbed.estimate
    return identification(common, estimated, source, estimated.residuals, rubbed=rubbed)


def _holds(record: Record, asked: Asked) -> tuple[tuple[Hold, ...], str]:
    """Return the holds to try, and who says so: the user, the record's own file, or the data."""
    if asked.hold != "auto":
        return (asked.hold,), "asked"
    written = tuple(hold for hold in HOLDS if hold == record.about.get("hold"))
    return (written, "file") if written else (("zero-order", "band-limited"), "data")
