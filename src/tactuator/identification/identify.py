"""From a record to a model with its uncertainty: all of identification behind one function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from tactuator.errors import BadInput
from tactuator.identification import by_spectrum
from tactuator.identification.asked import Asked
from tactuator.identification.by_inverse_dynamics import motor_identification
from tactuator.identification.by_periods import identify_periods, plans_of
from tactuator.identification.by_prediction import Prepared, recursive, refined
from tactuator.identification.estimate.refined import Samples, judge
from tactuator.identification.evidence.checks import check_direction, check_record
from tactuator.identification.evidence.empirical import empirical_response
from tactuator.identification.evidence.excitation import excitation_report, require_excitation
from tactuator.identification.result import BetweenSamples, Identification
from tactuator.identification.selection import choose_structure
from tactuator.identification.spectral.hold import HOLDS, Hold
from tactuator.identification.trust import distrusted
from tactuator.model.plant import DERIVATIVES
from tactuator.signals.record import Record

LONGEST = 1_000_000
"""Samples identified at once, of all records together; of longer ones the parts with most command power are taken."""
LONGEST_PREDICTED = 250_000
"""The same by prediction error, which costs each step a simulation."""
METHODS = ("refined", "prediction", "rls")


def identify(
    record: Record | Sequence[Record],
    *,
    method: str = "refined",
    forgetting: float = 1.0,
    note: Callable[[str], None] = lambda _: None,
    **wishes: object,
) -> Identification:
    """Return a continuous model of a record, or of several records of one mechanism at one rate.

    wishes: the fields of `Asked`. method: "refined" (maximum likelihood in the frequency domain, and by prediction
    error where friction shows), "prediction" (prediction error alone, for held commands), "rls" (the paper's recursive
    least squares, with `forgetting`). Several records are for "refined" alone. Raises BadInput for a record that cannot
    tell this.
    """
    records = [record] if isinstance(record, Record) else list(record)
    # threads of BLAS wait for each other over matrices of a dozen columns
    with threadpool_limits(limits=1):
        return _identify(records, method, forgetting, note, Asked(**wishes))  # type: ignore[arg-type]


def _identify(
    records: Sequence[Record], method: str, forgetting: float, note: Callable[[str], None], asked: Asked
) -> Identification:
    if method not in METHODS:
        raise BadInput(f"method {method!r}", f"{', '.join(METHODS)}")
    if method != "refined" and len(records) > 1:
        raise BadInput(f"{len(records)} records with the method {method!r}", "several with 'refined' alone")
    if method != "refined" and asked.fixed:
        raise BadInput(f"fixed values with the method {method!r}", "with 'refined' alone")
    common = _prepared(records, asked)
    if method == "rls":
        return distrusted(recursive(common, forgetting), common)
    if method == "prediction":
        return distrusted(_by_prediction(common, asked, note), common)
    return distrusted(_by_spectrum(common, asked, note), common)


def _prepared(records: Sequence[Record], asked: Asked) -> Prepared:
    remarks: list[str] = []
    parts: list[Record] = []
    for k, record in enumerate(records):
        try:
            found = [*record.remarks, *check_record(record)]
        except BadInput as error:
            raise BadInput(str(error) if len(records) == 1 else f"record {k + 1}: {error}") from None
        piece, said = _liveliest(record, LONGEST // len(records))
        parts.append(record.part(piece) if said else record)
        remarks += [one if len(records) == 1 else f"record {k + 1}: {one}" for one in [*found, *said]]
    _require_alike(parts)
    scale = tuple(
        float(np.sqrt(np.mean([np.var(getattr(one, name)) for one in parts]))) for name in ("command", "position")
    )
    hold = "first-order" if asked.hold == "first-order" else "zero-order"
    samples = [
        Samples(
            (one.command - one.command.mean()) / scale[0],
            (one.position - one.position.mean()) / scale[1],
            one.rate_hz,
            hold,  # type: ignore[arg-type]
        )
        for one in parts
    ]
    reports = [excitation_report(one.command, one.rate_hz, (asked.order or 2) + 1) for one in samples]
    liveliest = max(range(len(parts)), key=lambda k: (reports[k].order, parts[k].duration_s))
    require_excitation(reports[liveliest])
    order = [liveliest, *(k for k in range(len(parts)) if k != liveliest)]
    first = samples[liveliest]
    response = empirical_response(first.command, first.position, first.rate_hz)
    remarks += check_direction(response)
    others = tuple((parts[k], samples[k]) for k in order[1:])
    return Prepared(
        parts[liveliest], first, (scale[0], scale[1]), response, reports[liveliest], asked.quantity, asked.order,
        tuple(remarks), others, asked.fixed,
    )  # fmt: skip


def _require_alike(records: Sequence[Record]) -> None:
    first = records[0]
    for k, one in enumerate(records[1:], start=2):
        if abs(one.rate_hz / first.rate_hz - 1.0) > 1e-6:
            raise BadInput(f"record {k} has {one.rate_hz:g} Hz, the first {first.rate_hz:g} Hz", "one rate")
        units = [(record.command_unit, record.position_unit) for record in (first, one)]
        if units[0] != units[1]:
            raise BadInput(f"record {k} is in {units[1]}, the first in {units[0]}", "the same units")
        said = [record.about.get("hold") for record in (first, one)]
        if said[0] != said[1]:
            raise BadInput(f"record {k} says hold {said[1]}, the first {said[0]}", "the same")


def _liveliest(record: Record, most: int) -> tuple[slice, tuple[str, ...]]:
    """Return the part, of `most` samples, in which the command has most power, and what is to be said of that."""
    count = record.command.size
    if count <= most:
        return slice(0, count), ()
    power = np.cumsum((record.command - record.command.mean()) ** 2)
    starts = np.arange(0, count - most + 1, most // 4)
    best = int(starts[np.argmax(power[starts + most - 1] - power[starts])])
    said = f"of {record.duration_s:.4g} s the {most / record.rate_hz:.4g} s from {best / record.rate_hz:.4g} s are used"
    return slice(best, best + most), (said,)


def _shortened(common: Prepared) -> Prepared:
    """Return the same with as many samples as a prediction error is worked out over within a minute."""
    piece, said = _liveliest(common.record, LONGEST_PREDICTED)
    if not said:
        return common
    command, position = (getattr(common.samples, name)[piece] for name in ("command", "position"))
    samples = replace(common.samples, command=command - command.mean(), position=position - position.mean())
    remarks = (*common.remarks, f"by prediction error: {said[0]}")
    return replace(common, record=common.record.part(piece), samples=samples, remarks=remarks)


def _by_prediction(common: Prepared, asked: Asked, note: Callable[[str], None]) -> Identification:
    if not asked.is_free or (asked.order or 1) > 6 or asked.hold == "band-limited":
        raise BadInput(
            "zeros, integrators, a dead time, more than six poles or a band-limited command",
            "none of these with the method 'prediction'",
        )
    common = _shortened(common)
    found = choose_structure(
        common.samples,
        common.response,
        order=asked.order,
        integrated=DERIVATIVES[asked.quantity],
        friction=asked.friction,
        note=note,
    )
    made = refined(common, judge(common.samples, found.fit, found.tests), found.tried)
    return replace(made, between=BetweenSamples(common.samples.hold, "asked"))


def _by_spectrum(common: Prepared, asked: Asked, note: Callable[[str], None]) -> Identification:
    holds, source = _holds(common.record, asked)
    if asked.may_be_motor and not common.others:
        motor = motor_identification(common, BetweenSamples(holds[0], source, len(holds) == 1))
        if motor is not None:
            return motor
    known = asked.known(common.scale[1] / common.scale[0])
    plans = plans_of(common)
    if plans is not None:
        return identify_periods(common, plans, holds, source, known, note)
    found = by_spectrum.spectral_estimate(common, holds, known, note)
    between = BetweenSamples(found.chosen.hold, source, source != "data" or found.certain, found.advantage)
    residuals = found.residuals
    may_be_held = between.hold != "band-limited" or not between.certain
    if asked.friction and may_be_held and asked.is_free and (asked.order or 1) <= 6:
        note("looking for friction")
        shows = by_spectrum.friction_shows(residuals)
        if shows and common.others:
            said = "friction shows; its level is told from one record alone, and the band holds what it does here"
            common = replace(common, remarks=(*common.remarks, said))
        elif shows:
            made = _by_prediction(common, asked, note)
            if made.friction is not None:
                return by_spectrum.with_doubt(made, found, between)
    return by_spectrum.identification(common, found, residuals, between)


def _holds(record: Record, asked: Asked) -> tuple[tuple[Hold, ...], str]:
    """Return the holds to try, and who says so: the user, the record's own file, or the data."""
    if asked.hold != "auto":
        return tuple(hold for hold in HOLDS if hold == asked.hold), "asked"
    written = tuple(hold for hold in HOLDS if hold == record.about.get("hold"))
    return (written, "file") if written else (("zero-order", "band-limited"), "data")
